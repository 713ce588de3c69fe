"""Bonds that form and break: against trials written out in numpy, forces of bonds that stay, restarts, threads, and equilibrium."""

import io
from dataclasses import replace

import numpy as np
import openmm
import oracle
import pytest
from cases import raises
from judged import any_seed, judge
from openmm import unit
from scipy.special import gammaln

import openmm_dpd as dpd
from openmm_dpd.runtime import set_threads

N, EDGE = 240, 4.3
HARMONIC = {"k": 20.0, "r0": 0.5}


def scene(reactions, n=N, edge=EDGE, A=25.0, seed=1, **changes):
    rng = np.random.default_rng(seed)
    arguments = {"masses": {"A": 1.0, "B": 2.0}, "types": ["A", "B"] * (n // 2), "positions": rng.random((n, 3)) * edge, "kT": 1.0}
    arguments |= {"pairs": {("*", "*"): dpd.DPD(A=A, gamma=4.5)}, "box": [edge] * 3, "reactions": reactions}
    return dpd.Scene(**arguments | changes)


def both(every=(5, 7), angle=None, **changes):
    """A formation and a breaking that have something to do in most trials."""
    bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, HARMONIC, [] if angle else [[0, 1], [2, 3]])
    forming = {"angle": angle, "becomes": changes.pop("becomes", None)}
    made = dpd.BondFormation(bonds, ("A", "B"), within=0.7, valences=(1, 2), every=every[0], **forming, **changes)
    return [made, dpd.BondBreaking(bonds, beyond=0.75, every=every[1], **changes)]


def state(simulation):
    found = simulation.context.getState(positions=True, velocities=True, energy=True)
    x, v = found.getPositions(asNumpy=True), found.getVelocities(asNumpy=True)
    return x.value_in_unit(unit.nanometer), v.value_in_unit(unit.nanometer / unit.picosecond), found.getPotentialEnergy()._value


def bonds_in(simulation, built):
    return {(i, j) for i, j, _ in dpd.read_bonds(simulation.context, built.plan).tolist()}


# -- the oracle: what a trial does, bead by bead ----------------------------------------------------------------------------------
def lengths(x, box):
    d = np.linalg.norm(oracle.minimum_image(x[:, None] - x[None], box).reshape(len(x), len(x), 3), axis=2)
    np.fill_diagonal(d, np.inf)
    return d


def partners(score):
    """Pairs of beads that are the best of each other; a score is inf where there is no pair."""
    best = score.argmin(axis=1)
    return {(i, int(j)) for i, j in enumerate(best) if i < j and best[j] == i and np.isfinite(score[i, j])}


def formed(x, box, types, there, within, valences, molecules):
    n, d = len(x), lengths(x, box)
    count = np.bincount(np.array([*there], int).ravel(), minlength=n)
    room = count < np.array([valences[t] for t in types])
    able = (molecules[:, None] != molecules[None]) & (types[:, None] != types[None]) & room[:, None] & room[None] & (d < within)
    for i, j in there:
        able[i, j] = able[j, i] = False
    return partners(np.where(able, d, np.inf))


def broken(x, box, there, beyond):
    d = lengths(x, box)
    score = np.full_like(d, np.inf)
    for i, j in there:
        if d[i, j] > beyond:
            score[i, j] = score[j, i] = -d[i, j]
    return partners(score)


@pytest.mark.parametrize("scheme", ["middle", "mvv", "B/2 A/2 O A/2 B/2"])
def test_trials_are_those_of_the_oracle(scheme):
    """Every bond made and broken in 70 steps.  After the last drift of a step positions are those at its end."""
    molecules = np.random.default_rng(4).integers(0, 3, N) if scheme == "middle" else np.arange(N)
    reactions = both()
    reactions[0] = replace(reactions[0], molecules=molecules)
    assert "molecules = ndarray" in str(reactions[0]) and "inside" not in str(reactions[0])
    built = dpd.build(scene(reactions), dt=0.05, scheme=scheme, platform="CPU", seed=3)
    simulation, types, box = built.simulation(), built.plan.scene.type_ids, np.diag([EDGE] * 3)
    there, made, lost = {(0, 1), (2, 3)}, 0, 0
    assert bonds_in(simulation, built) == there
    for step in range(1, 71):
        simulation.step(1)
        x = state(simulation)[0]
        if step % 5 == 0:
            new = formed(x, box, types, there, 0.7, (1, 2), molecules)
            there, made = there | new, made + len(new)
        if step % 7 == 0:
            gone = broken(x, box, there, 0.75)
            there, lost = there - gone, lost + len(gone)
        assert bonds_in(simulation, built) == there, step
    assert made > 60
    assert lost > 10
    found = dpd.read_reacted(simulation.context, built.plan)
    assert (found[0, 0], found[1, 1]) == (made, lost)


@pytest.mark.parametrize("angle", [None, dpd.CosineDeltaAngles([[7, 8, 9]], k=5.0, theta0=2.0)])
def test_forces_energies_and_stresses_are_those_of_bonds_that_stay(angle):
    """The same positions, with the present bonds in `bonds`: what OpenMM asks for, and what an Observer measures; then a minimisation."""
    soft = {("*", "*"): dpd.NONE, ("C", "B"): dpd.RadialPair("soft", {"A": 5.0}, cutoff=0.9)}
    given = {"masses": {"A": 1.0, "B": 2.0, "C": 1.0}} if angle else {}
    hard = {("*", "*"): dpd.DPD(A=25, gamma=4.5), ("C", "B"): dpd.DPD(A=50, gamma=2.0)}
    given |= (
        {"bonded_factors": (0.0, 0.5, 1.0), "pairs": [hard, soft], "segments": dpd.SegmentalRepulsion(40.0, 0.7, "min")} if angle else {}
    )
    reactions = both(angle=angle, becomes=("C", None)) if angle else both()
    segments = {"segments": replace(given["segments"], bonds=[reactions[0].bonds])} if angle else {}
    built = dpd.build(scene(reactions, **given | segments), dt=0.04, platform="CPU", seed=3)
    simulation = built.simulation()
    simulation.step(37)
    x, v, energy = state(simulation)
    there = dpd.HarmonicBonds(np.array(sorted(bonds_in(simulation, built))), **HARMONIC)
    ends = []
    for k in range(N) if angle else ():  # at most two bonds per bead
        near = (there.pairs[(there.pairs == k).any(axis=1)].sum(axis=1) - k).tolist()
        ends += [(near[0], k, near[1])] if len(near) == 2 else []
    bent = [dpd.CosineDeltaAngles(ends, k=5.0, theta0=2.0)] if angle else []
    given["types"] = dpd.read_types(simulation.context, built.plan)
    assert given["types"].count("C") > (20 if angle else -1)
    stays = dpd.build(scene([], positions=x, velocities=v, bonds=[there], angles=bent, **given), dt=0.04, platform="CPU", seed=3)
    other = stays.simulation()
    forces = [each.context.getState(forces=True).getForces(asNumpy=True)._value for each in (simulation, other)]
    np.testing.assert_allclose(forces[0], forces[1], rtol=0, atol=1e-10)
    assert energy == pytest.approx(state(other)[2], rel=1e-12)
    samples = [dpd.Observer(made).sample(each.context) for made, each in ((built, simulation), (stays, other))]
    for name in ("bond", "angle", "pair", "potential", "virial_conservative", "virial_dissipative", "laplacian", "gradient2"):
        found, wanted = (getattr(sample, name) for sample in samples)
        assert found == (None if wanted is None else pytest.approx(wanted, rel=1e-11)), name
    assert samples[0].bond > 10
    for each in (simulation, other):
        each.minimizeEnergy(maxIterations=20)
    assert state(simulation)[2] == pytest.approx(state(other)[2], rel=1e-9)


@pytest.mark.parametrize("scheme", ["middle", "mvv"])
def test_slow_forces_act_beside_the_present_bonds(scheme):
    """OpenMM's own forces in every step, for which the Context is read during a run: cuts between trials move no bit."""
    found = []
    for cut in ((20,), (4, 16), (19, 1)):
        push = dpd.PositionForce(["0.1*sin(x)", "0", "0"])
        built = dpd.build(scene(both(every=(3, 4)), body_forces=[push]), dt=0.03, scheme=scheme, platform="CPU", seed=3)
        simulation = built.simulation()
        for steps in cut:
            simulation.step(steps)
        found.append((*state(simulation), bonds_in(simulation, built)))
    for other in found[1:]:
        assert np.array_equal(found[0][0], other[0])
        assert found[0][2:] == other[2:]


@pytest.mark.parametrize("scheme", ["middle", "mvv"])
def test_momentum_is_conserved_and_runs_do_not_depend_on_cuts_threads_or_restarts(scheme):
    reactions = [*both(probability=0.6), dpd.BondFormation(_sort(), ("A", "A"), 0.6, 1, energy=1.0, every=3)]
    segments = dpd.SegmentalRepulsion(30.0, 0.7, bonds=[reactions[0].bonds])

    def start(seed=3):
        built = dpd.build(scene(reactions, segments=segments), dt=0.04, scheme=scheme, platform="CPU", seed=seed)
        return built, built.simulation()

    built, simulation = start()
    before = built.plan.scene.bead_masses @ state(simulation)[1]
    simulation.step(60)
    wanted = state(simulation), dpd.read_bonds(simulation.context, built.plan), dpd.read_reacted(simulation.context, built.plan)
    np.testing.assert_allclose(built.plan.scene.bead_masses @ wanted[0][1], before, atol=1e-11)
    assert wanted[2][:, :2].min(axis=0).max() >= 0
    assert wanted[2][2].min() >= 0

    def same(built, simulation):
        for found, its in zip((*state(simulation), dpd.read_bonds(simulation.context, built.plan)), (*wanted[0], wanted[1]), strict=True):
            assert np.array_equal(found, its)
        assert np.array_equal(dpd.read_reacted(simulation.context, built.plan), wanted[2])

    built, simulation = start()
    for steps in (1, 12, 2, 16):
        simulation.step(steps)
        simulation.context.getState(energy=True)
    kept, text = io.BytesIO(), io.StringIO()
    simulation.saveCheckpoint(kept)
    simulation.saveState(text)
    simulation.step(29)
    same(built, simulation)
    built, simulation = start()
    simulation.step(20)
    kept.seek(0)
    simulation.loadCheckpoint(kept)  # over bonds of another state
    simulation.step(29)
    same(built, simulation)
    built, simulation = start()
    simulation.loadState(io.StringIO(text.getvalue()))
    simulation.step(29)
    same(built, simulation)
    set_threads(2)
    try:
        built, simulation = start()
        simulation.step(60)
        same(built, simulation)
    finally:
        set_threads(None)


def test_a_context_without_reactions_says_how_their_states_are_loaded():
    reacting = dpd.build(scene(both()), dt=0.04, platform="CPU", seed=3).simulation()
    reacting.step(10)
    simulation = dpd.build(scene([]), dt=0.04, platform="CPU", seed=3).simulation()
    whole = reacting.context.getState(positions=True, velocities=True, parameters=True)
    raises(dpd.PlanError, "bonds that form .*here none do: use simulation.loadState", simulation.context.setState, whole)
    assert dpd.read_types(simulation.context, dpd.make_plan(scene([]), dt=0.04)) == ["A", "B"] * (N // 2)


def test_types_of_states_are_those_that_reactions_here_can_make():
    """Numbers of types are places among the masses: in another order they are others."""
    masses, text = {"A": 1.0, "B": 2.0, "C": 1.0}, io.StringIO()
    changing = dpd.build(scene(both(becomes=("C", None)), masses=masses), dt=0.04, platform="CPU", seed=3).simulation()
    changing.step(5)
    changing.saveState(text)
    for others in (masses, dict(sorted(masses.items(), reverse=True))):
        built = dpd.build(scene(both(becomes=("C", None)), masses=others), dt=0.04, platform="CPU", seed=3)
        simulation = built.simulation()
        simulation.loadState(io.StringIO(text.getvalue()))
        if others is masses:
            simulation.step(1)
        else:
            raises(openmm.OpenMMException, "types that this scene's reactions cannot make", simulation.step, 1)


def _sort(k=20.0, r0=0.3, pairs=()):
    return dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": k, "r0": r0}, pairs)


def test_two_threads_make_the_same_bonds():
    """Enough beads for two threads, which play steps with the beads in other seats."""
    found = []
    for threads in (1, 2):
        set_threads(threads)
        try:
            many = {"n": 1600, "edge": 8.1, "segments": dpd.SegmentalRepulsion(30.0, 0.7)}
            built = dpd.build(scene(both(every=(8, 12)), **many), dt=0.04, platform="CPU", seed=3)
            simulation = built.simulation()
            simulation.step(60)
            found.append(
                (*state(simulation), dpd.read_bonds(simulation.context, built.plan), dpd.read_reacted(simulation.context, built.plan))
            )
        finally:
            set_threads(None)
    assert all(np.array_equal(one, other) for one, other in zip(*found, strict=True))
    assert found[0][-1][:, :2].sum() > 500


def test_beads_beside_walls_in_a_shear_a_barostat_and_on_reference():
    """Bonds across sliding images and in a box that changes are as long as measured; a bead with a bond that stays gets no second one."""
    reactions = both()
    bonds = [dpd.HarmonicBonds([[k, k + 1] for k in range(10, 60, 2)], **HARMONIC)]
    walls = [dpd.Wall("z", 0.0, "above"), dpd.Wall("z", EDGE, "below")]
    cases = {
        "shear": {"shear": dpd.LeesEdwards(rate=0.3)},
        "stay": {"bonds": bonds},
        "walls": {"walls": walls, "box": [EDGE, EDGE, EDGE + 1.0]},
        "box": {},
        "none": {"box": None},
    }
    for name, changes in cases.items():
        built = dpd.build(scene(reactions, **changes), dt=0.04, platform="Reference" if name == "stay" else "CPU", seed=3)
        if name == "box":
            dpd.add_barostat(built, 20.0, interval=10)
        simulation = built.simulation()
        simulation.step(30)
        there = bonds_in(simulation, built)
        assert len(there) > 9
        sample = dpd.Observer(built).sample(simulation.context)
        x = state(simulation)[0]
        d = oracle.minimum_image(np.array([x[i] - x[j] for i, j in sorted(there)]), sample.box)
        energy = 20.0 * ((np.linalg.norm(d, axis=1) - 0.5) ** 2).sum()
        stays = 0.0 if name != "stay" else float(bonds[0].curve(bonds[0].lengths(x, sample.box))[0].sum())
        assert sample.bond == pytest.approx(energy + stays, rel=1e-9), name
        assert not there & {tuple(pair) for pair in bonds[0].pairs.tolist()} or name != "stay"


def test_segments_of_bonds_that_could_break_in_a_shear():
    """Across images that slide: beads move as with bonds that stay."""
    x = np.random.default_rng(3).random((N, 3)) * EDGE
    pairs, turns = np.arange(N).reshape(-1, 2), np.random.default_rng(4).normal(size=(N // 2, 3))
    x[1::2] = x[::2] + 0.5 * turns / np.linalg.norm(turns, axis=1)[:, None]
    moving, given = dpd.ReactiveBonds(dpd.HarmonicBonds, HARMONIC, pairs), {"positions": x, "shear": dpd.LeesEdwards(rate=2.0), "A": 0.0}
    given |= {"segments": dpd.SegmentalRepulsion(60.0, 0.9), "kT": 0.0, "velocities": np.zeros((N, 3))}
    scenes = (
        scene([dpd.BondBreaking(moving, beyond=9.0, every=40)], **given),
        scene([], bonds=[dpd.HarmonicBonds(pairs, **HARMONIC)], **given),
    )
    found = []
    for each in scenes:
        simulation = dpd.build(each, dt=0.02, platform="CPU", seed=3).simulation()
        simulation.step(40)
        found.append(state(simulation)[0])
    np.testing.assert_allclose(found[0], found[1], atol=1e-9)
    assert np.abs(found[0] - x).max() > 1.0


def test_sorts_do_not_share_valences_and_spent_valences_stay_spent():
    """Two sorts: A - B with one bond each, and A - A with one each; those of the first that break are spent."""
    sorts = _sort(pairs=[[0, 1]]), _sort(k=5.0)
    reactions = [dpd.BondFormation(sorts[0], ("A", "B"), 0.6, 1), dpd.BondFormation(sorts[1], ("A", "A"), 0.6, 1)]
    reactions += [dpd.BondBreaking(sorts[0], rate=1e9, spends=True, start=20)]
    built = dpd.build(scene(reactions), dt=0.04, platform="CPU", seed=3)
    simulation = built.simulation()
    simulation.step(15)
    found = dpd.read_bonds(simulation.context, built.plan)
    for sort in (0, 1):
        assert np.bincount(found[found[:, 2] == sort, :2].ravel()).max() == 1
    assert not {tuple(row) for row in found[found[:, 2] == 0, :2]} & {tuple(row) for row in found[found[:, 2] == 1, :2]}
    made = (found[:, 2] == 0).sum()
    simulation.step(15)
    left = dpd.read_bonds(simulation.context, built.plan)
    assert (left[:, 2] == 0).sum() <= made // 2  # made in the last step, and not tried in it
    counts = dpd.read_reacted(simulation.context, built.plan)
    assert counts[0, 0] <= N // 2
    assert counts[2, 1] >= made


def test_bonds_break_at_the_rate_of_bell():
    """3000 bonds between beads that do not move, of three lengths: numbers that are left, each within 4.5 standard deviations."""
    n, stretches = 3000, np.array([0.0, 0.05, 0.1])
    x = np.zeros((2 * n + 2, 3))
    x[: 2 * n : 2] = np.random.default_rng(2).random((n, 3)) * 20.0
    x[1 : 2 * n : 2] = x[: 2 * n : 2] + [1.0, 0, 0] * (0.5 + stretches[np.arange(n) % 3, None])
    bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 50.0, "r0": 0.5}, np.arange(2 * n).reshape(-1, 2))
    reaction = dpd.BondBreaking(bonds, rate=0.02 / unit.picosecond, barrier=0.1 * unit.nanometer, every=4)
    given = {"types": ["A"] * len(x), "positions": x, "mobile": np.arange(len(x)) >= 2 * n, "pairs": {("*", "*"): dpd.DPD(A=0, gamma=4.5)}}
    built = dpd.build(scene([reaction], n=len(x), edge=21.0, **given), dt=0.05, platform="CPU", seed=5)
    simulation = built.simulation()
    simulation.step(200)
    left = dpd.read_bonds(simulation.context, built.plan)
    found = np.bincount(left[:, 0] // 2 % 3, minlength=3)
    stays = np.exp(-0.02 * np.exp(2 * 50.0 * stretches * 0.1) * 200 * 0.05)
    np.testing.assert_array_less(np.abs(found - n / 3 * stays), 4.5 * np.sqrt(n / 3 * stays * (1 - stays)))


def test_a_reporter_writes_every_event_once(tmp_path):
    path, fields = tmp_path / "events.csv", tmp_path / "bonds.npz"

    def run(steps, kept=None, append=False):
        built = dpd.build(scene(both()), dt=0.04, platform="CPU", seed=3)
        simulation = built.simulation()
        if kept is not None:
            simulation.loadCheckpoint(io.BytesIO(kept))
        simulation.reporters.append(dpd.ReactionReporter(path, 10, built, append=append))
        simulation.reporters.append(dpd.FieldReporter(fields, 10, built, append=append))
        simulation.step(steps)
        return built, simulation

    run(70)
    whole = path.read_text()
    _, simulation = run(40)
    kept = simulation.context.createCheckpoint()
    simulation.step(20)  # what comes after the checkpoint, and is done again
    built, simulation = run(30, kept, append=True)
    assert path.read_text() == whole
    rows = np.genfromtxt(path, delimiter=",", names=True)
    there = {(0, 1), (2, 3)}
    for row in rows:
        pair = int(row["i"]), int(row["j"])
        assert (pair in there) == (row["change"] < 0)
        there ^= {pair}
        assert row["energy"] == pytest.approx(row["change"] * 20.0 * (row["length"] - 0.5) ** 2, rel=1e-6)
    assert there == bonds_in(simulation, built)
    assert dpd.load_fields(fields)["bonds"].shape[1:] == (N, 3)
    other = dpd.build(scene([]), dt=0.04, platform="CPU")
    raises(dpd.ParameterError, "neither form nor break", dpd.ReactionReporter, path, 10, other)


BEND = dpd.HarmonicAngles([[0, 1, 2]], k=5.0, theta0=2.0)
STARTED = dpd.ReactiveBonds(dpd.HarmonicBonds, HARMONIC, [[0, 1]])
WRONG = {  # Arguments of a formation, or of a scene, and what is said to them.
    "valences": ({"valences": (1, 0)}, "a valence of a bond formation must be at least 1"),
    "one valence": ({"types": ("A", "A"), "valences": (1, 2)}, "so their valences are the same"),
    "types": ({"types": "AB"}, "the types of a bond formation must be two"),
    "unknown": ({"types": ("A", "C")}, "there is no bead type 'C'"),
    "both": ({"probability": 0.5, "rate": 1.0}, "a probability of at most 1, or a rate in its place"),
    "far": ({"within": 2.5}, "less than twice as wide"),
    "fene": ({"bonds": dpd.ReactiveBonds(dpd.FENEBonds, {"k": 30.0, "R0": 0.5}), "within": 0.6}, "longer bonds than FENEBonds"),
    "cold": ({"energy": 1.0, "kT": 0.0}, "need a temperature"),
    "factors": ({"bonded_factors": (0, 1, 1), "energy": 1.0}, r"`bonded_factors` must be \(1, 1, 1\)"),
    "bodies": ({"bodies": [dpd.Body(np.arange(4))]}, "rigid bodies are not supported"),
    "twice": ({"bonds": dpd.ReactiveBonds(dpd.HarmonicBonds, HARMONIC, [[0, 1]]), "stays": [[1, 0]]}, "listed twice"),
    "several angles": ({"angle": BEND, "straight": True}, "the same object as their `angle`"),
    "an angle for a dihedral": ({"dihedral": BEND}, "must be one dihedral such as"),
    "angle in equilibrium": ({"angle": BEND, "energy": 1.0}, "in equilibrium cannot have an `angle`"),
    "angle of no kind": ({"angle": dpd.HarmonicAngles([[0, 1, 2], [1, 2, 3]], 1.0, 2.0)}, "must be one angle such as"),
    "broken at the start": ({"angle": BEND, "bonds": STARTED, "broken": STARTED}, "bonds that are there at the start cannot break"),
    "later types": ({"becomes": "AB"}, "the becomes of a bond formation must be two"),
    "later types in an array": ({"becomes": np.array(["B", "A"])}, "the becomes of a bond formation must be two"),
    "no later types": ({"becomes": ()}, "the becomes of a bond formation must be two"),
    "later types in lists": ({"becomes": (["B"], None)}, "there is no bead type"),
    "between in an array": ({"between": np.array([1.0, 2.0])}, "the between of a bond formation must be two"),
    "different later types": ({"types": ("A", "A"), "becomes": ("B", None)}, "which become the same"),
    "unknown later type": ({"becomes": ("C", None)}, "there is no bead type 'C'"),
    "between": ({"between": (1.0, 4.0)}, "a smaller angle and one of pi at most, not 1 and 4"),
    "other mass": ({"becomes": ("B", None)}, "need the masses that the beads have"),
    "types in equilibrium": ({"becomes": (None, None), "energy": 1.0}, "there would be no way back"),
    "pushed": ({"becomes": (None, None), "body_forces": [dpd.BodyForce((1.0, 0, 0), types="A")]}, "beads cannot change their types"),
    "molecules": ({"molecules": [1, 2]}, "`molecules` of a bond formation have one number for each bead"),
    "counted": ({"bonds": dpd.ReactiveBonds(dpd.HarmonicBonds, HARMONIC, counted=[N])}, "`counted` names a bead of 240 that is not there"),
    "segments in equilibrium": ({"energy": 1.0, "segments": dpd.SegmentalRepulsion(1.0)}, "so they cannot be among the `segments`"),
    "other segments": ({"segments": dpd.SegmentalRepulsion(1.0, bonds=[STARTED])}, "none of the `reactions` makes or breaks"),
    "heat": ({"internal": dpd.BeadTemperatures(np.ones(N), np.full(N, 100.0))}, "energies or temperatures of their own"),
}


@pytest.mark.parametrize("counted, message", [([[0, 1]], r"of shape \(K, 1\), not"), ([[0], [1, 2]], "differ in length"), (3, "not int64")])
def test_beads_with_counted_bonds_are_a_list_of_them(counted, message):
    raises(dpd.ParameterError, message, dpd.ReactiveBonds, dpd.HarmonicBonds, HARMONIC, counted=counted)


def test_terms_go_with_the_first_bond_that_breaks():
    """An angle with a long bond, one without, and one of which a bond stays and the other breaks; energies are those of what is left."""
    x = np.random.default_rng(2).random((N, 3)) * EDGE
    x[:6] = [[0, 0, 0], [0.5, 0, 0], [0.5, 1.2, 0], [2, 2, 2], [2.4, 2, 2], [2.4, 2.5, 2]]
    x[6:9] = [[1, 3, 1], [1.5, 3, 1], [1.5, 3, 2.4]]
    bonds = dpd.ReactiveBonds(dpd.HarmonicBonds, {"k": 0.0, "r0": 0.5}, [[0, 1], [1, 2], [3, 4], [4, 5], [7, 8]])
    angles = dpd.HarmonicAngles(np.arange(9).reshape(-1, 3), 7.0, 2.0)
    reaction = dpd.BondBreaking(bonds, beyond=0.9, takes=[angles])
    of = scene([reaction], A=0.0, positions=x, bonds=[dpd.HarmonicBonds([[6, 7]], 0.0, 0.5)], velocities=np.zeros((N, 3)), kT=0.0)
    built = dpd.build(of, dt=1e-6, scheme="mvv", platform="CPU", seed=1)
    simulation = built.simulation()
    energy = lambda pairs: angles.curve(angles.arms(x, of.box)[0])[0][pairs].sum()  # noqa: E731
    assert np.isclose(state(simulation)[2], energy([0, 1, 2]), rtol=1e-6)
    simulation.step(1)
    assert bonds_in(simulation, built) == {(0, 1), (3, 4), (4, 5)}
    assert np.isclose(state(simulation)[2], energy([1]), rtol=1e-6)
    sample = dpd.Observer(built).sample(simulation.context)
    assert np.isclose(sample.angle, energy([1]), rtol=1e-6)
    assert "takes = ['HarmonicAngles']" in str(reaction)
    uneven = dpd.HarmonicAngles([[0, 1, 2], [3, 4, 5]], [1.0, 2.0], 2.0)
    raises(dpd.ParameterError, "of equal coefficients", replace, reaction, takes=[uneven])
    far = replace(reaction, takes=[dpd.HarmonicAngles([[0, 1, N]], 1.0, 2.0)])
    raises(dpd.ParameterError, "name a bead that is not there", scene, [far])
    again = dpd.BondFormation(bonds, ("A", "B"), within=0.7, valences=2)
    raises(dpd.ParameterError, "made again cannot take terms", scene, [again, reaction], bonds=[])


@pytest.mark.parametrize("name", WRONG)
def test_what_cannot_be_is_refused(name):
    changes, message = WRONG[name]
    arguments = {"bonds": _sort(), "types": ("A", "B"), "within": 0.6, "valences": 1, **changes}
    others = {
        key: arguments.pop(key) for key in ("kT", "bonded_factors", "bodies", "internal", "body_forces", "segments") if key in arguments
    }
    if name == "heat":
        others["pairs"] = {("*", "*"): dpd.EDPD(A=25.0, gamma=4.5, kappa=0.1, cutoff=1.0)}
    stays = arguments.pop("stays", None)
    others |= {} if stays is None else {"bonds": [dpd.HarmonicBonds(stays, **HARMONIC)]}
    broken, straight = arguments.pop("broken", None), arguments.pop("straight", None)

    def made():
        more = [] if broken is None else [dpd.BondBreaking(broken, beyond=1.0)]
        more += [] if straight is None else [dpd.BondFormation(_sort(), ("A", "A"), 0.6, 1)]
        return scene([dpd.BondFormation(**arguments), *more], **others)

    raises(dpd.ParameterError, message, made)


def test_what_does_not_do_whole_steps_is_refused():
    raises(dpd.ParameterError, "no class|must be a class", dpd.ReactiveBonds, dpd.DPD, {})
    raises(dpd.ParameterError, "has the coefficients k, r0", dpd.ReactiveBonds, dpd.HarmonicBonds, {"k": 1.0})
    raises(dpd.ParameterError, "either|needs a length", dpd.BondBreaking, _sort())
    raises(dpd.ParameterError, "reactions must be a sequence of BondFormation or BondBreaking", scene, [_sort()])
    for given, message in (
        ({"loop": False}, "switched off"),
        ({"platform": "OpenCL"}, "OpenCL"),
        ({"conservative": "openmm"}, "need whole steps"),
        ({"scheme": "native"}, "need whole steps"),
    ):
        raises(dpd.PlanError, message, lambda given=given: dpd.make_plan(scene(both()), **{"dt": 0.04, "platform": "CPU"} | given))
    built = dpd.build(scene(both()), dt=0.04, platform="CPU")
    compound = openmm.CompoundIntegrator()
    compound.addIntegrator(built.integrator)
    context = openmm.Context(built.system, compound, openmm.Platform.getPlatformByName("CPU"))
    context.setPositions(built.positions)
    raises(openmm.OpenMMException, "bonds form and break", compound.step, 1)


@pytest.mark.slow
def test_a_million_bonds_made_and_broken_lose_none():
    """Bonds in equilibrium among 2,000 ideal beads with two valences, each trial a third of them."""
    sort = _sort(k=2.0, r0=0.5)
    reaction = dpd.BondFormation(sort, ("A", "B"), within=1.0, valences=(2, 3), energy=0.5, every=2)
    built = dpd.build(scene([reaction], n=2000, edge=8.7, A=0.0), dt=0.05, platform="CPU", seed=4)
    simulation = built.simulation()
    while (found := dpd.read_reacted(simulation.context, built.plan))[0, :2].sum() < 1_000_000:
        simulation.step(200)
    table = dpd.read_fields(simulation.context, built.plan)["bonds"]
    bonds = dpd.read_bonds(simulation.context, built.plan)
    assert len(bonds) == found[0, 0] - found[0, 1] == np.count_nonzero(table) // 2
    counts = np.bincount(bonds[:, :2].ravel(), minlength=2000)
    assert counts[::2].max() == 2
    assert counts[1::2].max() == 3
    assert len(np.unique(bonds[:, :2], axis=0)) == len(bonds)


def dimers_in_theory(n: int, weight: float) -> float:
    """Mean number of pairs of n beads of either type, if one of k pairs more has this weight times the ways to choose the beads."""
    k = np.arange(n + 1)
    lg = gammaln(k + 1)
    logs = 2 * (lg[n] - lg[k] - lg[n - k]) + lg[k] + k * np.log(weight)
    return float(np.average(k, weights=np.exp(logs - logs.max())))


@pytest.mark.slow
@any_seed(3)
def test_dimers_and_their_lifetimes_are_those_of_theory(seed):
    """Ideal beads: the weight of a dimer is the integral of exp(-(U - energy)/kT) over all distances, over the volume.  A bond of the
    length r breaks at a trial with the chance that it is chosen, times that of no bond.  The test detects errors of 1 % and 2 %."""
    n, edge, k, r0, energy, rate, every, dt = 200, 6.0, 5.0, 0.5, 1.0, 1.0, 5, 0.05
    reaction = dpd.BondFormation(_sort(k, r0), ("A", "B"), within=1.0, valences=1, energy=energy, rate=rate, every=every)
    masses = {"A": 1.0, "B": 1.0}
    built = dpd.build(scene([reaction], n=2 * n, edge=edge, A=0.0, seed=seed, masses=masses), dt=dt, platform="CPU", seed=seed)
    simulation = built.simulation()
    simulation.step(1000)
    before, found = dpd.read_reacted(simulation.context, built.plan)[0, 1], []
    for _ in range(500):
        simulation.step(20)
        found.append(len(dpd.read_bonds(simulation.context, built.plan)))
    broken = dpd.read_reacted(simulation.context, built.plan)[0, 1] - before
    r = np.linspace(1e-6, edge / 2, 20_001)
    weight = 4 * np.pi * r**2 * np.exp(energy - k * (r - r0) ** 2)
    judge(found, dimers_in_theory(n, np.trapezoid(weight, r) / edge**3), error=0.5)
    breaks = -np.expm1(-rate * every * dt) / (1 + np.exp(energy - k * (r - r0) ** 2)) * (r < 1.0)
    lifetime = every * dt * weight.sum() / (weight @ breaks)
    assert 500 * 20 * dt * np.mean(found) / broken == pytest.approx(lifetime, rel=0.02)
