"""Height spectra and bending moduli of planted surfaces."""

import mdtraj
import numpy as np
import pytest
from cases import raises
from openmm import unit

from openmm_dpd import ParameterError
from openmm_dpd.analysis import HeightSpectrum, bending_modulus, height_spectrum
from openmm_dpd.trajectory import bead_element

KAPPA, TENSION, KT = 12.0, 0.8, 1.3


def topology_of(lipids: int) -> mdtraj.Topology:
    """Lipids HTT, head first, with bonds."""
    topology = mdtraj.Topology()
    chain = topology.add_chain()
    for _ in range(lipids):
        residue = topology.add_residue("HTT", chain)
        atoms = [topology.add_atom(name, bead_element(name, 1.0), residue) for name in "HTT"]
        topology.add_bond(atoms[0], atoms[1])
        topology.add_bond(atoms[1], atoms[2])
    return topology


def membrane(seed: int, frames: int, edges, *, lipids: int = 200, scatter: float = 0.0, most: int = 6, breathe: float = 0.0):
    """A bilayer with the waves of Helfrich's theory up to n = ``most``, the amplitude of each in each frame, and its lipids anywhere.

    Independent frames; the bilayer drifts across the boundary, heads are 1.5 from the middle surface and scatter around it.
    """
    rng = np.random.default_rng(seed)
    n = np.array([(i, j) for i in range(-most, most + 1) for j in range(-most, most + 1) if i > 0 or (i == 0 and j > 0)]).reshape(-1, 2)
    n = n[np.hypot(*n.T) <= most]
    positions, boxes, amplitudes = [], [], []
    for k in range(frames):
        stretch = 1 + breathe * rng.normal()
        box = np.array(edges) * [stretch, stretch, 1 / stretch**2]
        q = np.linalg.norm(2 * np.pi * n / box[:2], axis=1)
        deviation = np.sqrt(KT / (KAPPA * q**4 + TENSION * q**2) / (box[0] * box[1]) / 2)
        h = deviation * (rng.normal(size=len(q)) + 1j * rng.normal(size=len(q)))
        place = rng.random((lipids, 2))
        phase = 2 * np.pi * place @ n.T
        surface = 2 * (np.cos(phase) @ h.real - np.sin(phase) @ h.imag)
        side = np.where(np.arange(lipids) % 2, 1.0, -1.0)
        x = np.empty((lipids, 3, 3))
        x[:, :, :2] = (place * box[:2])[:, None]
        x[:, :, 2] = (surface + scatter * rng.normal(size=lipids) + 0.31 * k)[:, None] + side[:, None] * [1.5, 1.0, 0.5]
        positions.append(np.mod(x.reshape(-1, 3), box))
        boxes.append(np.diag(box))
        amplitudes.append(np.abs(h) ** 2 * box[0] * box[1])
    trajectory = mdtraj.Trajectory(np.array(positions), topology_of(lipids))
    trajectory.unitcell_vectors = np.array(boxes, dtype=np.float32)
    return trajectory, n, np.array(amplitudes)


def test_planted_waves_are_found_to_the_last_digit():
    """No scatter, all waves fitted: |h_q|^2 of each wave number is what was planted, also where the boundary cuts through lipids."""
    edges = (14.0, 11.0, 9.0)
    trajectory, n, planted = membrane(1, 5, edges, most=2, lipids=120)
    q = np.linalg.norm(2 * np.pi * n / edges[:2], axis=1)
    found = height_spectrum((trajectory[k : k + 2] for k in range(0, 5, 2)), "H", "T", q_max=q.max())
    assert len(found.q) == len(q) + 2 and np.all(np.diff(found.q) >= 0) and found.q[-1] == pytest.approx(q.max())
    for value in found.q:
        mine, theirs = (np.isclose(numbers, value, rtol=1e-4) for numbers in (found.q, q))
        # (2, 1) and (2, -1) are below q_max and were not planted
        np.testing.assert_allclose(found.power[:, mine].sum(axis=1), planted[:, theirs].sum(axis=1), rtol=1e-4, atol=1e-6)
    assert found.noise.max() < 1e-6


@pytest.mark.parametrize("scatter", [0.0, 0.5])
def test_planted_moduli_are_found(scatter):
    """Within 4 standard errors, which are those of the Fisher information, with waves beyond q_max and lipids that stick out."""
    frames, q_max = 400, 1.3
    trajectory, _, _ = membrane(2, frames, (14.0, 14.0, 9.0), lipids=240, scatter=scatter, breathe=0.01)
    spectrum = height_spectrum(trajectory, "H", "T", q_max=q_max)
    found = bending_modulus(spectrum, KT)
    x = np.array([spectrum.q**4, spectrum.q**2]) / KT
    stiffness = np.array([KAPPA, TENSION]) @ x
    errors = np.sqrt(np.diag(np.linalg.inv(frames * (x / (stiffness + stiffness**2 * spectrum.noise) ** 2) @ x.T)))
    assert abs(found.kappa.mean - KAPPA) < 4 * found.kappa.sem
    assert abs(found.tension.mean - TENSION) < 4 * found.tension.sem
    # errors of errors: 25 blocks or more, the largest of several lengths of them
    assert 0.75 * errors[0] < found.kappa.sem < 1.5 * errors[0] and 0.75 * errors[1] < found.tension.sem < 1.5 * errors[1]
    assert found.kappa.converged and found.kappa.sem < 0.1 * KAPPA
    fixed = bending_modulus(spectrum, KT, tension=TENSION)
    assert abs(fixed.kappa.mean - KAPPA) < 4 * fixed.kappa.sem < 4 * found.kappa.sem
    assert fixed.tension.mean == TENSION and fixed.tension.sem is None
    assert np.abs((spectrum.curve.y - found(spectrum.q)) / spectrum.curve.sem).max() < 4


def slow_waves(frames: int, seed: int) -> HeightSpectrum:
    """Ornstein-Uhlenbeck waves of a box of 14: squares forget in 20 frames for the longest, faster by q^2.7 for others, as in a bilayer."""
    rng, longest = np.random.default_rng(seed), 2 * np.pi / 14
    n = np.array([(i, j) for i in range(-3, 4) for j in range(-3, 4) if (i > 0 or (i == 0 and j > 0)) and np.hypot(i, j) <= 3.4])
    q = longest * np.hypot(*n.T)
    kept = np.exp(-0.5 / (20 * (q / longest) ** -2.7))[:, None]
    h = rng.normal(size=(len(q), 2))
    power = np.empty((frames, len(q)))
    for k in range(frames):
        h = kept * h + np.sqrt(1 - kept**2) * rng.normal(size=h.shape)
        power[k] = np.sum(h**2, axis=1) / 2
    return HeightSpectrum(q, power * KT / (KAPPA * q**4 + TENSION * q**2), np.zeros(len(q)))


@pytest.mark.slow
def test_errors_from_correlated_frames():
    """The scatter over 80 runs, known to 8 %, is what the errors say where runs are long enough; short ones are reported."""
    fits = [bending_modulus(slow_waves(1500, seed), KT, tension=TENSION).kappa for seed in range(80)]
    scatter, errors = np.std([fit.mean for fit in fits], ddof=1), np.sqrt(np.mean([fit.sem**2 for fit in fits]))
    assert 0.8 < scatter / errors < 1.25 and abs(np.mean([fit.mean for fit in fits]) - KAPPA) < 4 * scatter / 80**0.5
    assert np.mean([fit.converged for fit in fits]) > 0.8
    assert not any(bending_modulus(slow_waves(400, seed), KT).kappa.converged for seed in range(20))


def test_scatter_is_taken_off():
    """A flat bilayer of lipids that stick out at random has no waves: every power is 0 within its error, and some are negative."""
    trajectory, _, _ = membrane(3, 500, (14.0, 14.0, 9.0), scatter=0.5, most=0)
    curve = height_spectrum(trajectory, "H", "T", q_max=1.0).curve
    assert np.all(np.abs(curve.y) < 4 * curve.sem)
    assert 196 * 0.5**2 / 200 > 10 * curve.sem.max()  # what a lipid's scatter alone would be taken for: A s^2/N


def test_any_axis_and_lipids_without_bonds():
    trajectory, _, _ = membrane(4, 3, (14.0, 13.0, 9.0), most=2)
    wanted = height_spectrum(trajectory, "H", "T", q_max=1.0)
    turned = mdtraj.Trajectory(trajectory.xyz[:, :, [2, 0, 1]], trajectory.topology)
    turned.unitcell_vectors = np.array([box[np.ix_([2, 0, 1], [2, 0, 1])] for box in trajectory.unitcell_vectors])
    assert np.allclose(height_spectrum(turned, "H", "T", q_max=1.0, axis="x").power, wanted.power, rtol=1e-3, atol=1e-5)
    topology = trajectory.topology.copy()
    topology._bonds = []
    again = height_spectrum(mdtraj.Trajectory(trajectory.xyz, topology, None, *box_of(trajectory)), "H", "T", q_max=1 / unit.nanometer)
    assert np.array_equal(again.power, wanted.power)


def box_of(trajectory: mdtraj.Trajectory):
    return trajectory.unitcell_lengths, trajectory.unitcell_angles


def test_a_hexagonal_box():
    """Edges a, b at 60 degrees: the shortest waves are three, of wave number 4 pi/(sqrt 3 a)."""
    trajectory, _, _ = membrane(5, 2, (14.0, 14.0, 9.0), most=1)
    box = np.array([[14, 0, 0], [7, 7 * 3**0.5, 0], [0, 0, 9.0]])
    hexagonal = mdtraj.Trajectory(trajectory.xyz / 14 @ np.diag([1, 1, 14 / 9]) @ box, trajectory.topology)
    hexagonal.unitcell_vectors = np.array([box] * 2, dtype=np.float32)
    assert np.allclose(height_spectrum(hexagonal, "H", "T", q_max=0.6).q, [4 * np.pi / (3**0.5 * 14)] * 3)


def test_powers_of_an_exact_spectrum_give_the_modulus_exactly():
    q = np.linspace(0.3, 1.2, 9)
    for kappa, tension in ((12.0, 0.8), (5.0, -0.1), (40.0, 0.0)):
        spectrum = HeightSpectrum(q, np.tile(KT / (kappa * q**4 + tension * q**2), (10, 1)), np.zeros(9))
        found = bending_modulus(spectrum, KT * unit.kilojoule_per_mole)
        assert (found.kappa.mean, found.tension.mean) == pytest.approx((kappa, tension), rel=1e-6, abs=1e-6)
        assert bending_modulus(spectrum, KT, tension=tension, q_max=0.5).kappa.mean == pytest.approx(kappa, rel=1e-6)
        bar_nm = tension * 1e25 / 6.02214076e23 * unit.bar * unit.nanometer
        assert bending_modulus(spectrum, KT, tension=bar_nm).kappa.mean == pytest.approx(kappa, rel=1e-6)


def test_bad_spectra():
    trajectory, _, _ = membrane(6, 2, (14.0, 14.0, 9.0), most=1)
    tilted = mdtraj.Trajectory(trajectory.xyz, trajectory.topology)
    tilted.unitcell_vectors = np.array([[[14, 0, 0], [0, 14, 0], [2, 0, 9.0]]] * 2)
    headless = np.arange(3, trajectory.n_atoms, 3)
    spectrum = height_spectrum(trajectory, "H", "T", q_max=1.0)
    for call, message in (
        (lambda: height_spectrum(trajectory, "H", "T", q_max=0.4), "shortest wave vector.*0.448"),
        (lambda: height_spectrum(trajectory, "H", "T", q_max=3.0), "100 lipids does not determine"),
        (lambda: height_spectrum(trajectory, "H", "T", q_max=1 * unit.nanometer), "q_max has the unit"),
        (lambda: height_spectrum(trajectory, headless, "T", q_max=1.0), "bead 0 has only heads or only tails"),
        (lambda: height_spectrum(tilted, "H", "T", q_max=1.0), "edge z of the box must be normal"),
        (lambda: bending_modulus(spectrum.power, KT), "height_spectrum"),
        (lambda: bending_modulus(spectrum, 0.0), "kT must be above 0"),
        (lambda: bending_modulus(spectrum, KT, q_max=0.45), "2 unknowns need"),
        (lambda: bending_modulus(spectrum, KT, q_max=0.4, tension=0), "1 unknowns need"),
        (lambda: bending_modulus(spectrum, KT, tension=1 * unit.bar), "surface tension has the unit bar"),
        (lambda: bending_modulus(HeightSpectrum(spectrum.q, -np.abs(spectrum.power), spectrum.noise), KT), "not positive"),
    ):
        raises(ParameterError, message, call)
