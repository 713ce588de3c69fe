"""What a notebook shows of an object: one line with counts at any size, and the widget, with nglview or something in its place."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from cases import cases, raises
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.analysis import VelocityProfile
from openmm_dpd.base.errors import what_is
from openmm_dpd.molecules import Spring, linear, pack, star
from openmm_dpd.view import view


class Widget:
    """What nglview is asked for."""

    def __init__(self, structure):
        self.structure, self.shown = structure, []

    def clear_representations(self):
        self.shown.clear()

    def add_representation(self, kind, **choices):
        self.shown.append((kind, choices.get("selection"), choices.get("radius")))

    def center(self):
        pass


@pytest.fixture
def nglview(monkeypatch):
    module = SimpleNamespace(NGLWidget=Widget, TextStructure=lambda text, ext: SimpleNamespace(text=text, ext=ext))
    monkeypatch.setitem(sys.modules, "nglview", module)


def scene(**options) -> dpd.Scene:
    pairs = {("*", "*"): dpd.DPD(A=25, gamma=4.5), ("oil_drop", "oil_drop"): dpd.DPD(A=25, gamma=4.5, cutoff=2.0)}
    bonds = [dpd.HarmonicBonds([(0, 1)], k=1.0, r0=0.5)]
    x = np.random.default_rng(1).random((4, 3)) * 5
    return dpd.Scene({"oil_drop": 1, "W": 1}, ["oil_drop"] * 2 + ["W"] * 2, x, pairs, kT=1, bonds=bonds, box=[5, 5, 5], **options)


def test_beads_bonds_box_and_radii(nglview):
    built = dpd.build(scene(), dt=0.01, platform="Reference", seed=1)
    widget = built.view()
    assert widget.shown[:2] == [("spacefill", "@0,1", 5.0), ("spacefill", "@2,3", 2.5)]
    assert widget.shown[2][:2] == ("licorice", "@0,1") and widget.shown[3][0] == "unitcell"
    assert widget.structure.ext == "pdb" and "CONECT    1    2" in widget.structure.text and "CRYST1   50.000" in widget.structure.text
    assert view(built, state=built.simulation().context.getState(positions=True)).structure.text == widget.structure.text
    given = view(scene(), radii={"oil_drop": 0 * unit.nanometer, "W": 3 * unit.angstrom})
    assert given.shown[0] == ("spacefill", "@2,3", pytest.approx(3.0))
    assert view(scene(), radii=0.1).shown[0] == ("spacefill", "@0,1", 1.0)


@cases(
    "radii, message",
    ({"W": 1.0}, "radii must have one entry for each of the types oil_drop, W; oil_drop is missing or unknown"),
    (-1.0, "the radius of type 'oil_drop' must be >= 0, but is -1"),
    (np.nan, "must be finite"),
)
def test_bad_radii(nglview, radii, message):
    raises(dpd.ParameterError, message, lambda: view(scene(), radii=radii))


def test_no_nglview(monkeypatch):
    monkeypatch.setitem(sys.modules, "nglview", None)
    raises(dpd.ParameterError, r"the view in a notebook needs the package nglview.*pip install 'openmm-dpd\[view\]'", lambda: view(scene()))


def test_nglview_itself():
    nglview = pytest.importorskip("nglview", reason="nglview is not installed: pip install -e '.[view]'")
    widget = view(scene())
    assert isinstance(widget, nglview.NGLWidget)
    calls = [message["args"][0] for message in widget._ngl_msg_archive if message["methodName"] == "addRepresentation"]
    assert calls == ["spacefill", "spacefill", "licorice", "unitcell"]


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
    for shown, words in [*SHOWN.values(), (sample, ("step 0", "375 mobile beads", "kT = 1,"))]:
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
