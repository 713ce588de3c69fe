"""Frozen layers behind walls of any shape: their beads, their friction, what is refused."""

import numpy as np
import pytest

import openmm_dpd as dpd
from openmm_dpd.molecules import frozen_layer
from openmm_dpd.shapes import Complement, Cylinder, SolidWall

EDGES = np.array([5.0, 5.0, 3.0])
PIPE = SolidWall(Complement(Cylinder((2.5, 2.5, 0), "z", 1.4)), spin=(0, 0, 1.0), centre=(2.5, 2.5, 0))
PAIR = dpd.DPD(A=25, gamma=4.5)


def fluid(pairs, **options) -> dpd.Scene:
    x = np.random.default_rng(1).random((225, 3)) * EDGES
    types, masses = ["A"] * 150 + ["B"] * 75, {"A": 1.0, "B": 4.0, "B_wall": 1.0}
    return dpd.Scene(**{"masses": masses, "types": types, "positions": x, "pairs": pairs, "kT": 1.0, "box": EDGES} | options)


def test_frozen_beads_hold_the_fluid_and_turn_with_their_wall():
    stiff = dpd.DPD(A=78, gamma=30, gamma_perp=3)
    made = frozen_layer(fluid({("*", "*"): PAIR, ("B", "B"): stiff, ("A", "B_wall"): dpd.NONE}), [PIPE], dt=0.02, steps=10, seed=1)
    n = int(made.mobile.sum())
    assert set(made.types[:n]) == {"A", "B"} and set(made.types[n:]) == {"A_wall", "B_wall_"}
    table = made.tables[0].resolve(made.type_names)
    assert table["A", "A"] == PAIR and table["B", "B"] == stiff and table["A_wall", "B_wall_"] is dpd.NONE
    assert (table["A", "A_wall"].A, table["A", "A_wall"].gamma) == (25, 50.0)
    assert table["B", "A_wall"].gamma == 100.0 and table["A", "B_wall_"].gamma == 50.0  # by the mass of the bead that moves
    held = table["B", "B_wall_"]
    assert np.allclose([held.gamma, held.gamma_perp], np.array([30, 3]) * (1 + 25 / 78))
    for A, more, gamma in (25, 2.0, 50 * 2**-1.75), (78, 2.0, 14.0), (78, 1.0, 1250 / 78):  # denser fluids need less
        x = np.random.default_rng(1).random((round(225 * more), 3)) * EDGES
        dense = dpd.Scene({"A": 1.0}, ["A"] * len(x), x, {("A", "A"): dpd.DPD(A=A, gamma=4.5)}, kT=1.0, box=EDGES)
        dense = frozen_layer(dense, [PIPE], dt=0.02, steps=0, seed=1)
        assert np.isclose(dense.tables[0].resolve(dense.type_names)["A", "A_wall"].gamma, gamma, rtol=1e-12)
    r = np.hypot(*(made.positions[n:, :2] - 2.5).T)
    assert r.min() > 1.39 and r.max() < 2.41
    simulation = dpd.build(made, dt=0.02, seed=1, platform="CPU").simulation()
    simulation.step(10)
    x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value[n:, :2] - 2.5
    start = (made.positions[n:, :2] - 2.5) @ [1, 1j]
    assert np.allclose(x @ [1, 1j], start * np.exp(0.2j), rtol=0, atol=1e-12)


def test_types_are_those_that_are_given_or_known():
    for pairs, reason in (
        ({("*", "*"): dpd.DPD(A=25, sigma=3)}, "give gamma"),
        ([{("*", "*"): PAIR}, {("A", "A"): PAIR}], "several tables"),
    ):
        with pytest.raises(dpd.ParameterError, match=f"against slip is not known, as .*{reason}"):
            frozen_layer(fluid(pairs), [PIPE], dt=0.02, steps=0)
    made = frozen_layer(fluid({("*", "*"): dpd.DPD(A=25, sigma=3)}), [PIPE], dt=0.02, steps=0, types={"B": "B_wall"})
    assert set(made.types[int(made.mobile.sum()) :]) == {"A", "B_wall"}
    for types, reason in ({"C": "A"}, "no beads are of the type 'C'"), ("A", "types must be a mapping"):
        with pytest.raises(dpd.ParameterError, match=reason):
            frozen_layer(fluid({("*", "*"): PAIR}), [PIPE], dt=0.02, types=types)


@pytest.mark.slow
def test_a_layer_that_turns_into_its_images_is_refused_where_it_is_made():
    wide = SolidWall(Complement(Cylinder((2.5, 2.5, 0), "z", 1.9)), spin=(0, 0, 1.0), centre=(2.5, 2.5, 0))
    with pytest.raises(dpd.ParameterError, match="leave room for a layer of 1 nm behind it, in a wider box"):
        frozen_layer(fluid({("*", "*"): PAIR}), [wide], dt=0.02, steps=0, seed=1)
