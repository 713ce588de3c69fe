"""Steps for bonds, angles and dihedrals: what a word does to a harmonic mode, and the modes of a scene."""

import numpy as np
import pytest
from cases import cases

import openmm_dpd as dpd
from openmm_dpd.advice.bonded_modes import bonded_modes, largest_stable, mode_errors, tabulated_errors, why_no_step
from openmm_dpd.model.schemes import SCHEMES, scheme_of

BAB3 = "3B/25 3A/10 19B/50 2A/5 19B/50 3A/10 3B/25 O"  # McLachlan's order with three forces.


# -- a mode under a word ---------------------------------------------------------------------------------------------------------
def run(word: str, theta: float, x: float, steps: int = 600, copies: int = 2000) -> tuple[float, float]:
    """The same by a simulation of many modes: averages of (omega x)^2 and v^2 over the second half."""
    rng = np.random.default_rng(5)
    at, v, found = rng.normal(size=copies), rng.normal(size=copies), []
    for step in range(steps):
        for letter, part in scheme_of(word).letters:
            part = float(part)
            if letter == "A":
                at += part * theta * v
            elif letter == "B":
                v -= part * theta * at
            else:
                q = np.exp(-x * part) if letter == "O" else (1 - x * part / 2) / (1 + x * part / 2)
                v = q * v + (1 - q * q) ** 0.5 * rng.normal(size=copies)
        if step >= steps // 2:
            found.append((np.mean(at**2), np.mean(v**2)))
    return tuple(np.mean(found, axis=0) - 1)


@pytest.mark.parametrize(("word", "theta"), [("shardlow", 0.8), ("middle", 1.5), ("aboba", 0.8), ("bababo", 1.8), (BAB3, 2.4)])
def test_errors_of_a_mode_are_those_of_a_run(word, theta):
    """Friction a fifth of the step's inverse, ten times that of the recipe: the errors of these words do not depend on it."""
    measured, (conf, kin) = run(word, theta, 0.2), mode_errors(scheme_of(word), np.array([theta]))
    # 2,000 copies over 300 steps, correlated over some ten
    assert measured == pytest.approx((conf[0], kin[0]), abs=4 * (2 / (2000 * 30)) ** 0.5)


def test_velocity_verlet_in_closed_form():
    theta = np.array([0.1, 0.5, 1.0, 1.9])
    conf, kin = mode_errors(SCHEMES["mvv"], theta)
    assert conf == pytest.approx(1 / (1 - theta**2 / 4) - 1, rel=1e-6)
    assert kin == pytest.approx(np.zeros(4), abs=1e-9)
    assert np.isinf(mode_errors(SCHEMES["mvv"], np.array([2.01]))[0]).all()


@cases("word, limits, stable", ("middle", (2.0, 2.0), 2.0), ("bababo", (1.40, 1.47), 2.59), (BAB3, (2.13, 2.23), 2.97))
def test_known_limits(word, limits, stable):
    """Where the error is 0.5 and 1 %, from an independent evaluation."""
    scheme = scheme_of(word)
    theta = np.linspace(0.01, largest_stable(scheme), 4000)
    conf, kin = tabulated_errors(scheme, theta)
    worst = np.maximum(np.abs(conf), np.abs(kin))
    for level, limit in zip((0.005, 0.01), limits, strict=True):
        beyond = np.flatnonzero(worst > level)
        assert (theta[beyond[0]] if len(beyond) else theta[-1]) == pytest.approx(limit, abs=0.02)
    assert largest_stable(scheme) == pytest.approx(stable, abs=0.02)


# -- modes of a scene ------------------------------------------------------------------------------------------------------------
def scene(n: int = 60, **more) -> dpd.Scene:
    """Beads in a row, 0.5 apart, in a long box."""
    x = np.zeros((n, 3))
    x[:, 0] = 0.5 * np.arange(n)
    x = more.pop("positions", x)
    masses = more.pop("bead_masses", np.ones(n))
    return dpd.Scene({"W": 1.0}, ["W"] * n, x, {("W", "W"): dpd.DPD(A=25, gamma=4.5)}, kT=1.0, box=[100.0] * 3, bead_masses=masses, **more)


def row(n: int, width: int) -> np.ndarray:
    return np.stack([np.arange(k, n - width + 1 + k) for k in range(width)], axis=1)


def hessian_frequencies(built_scene: dpd.Scene, along: int) -> np.ndarray:
    """Frequencies along one axis, from second differences of the energy of the model."""
    n, h, x = built_scene.n_beads, 1e-4, built_scene.positions

    def energy(moved: np.ndarray) -> float:
        bonds = sum(np.sum(b.curve(b.lengths(moved, None))[0]) for b in built_scene.bonds)
        bends = sum(np.sum(a.curve(a.arms(moved, None)[0])[0]) for a in built_scene.angles)
        return bonds + bends + sum(np.sum(d.curve(d.gradients(moved, None)[0])[0]) for d in built_scene.dihedrals)

    def displaced(*beads: tuple[int, float]) -> np.ndarray:
        moved = x.copy()
        for bead, by in beads:
            moved[bead, along] += by
        return moved

    matrix = np.zeros((n, n))
    for i in range(n):
        for j in range(max(i - 3, 0), i + 1):
            four = [energy(displaced((i, a * h), (j, b * h))) * a * b for a in (1, -1) for b in (1, -1)]
            matrix[i, j] = matrix[j, i] = sum(four) / (4 * h * h)
    root = built_scene.bead_masses**-0.5
    return np.sqrt(np.maximum(np.linalg.eigvalsh(root[:, None] * matrix * root), 0.0))


@pytest.mark.parametrize("masses", [np.ones(24), np.tile([1.0, 3.0], 12)], ids=["alike", "1:3"])
@pytest.mark.parametrize("what", ["bonds", "angles"])
def test_frequencies_of_a_straight_chain(what, masses):
    """Against second differences of the energy; at this stiffness the mean length of a bend's arms is off by a few per mille."""
    angles = [dpd.HarmonicAngles(row(24, 3), 40.0, np.pi)] if what == "angles" else []
    chain = scene(24, bonds=[dpd.HarmonicBonds(row(24, 2), 4e4, 0.5)], angles=angles, bead_masses=masses)
    modes = bonded_modes(chain)[-1]
    expected = hessian_frequencies(chain, 0 if what == "bonds" else 1)
    assert modes.what == what
    assert np.sort(modes.omega)[-10:] == pytest.approx(expected[-10:], rel=1e-3)
    assert modes.fastest >= expected[-1] * (1 - 1e-3)


@pytest.mark.parametrize("masses", [np.ones(24), np.tile([1.0, 3.0], 12)], ids=["alike", "1:3"])
def test_frequencies_of_a_trans_chain(masses):
    """A zigzag of bonds and angles that hardly move; across the plane only dihedrals act."""
    theta = 1.9
    zigzag = np.stack([0.5 * np.sin(theta / 2) * np.arange(24), 0.5 * np.cos(theta / 2) * (np.arange(24) % 2), np.zeros(24)], axis=1)
    held = dict(bonds=[dpd.HarmonicBonds(row(24, 2), 4e4, 0.5)], angles=[dpd.HarmonicAngles(row(24, 3), 4e4, theta)])
    chain = scene(24, positions=zigzag, dihedrals=[dpd.HarmonicDihedrals(row(24, 4), 400.0, 1, 1)], bead_masses=masses, **held)
    modes = bonded_modes(chain)[-1]
    expected = hessian_frequencies(chain, 2)
    assert modes.what == "dihedrals"
    assert np.sort(modes.omega)[-10:] == pytest.approx(expected[-10:], rel=2e-3)
    assert modes.fastest >= expected[-1] * (1 - 2e-3)


def test_frequency_of_a_cis_dihedral():
    """Four beads in a plane, both ends on one side: beads in the middle move more."""
    theta = 1.9
    end = 0.5 * np.array([np.cos(theta), np.sin(theta), 0.0])
    x = np.array([end, [0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5 - end[0], end[1], 0.0]])
    held = dict(bonds=[dpd.HarmonicBonds(row(4, 2), 4e4, 0.5)], angles=[dpd.HarmonicAngles(row(4, 3), 4e4, theta)])
    chain = scene(4, positions=x, dihedrals=[dpd.HarmonicDihedrals(row(4, 4), 400.0, -1, 1)], **held)
    assert bonded_modes(chain)[-1].omega == pytest.approx(hessian_frequencies(chain, 2)[-1:], rel=2e-3)


def test_dihedrals_whose_beads_come_into_line_have_no_step():
    """Slopes go with 1/sin of the angles: the softer these are, the shorter the step, and none where they may be straight."""

    def found(*angles) -> dpd.Scene:
        quads = [dpd.OPLSDihedrals(row(60, 4), 0.0, 0.0, 12.0, 0.0)]
        return scene(bonds=[dpd.HarmonicBonds(row(60, 2), 100.0, 0.5)], angles=angles, dihedrals=quads)

    chains = [found(dpd.HarmonicAngles(row(60, 3), k, 1.9), dpd.CosineAngles([], 1.0)) for k in (500.0, 20.0)]
    stiff, soft = (bonded_modes(chain)[-1].step(SCHEMES["bababo"], 0.01) for chain in chains)
    assert stiff > 1.02 * soft > 0
    half = dpd.HarmonicAngles(row(60, 3)[:30], 50.0, 1.9)
    for open_scene, beads in (
        (found(), "beads 0, 1 and 2 "),
        (found(half), "beads 30, 31 and 32 "),
        (found(dpd.HarmonicAngles(row(60, 3), 5.0, 1.9)), "beads 0, 1 and 2 "),
        (found(dpd.CosineAngles(row(60, 3), 200.0)), "beads 0, 1 and 2 "),
    ):
        assert why_no_step(open_scene).startswith(f"no angle keeps the {beads}")
        assert "dihedrals" not in {modes.what for modes in bonded_modes(open_scene)}
    assert bonded_modes(scene(dihedrals=[dpd.OPLSDihedrals(row(60, 4), 0.0, 0.0, 0.0, 0.0)])) == []


def test_other_bonds_and_bound_beads_count():
    """A single bond, one whose other bead is held, and two softer ones."""
    bonds = [dpd.HarmonicBonds([[0, 1]], 50.0, 0.5), dpd.HarmonicBonds([[10, 11], [12, 13]], 5.0, 0.5)]
    assert bonded_modes(scene(bonds=bonds))[0].omega == pytest.approx([200**0.5])
    assert bonded_modes(scene(bonds=bonds, mobile=np.arange(60) != 0))[0].omega == pytest.approx([100**0.5])
    assert bonded_modes(scene(bonds=[dpd.HarmonicBonds([[0, 1]], 0.0, 0.5)])) == []
    assert bonded_modes(scene()) == []


@cases("bonds, lowest, highest", (dpd.FENEBonds([[0, 1]], 30.0, 1.5), 0.85, 1.5), (dpd.FENEBonds([[0, 1]], 30.0, 1.5, 1.0, 1.0), 0.2, 3.0), (dpd.MorseBonds([[0, 1]], 50.0, 8.0, 0.5), 0.2, 2.0))  # fmt: skip
def test_thermal_curvature_of_bonds(bonds, lowest, highest):
    """Mean curvature against a Monte Carlo chain; it varies over the thermal range, and the stiffest point is beyond every part."""
    (modes,) = bonded_modes(scene(bonds=[bonds]))
    rng, r, found = np.random.default_rng(3), 0.9 if isinstance(bonds, dpd.FENEBonds) else 0.5, []

    def log_weight(length: float) -> float:
        return 2 * np.log(length) - float(bonds.curve(np.array([length]))[0][0])

    for _ in range(12000):
        trial = r + rng.normal() * 0.06
        inside = 0 < trial < (1.5 if isinstance(bonds, dpd.FENEBonds) else 0.75)
        if inside and np.log(rng.random()) < log_weight(trial) - log_weight(r):
            r = trial
        found.append(float(bonds.curve(np.array([r]))[2][0]))
    assert modes.omega[0] ** 2 / 2 == pytest.approx(np.mean(found), rel=0.12)
    assert lowest < modes.fluctuation.min() < 1 < modes.fluctuation.max() < highest
    assert modes.fastest**2 / 2 > modes.fluctuation.max() * np.mean(found) * 0.9


def test_steps_of_chains():
    """k = 100: a chain of these stays within 1 % with bababo at 0.05 and is 1 % off at 0.06 when it is run; velocity Verlet at 0.0082."""
    (modes,) = bonded_modes(scene(bonds=[dpd.HarmonicBonds(row(60, 2), 100.0, 0.5)]))
    assert 0.05 < modes.step(SCHEMES["bababo"], 0.01) < 0.062
    assert modes.step(SCHEMES["mvv"], 0.01) == pytest.approx(0.2 / 300**0.5 / 2**0.5, rel=0.03)
    for scheme in SCHEMES.values():
        step = modes.step(scheme, 0.01)
        at, beyond = (modes.errors(scheme, np.array([dt])) for dt in (step, 1.02 * step))
        assert max(abs(float(off[0])) for off in at) <= 0.01
        assert max(abs(float(off[0])) for off in beyond) > 0.0099


def test_a_scheme_that_is_exact_for_springs_keeps_away_from_its_limit_with_others():
    """`middle`: measured errors at 0.7 of the largest stable step are 5 % with angles."""
    ((springs,), (*_, bends)) = (
        bonded_modes(scene(bonds=[dpd.HarmonicBonds(row(60, 2), 100.0, 0.5)], angles=angles)) for angles in ([], [dpd.HarmonicAngles(row(60, 3), 50.0, np.pi)])
    )  # fmt: skip
    assert springs.step(SCHEMES["middle"], 0.01) * springs.fastest == pytest.approx(1.4, rel=1e-3)
    assert bends.step(SCHEMES["middle"], 0.01) * bends.fastest == pytest.approx(0.8, rel=1e-3)
    assert bends.step(SCHEMES["bababo"], 0.01) * bends.fastest > 1.4
