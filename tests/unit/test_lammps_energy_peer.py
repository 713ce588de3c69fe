"""The example decks with energies, heat, species and densities against a live LAMMPS: the energies of their first configuration."""

import shutil
from pathlib import Path

import lammps_peer
import numpy as np
import pytest

from openmm_dpd.lammps import RunOptions, read_deck
from openmm_dpd.lammps.output.data_writer import data_file_lines
from openmm_dpd.lammps.run.runner import DeckRunner

pytestmark = lammps_peer.needed()

DECKS = Path(__file__).resolve().parents[2] / "examples" / "decks"
EXAMPLES = ("dpde-vv", "dpde-shardlow", "dpdp-shardlow", "dpdh-shardlow", "dpde-table", "edpd", "tdpd", "mdpd")

#: Commands about output, which the energy of the first configuration does not need.
OUTPUT = ("compute", "thermo", "thermo_style", "thermo_modify", "dump", "reset_timestep")


def physics(name: str) -> str:
    """Lines of an example deck up to its first run, without output, and a run of no steps."""
    lines = (DECKS / f"in.{name}").read_text().replace("&\n", " ").splitlines()
    kept: list[str] = []
    for line in lines:
        words = line.partition("#")[0].split()
        if words[:1] == ["run"]:
            break
        output = words[:1] and (words[0] in OUTPUT or (words[0] == "fix" and words[3].startswith("ave/")))
        if words and not output and not (words[0] == "variable" and words[2] != "index"):
            kept.append(line)
    return "\n".join([*kept, "thermo_style custom step pe ke press", "thermo_modify norm no", "run 0", ""])


@pytest.mark.parametrize("name", EXAMPLES)
def test_energies_of_the_example_decks_are_those_of_lammps(tmp_path, name):
    """LAMMPS starts from the data file that we write at this point."""
    for path in (*DECKS.glob("data.*"), *DECKS.glob("table.*")):
        shutil.copy(path, tmp_path)
    text = physics(name)
    (tmp_path / "in.deck").write_text(text)
    runner = DeckRunner(RunOptions(platform="CPU", threads=1))
    state = read_deck(tmp_path / "in.deck", run_callback=runner, output=tmp_path)
    (tmp_path / "data.ours").write_text("\n".join(data_file_lines(state, pair=None)) + "\n")
    ours = {word: runner.results[0].rows[word][0] for word in ("pe", "ke", "press")}
    with lammps_peer.instance() as lmp:
        lmp.command(f"shell cd {tmp_path}")
        for line in text.splitlines():
            word = line.split()[0]
            if word in ("read_data", "create_box"):
                lmp.command("read_data data.ours")
            elif word not in ("create_atoms", "velocity", "set", "lattice"):
                lmp.command(line)
        theirs = {word: lmp.get_thermo(word) for word in ours}
        inner = None
        if state.atoms.u_mech.any():
            lmp.command("compute inner all dpd/atom")
            inner = lmp.numpy.extract_compute("inner", 1, 2)[np.argsort(lmp.numpy.extract_atom("id")[: len(state.atoms)])].copy()
    assert ours["pe"] == pytest.approx(theirs["pe"], rel=1e-11)
    assert ours["ke"] == pytest.approx(theirs["ke"], rel=1e-12)
    if "shardlow" in name or name == "dpde-table":  # there is no noise in the pressure
        assert ours["press"] == pytest.approx(theirs["press"], rel=1e-10)
    if inner is not None:
        u_cond, u_mech, _, theta = inner.T
        np.testing.assert_allclose(state.atoms.u_mech / state.units.energy, u_mech, rtol=1e-12)
        np.testing.assert_allclose(state.atoms.thetas, theta, rtol=1e-12)
        assert not u_cond.any() and not state.atoms.u_cond.any()
