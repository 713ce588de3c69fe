"""The widget of a notebook, with nglview where it is installed and with something in its place where it is not."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from cases import cases, raises
from openmm import unit

import openmm_dpd as dpd
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


def test_beads_bonds_and_box(nglview):
    built = dpd.build(scene(), dt=0.01, platform="Reference", seed=1)
    widget = built.view()
    assert widget.shown[:2] == [("spacefill", "@0,1", 5.0), ("spacefill", "@2,3", 2.5)]
    assert widget.shown[2][:2] == ("licorice", "@0,1") and widget.shown[3][0] == "unitcell"
    assert widget.structure.ext == "pdb" and "CONECT    1    2" in widget.structure.text and "CRYST1   50.000" in widget.structure.text
    assert view(built, state=built.simulation().context.getState(positions=True)).structure.text == widget.structure.text


def test_radii(nglview):
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
