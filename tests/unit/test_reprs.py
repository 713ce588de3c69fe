"""What a notebook shows of an object is one line with counts, at any size."""

import numpy as np

import openmm_dpd as dpd
from openmm_dpd.analysis import VelocityProfile
from openmm_dpd.base.errors import what_is
from openmm_dpd.molecules import Spring, linear, pack, star

SPRING = Spring(k=2.0, r0=0.0)
SCENE = pack({linear("A6B4", SPRING): 20}, box=[5.0] * 3, density=3.0, seed=1).scene(pairs={("*", "*"): dpd.DPD(A=25.0, gamma=4.5)}, kT=1.0)
BUILT = dpd.build(SCENE, dt=0.02, platform="Reference", seed=1)
SLABS = np.zeros(500)
SHOWN = {
    "scene": (SCENE, ("375 beads (A 120, B 80, W 175)", "5 x 5 x 5 nm", "3 beads/nm^3", "180 bonds", "kT = 1 kJ/mol")),
    "built": (BUILT, ("BuiltSystem", "Reference", "middle", "dt = 0.02", "375 beads")),
    "plan": (BUILT.plan, ("Plan", "375 beads")),
    "molecule": (star("C", ["A8"] * 30, SPRING), ("241 beads", "240 bonds")),
    "mixture": (pack({linear("A6B4", SPRING): 20}, box=[5.0] * 3, seed=1), ("195 molecules", "2 kinds", "375 beads")),
    "profile": (VelocityProfile(SLABS, 0.01, SLABS, SLABS, SLABS, SLABS, np.zeros((100, 500)), 5.0), ("100 samples", "500 slabs")),
}


def test_what_is_shown():
    sample = dpd.Observer(BUILT).sample(BUILT.simulation().context)
    for shown, words in [*SHOWN.values(), (sample, ("step 0", "375 beads", "kT = 1,"))]:
        text = repr(shown)
        assert len(text) < 200 and "\n" not in text
        assert all(word in text for word in words), text


def test_what_a_notebook_shows():
    sample = dpd.Observer(BUILT).sample(dpd.build(SCENE, dt=0.02, platform="Reference", seed=1).simulation().context)
    molecule = linear("A6B4", SPRING)
    for shown, cells in (
        (SCENE, ("375", "A 120, B 80, W 175", "5 x 5 x 5 nm", "3 beads/nm^3", "1 kJ/mol", "DPD", "180")),
        (BUILT, ("Reference", "middle", "0.02 ps", "375")),
        (BUILT.plan, ("Reference", "middle")),
        (sample, ("0 ps", "375", "1 kJ/mol")),
        (molecule, ("10", "A 6, B 4", "9")),
    ):
        text = shown._repr_html_()
        assert text.startswith("<table>") and len(text) < 1000
        assert all(f"<td>{cell}</td>" in text for cell in cells), text
    odd = dpd.Scene({"<b>": 1.0}, ["<b>"], [[0.0, 0, 0]], {("*", "*"): dpd.NONE}, kT=1.0)
    assert "<b>" not in odd._repr_html_() and "box" not in odd._repr_html_()


def test_wrong_arguments_in_messages():
    assert what_is(None) == "None"
    assert what_is(3.5) == "3.5"
    assert what_is("W") == "'W'"
    assert what_is(BUILT) == "a BuiltSystem"
    assert what_is(np.zeros(3)) == "[0.0, 0.0, 0.0]" and what_is(np.zeros((9, 9))).endswith(", ...]")
    assert what_is(dpd.EDPD) == "the class EDPD"
    assert what_is(BUILT.explain) == "the function explain; call it: explain()"
    assert len(what_is([SCENE] * 1000)) < 300
