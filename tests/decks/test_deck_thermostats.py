"""Thermostats of decks that act within steps: the mean temperature, and its distribution where that is the canonical one."""

import numpy as np
import pytest
from cases import put
from judged import any_seed, judge

from openmm_dpd.lammps import RunOptions, run_deck

#: Soft beads without friction, from another temperature.  The kinetic energy of F degrees of freedom has a mean of F kT/2 and a variance of
#: F (kT)^2/2, so that the temperature has a variance of 2 T^2/F.
BEADS, TARGET = 60, 1.5
FLUID = f"""units lj
atom_modify sort 0 0
comm_modify vel yes
region box block 0 3 0 3 0 3 units box
create_box 1 box
create_atoms 1 random {BEADS} {{seed}} box
mass 1 1.0
pair_style dpd {TARGET} 1.0 3
pair_coeff * * 15.0 0.0
velocity all create 2.0 {{seed}} mom yes
{{fix}}
timestep 0.01
thermo 10000
run 1000
fix t all ave/time 1 1 5 c_thermo_temp file t.txt format " %.12g"
run {{steps}}
"""


def temperatures(folder, fix: str, seed: int, steps: int) -> np.ndarray:
    """Temperatures at every fifth step."""
    run_deck(
        put(folder / "in.deck", FLUID.format(fix=fix, seed=seed, steps=steps)), RunOptions(platform="Reference", threads=1), out=folder
    )
    return np.loadtxt(folder / "t.txt")[:, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "fix, freedom, canonical",
    [
        # standard errors are 0.3 % of the mean, 3 % of the variance
        pytest.param(
            "fix 1 all nve\nfix b all langevin 1.5 1.5 0.2 {seed}\ncompute_modify thermo_temp extra/dof 0", 3 * BEADS, True, id="langevin"
        ),
        # the total momentum stays 0
        pytest.param(
            "fix 1 all nve\nfix b all langevin 1.5 1.5 0.2 {seed} zero yes", 3 * BEADS - 3, True, id="langevin zero", marks=pytest.mark.long
        ),
        pytest.param("fix 1 all nvt temp 1.5 1.5 0.2", 3 * BEADS - 3, True, id="nvt"),
        # a tenth of the canonical variance, and means to 0.02 %
        pytest.param("fix 1 all nve\nfix b all temp/berendsen 1.5 1.5 0.2", 3 * BEADS - 3, False, id="temp/berendsen"),
        pytest.param(
            "fix 1 all nve\nfix b all temp/rescale 10 1.5 1.5 0.02 0.5", 3 * BEADS - 3, False, id="temp/rescale", marks=pytest.mark.long
        ),
    ],
)
@any_seed(11)
def test_temperatures(tmp_path, fix, freedom, canonical, seed):
    """Sees errors of 2 % in the mean (of 0.1 % without a canonical distribution), and of a sixth of the canonical variance."""
    folder = tmp_path / str(seed)
    folder.mkdir()
    found = temperatures(folder, fix.format(seed=seed), seed, 25_000)
    judge(found, TARGET, error=0.008 if canonical else 0.001, beside=0.001 * TARGET)
    deviations = (found - TARGET) ** 2 * freedom / (2 * TARGET**2)
    if canonical:
        judge(deviations, 1.0, error=0.05, beside=0.01)
    else:
        assert np.mean(deviations) < 0.9
