"""Scenes exported to LAMMPS, run there with one process and with two, and read back."""

import exported
import numpy as np
import pytest
from judged import any_seed

import openmm_dpd as dpd
from openmm_dpd.lammps import RunOptions, export_lammps, read_lammps_dump, run_deck, scene_from_data
from openmm_dpd.stats import block_average

REASON = exported.why_missing()
pytestmark = pytest.mark.skipif(REASON is not None, reason=str(REASON))

#: LAMMPS interpolates tables in r^2, this package in r, each on a grid of its own; sums over all images are as exact as the scene asks for (ions have no images).
TOLERANCE = {"overlay": 1e-5, "electrolyte": 1e-5, "driven": 1e-7}  # body forces here round the position


def with_forces(written):
    """Let the exported deck write the forces as well."""
    text = written.deck.read_text()
    more = "dump forces all custom 1 forces.dump id x y z fx fy fz\ndump_modify forces sort id format float %.17g\nrun "
    assert text.count("\nrun ") == 1
    written.deck.write_text(text.replace("\nrun ", "\n" + more))


@pytest.mark.parametrize("name", exported.SCENES)
def test_forces_of_the_first_step_and_the_state_that_comes_back(name, tmp_path):
    """In both systems of units.  LAMMPS's first frame and data file hold the scene: positions with their images, velocities, what beads carry."""
    scene = exported.scene(name)
    terms = dpd.force_terms(dpd.build(scene, dt=0.001, scheme="mvv", platform="Reference", seed=1))
    expected = sum(values for term, values in terms.items() if term != "random" and not term.startswith("rates"))
    largest = np.abs(expected).max()
    assert largest > 10
    written = {}
    for units in ("lj", "real"):
        if units == "real" and name in ("many-body", "heat", "species"):
            with pytest.raises(dpd.ParameterError, match="units lj"):
                export_lammps(scene, tmp_path / units, name, dt=0.001, steps=0, units=units)
        else:
            written[units] = export_lammps(scene, tmp_path / units, name, dt=0.001, steps=0, seed=3, units=units)
            assert not written[units].differences
            with_forces(written[units])
    for units in written:
        # a process of its own: after "clear" LAMMPS had other forces once; two where what each needs of the other's beads is in the deck
        shared = units == "lj" and name in ("chains", "segments", "tilted", "heat")
        exported.run_lammps(tmp_path / units, name, processes=2 if shared else 1)
        # segments have placeholders behind the beads
        forces = read_lammps_dump(tmp_path / units / "forces.dump", units=units).forces[0][: scene.n_beads]
        np.testing.assert_allclose(forces, expected, rtol=0, atol=TOLERANCE.get(name, 1e-9) * largest)
    for found in (read_lammps_dump(written["lj"].dump, scene).scene(0), scene_from_data(written["lj"].final, scene)):
        np.testing.assert_allclose(found.positions, scene.positions, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.velocities, scene.velocities, rtol=0, atol=1e-14)
        if scene.box is not None:
            np.testing.assert_allclose(found.box, scene.box, rtol=1e-14, atol=1e-14)
        if isinstance(scene.internal, dpd.InternalEnergy):
            energies = [s.internal.energies(s.type_ids, s.type_names).sum(axis=1) for s in (found, scene)]
            np.testing.assert_allclose(*energies, rtol=1e-5)  # the table of LAMMPS
        elif isinstance(scene.internal, dpd.BeadTemperatures):
            np.testing.assert_allclose(found.internal.values(scene.n_beads), scene.internal.values(scene.n_beads), rtol=1e-14)
        elif isinstance(scene.internal, dpd.Concentrations):
            np.testing.assert_allclose(found.internal.values, scene.internal.values, rtol=1e-14)


# -- averages -----------------------------------------------------------------------------------------------------------------
def _relaxed(scene: dpd.Scene, steps: int = 400) -> dpd.Scene:
    """The scene after a short run from its random start."""
    from dataclasses import replace

    built = dpd.build(scene, dt=0.01, scheme="middle" if scene.internal is None else "mvv", platform="Reference", seed=8)
    simulation = built.simulation()
    simulation.step(steps)
    state = simulation.context.getState(positions=True, velocities=True)
    return replace(scene, positions=state.getPositions(asNumpy=True)._value, velocities=state.getVelocities(asNumpy=True)._value)


def _warm(name: str) -> dpd.Scene:
    n, edge = 375, 5.0
    types, x = ["A" if k % 3 else "B" for k in range(n)], np.random.default_rng(11).random((n, 3)) * edge
    beads = {"masses": {"A": 1.0, "B": 2.0}, "types": types, "positions": x, "box": [edge] * 3}
    if name == "fluid":
        return dpd.Scene(pairs=exported.TWO, kT=1.0, **beads)
    if name == "chains":
        walks, bonds, angles = exported.chains(45, 8)
        del walks["velocities"]
        terms = {"bonds": [dpd.HarmonicBonds(bonds, 100.0, 0.7)], "angles": [dpd.CosineAngles(angles, 5.0)]}
        return dpd.Scene(pairs=exported.TWO, **terms, **walks | {"kT": 1.0})
    if name == "electrolyte":
        return exported.electrolyte(True, 1e-3, 140.0, kT=1.0, velocities=None)  # Bjerrum length 1
    relaxed = _relaxed(dpd.Scene(pairs=exported.TWO, kT=1.0, **beads))
    beads |= {"positions": relaxed.positions, "velocities": relaxed.velocities}
    internal = dpd.InternalEnergy(dpd.ConstantHeatCapacity(30.0), 1.0)
    return dpd.Scene(pairs={("*", "*"): dpd.EnergyDPD(A=25, sigma=3.0, kappa=1.0)}, internal=internal, kT=1.0, **beads)


def _ours(scene: dpd.Scene, steps: int, seed: int) -> dict[str, np.ndarray]:
    """Temperature, pressure and energy of this package, every 10 steps after a tenth of the run."""
    built = dpd.build(scene, dt=0.01, scheme="mvv", platform="CPU", seed=seed)
    simulation = built.simulation()
    observer = dpd.Observer(built)
    simulation.step(steps // 10)
    samples = []
    for _ in range((steps - steps // 10) // 10):
        simulation.step(10)
        samples.append(observer.sample(simulation.context))
    return {
        "kT": np.array([sample.kT for sample in samples]),
        "pressure": np.array([sample.pressure() for sample in samples]),
        "potential": np.array([sample.potential for sample in samples]),
    }


@any_seed(5)
@pytest.mark.parametrize("steps", [400, pytest.param(20000, marks=[pytest.mark.slow, pytest.mark.long])])
@pytest.mark.parametrize("name", ["fluid", "chains", "energy", "electrolyte"])
def test_averages_of_a_run(name, steps, tmp_path, seed):
    """Averages of LAMMPS and of this package on the same exported deck: temperature, pressure and energy."""
    scene = _warm(name)
    if scene.internal is None:
        scene = _relaxed(scene)
    written = export_lammps(scene, tmp_path, name, dt=0.01, steps=steps, seed=seed + 16, every=10)
    assert not written.differences
    theirs = exported.thermo(exported.run_lammps(tmp_path, name))
    ours = _ours(scene, steps, seed)
    late = theirs["Step"] > steps // 10
    for column, word in (("Temp", "kT"), ("Press", "pressure"), ("PotEng", "potential")):
        average, other = block_average(theirs[column][late]), block_average(ours[word])
        # a run of a few correlation times (up to 5 rows in long runs) says too little about its own error
        least = [np.std(rows) * np.sqrt(2 * 5 / len(rows)) for rows in (theirs[column][late], ours[word])]
        error = np.hypot(max(average.sem, least[0]), max(other.sem, least[1]))
        assert 0 < error < 0.1 * abs(average.mean), (word, error)
        assert abs(average.mean - other.mean) < 4 * error, (word, average, other)
    frames = read_lammps_dump(written.dump, scene)
    np.testing.assert_allclose(scene_from_data(written.final, scene).positions, frames.scene().positions, atol=1e-12)
    assert frames.trajectory(dt=0.01).n_frames == len(frames) == steps // 10 + 1


@pytest.mark.slow
def test_shardlow_heats_and_conserves_as_here(tmp_path):
    """Energy-conserving beads under fix shardlow: the total energy of LAMMPS stays what it is here at the start."""
    scene = _warm("energy")
    with pytest.warns(UserWarning, match="no scheme 'middle'.*fix shardlow"):
        written = export_lammps(scene, tmp_path, "sweep", dt=0.005, steps=200, seed=2, scheme="middle")
    rows = exported.thermo(exported.run_lammps(tmp_path, "sweep"))
    total = rows["TotEng"] + rows["c_sums[1]"] + rows["c_sums[2]"]
    assert np.ptp(total) < 1e-3 * abs(rows["PotEng"][0])
    report = run_deck(written.deck, RunOptions(platform="Reference", steps=0), out=tmp_path / "out")
    assert total[0] == pytest.approx(report["thermo"]["etotal"]["first"] + 30 * 375)


@any_seed(3)
def test_ramps_begin_and_end_where_the_scene_says(tmp_path, seed):
    from dataclasses import replace

    scene = replace(_relaxed(_warm("fluid")), kT=dpd.TemperatureRamp(1.0, 3.0, 100, 500))
    text = export_lammps(scene, tmp_path, "ramp", dt=0.01, steps=600, seed=seed, every=10).deck.read_text()
    assert "run 100\n" in text and "run 400 start 100 stop 500\n" in text and text.count("\nrun ") == 3
    last = exported.thermo(exported.run_lammps(tmp_path, "ramp"))
    assert last["Step"][0] == 500 and last["Step"][-1] == 600
    assert last["Temp"].mean() == pytest.approx(3.0, abs=4 * 3.0 * np.sqrt(2 / (3 * 375)))


def test_walls_of_frozen_beads_move_by_their_velocities_only_as_seen(tmp_path):
    from dataclasses import replace

    base = _relaxed(_warm("fluid"))
    frozen = base.positions[:, 2] % 5.0 < 1.0
    scene = replace(base, mobile=~frozen, velocities=np.where(frozen[:, None], [10.0, 0.0, 0.0], base.velocities))
    for scheme in ("mvv", "shardlow"):
        written = export_lammps(scene, tmp_path, scheme, dt=0.01, steps=50, seed=3, scheme=scheme)
        exported.run_lammps(tmp_path, scheme)
        found = read_lammps_dump(written.dump, scene).scene()
        np.testing.assert_allclose(found.positions[frozen], scene.positions[frozen], atol=1e-12)
        np.testing.assert_allclose(found.velocities[frozen], [[10.0, 0.0, 0.0]] * frozen.sum(), atol=1e-9)
        # dragged along: by 0.18 with a standard error of 0.02
        assert found.velocities[~frozen, 0].mean() - base.velocities[~frozen, 0].mean() > 0.1
