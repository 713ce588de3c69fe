"""The table of thermo words; each is a value of a :class:`~openmm_dpd.lammps.state.moment.DeckMoment` in the deck's units."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...base.geometry import AXES_OF_TENSOR
from ..state.moment import DeckMoment


@dataclass(frozen=True)
class Word:
    """A thermo word."""

    header: str  #: Title of its column
    value: Callable[[DeckMoment], float]  #: Value at a moment, normalised where LAMMPS normalises it
    integer: bool = False  #: Whether it is a whole number


def _per_bead(*names: str) -> Callable[[DeckMoment], float]:
    return lambda moment: sum(moment.energy(name) for name in names) / moment.norm


def _kinetic(moment: DeckMoment) -> float:
    return moment.kinetic(moment.thermo_compute()) / moment.units.energy / moment.norm


def _total(moment: DeckMoment) -> float:
    return _per_bead(*_ENERGIES)(moment) + _kinetic(moment)


def _enthalpy(moment: DeckMoment) -> float:
    units = moment.units
    return _total(moment) + moment.pressure() * units.pressure * moment.box.volume * units.length**3 / units.energy / moment.norm


def _density(moment: DeckMoment) -> float:
    mass = moment.state.bead_masses().sum() / moment.units.mass
    return moment.units.density * mass / moment.box.volume


def _cell_angle(first: int, second: int) -> Callable[[DeckMoment], float]:
    def angle(moment: DeckMoment) -> float:
        a, b = moment.box.vectors[[first, second]]
        return math.degrees(math.acos(float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))))

    return angle


def _cpu(moment: DeckMoment) -> float:
    return 0.0 if moment.sample is None else moment.sample.read("cpu")


def _elapsed(moment: DeckMoment, from_begin: bool = False) -> float:
    return 0.0 if moment.window is None else moment.step - (moment.window.begin if from_begin else moment.window.first)


def _rate(moment: DeckMoment, per_step: bool) -> float:
    elapsed, seconds = _elapsed(moment), _cpu(moment)
    if seconds <= 0:
        return 0.0
    return elapsed / seconds if per_step else elapsed * moment.state.timestep / moment.units.time / seconds


_BONDED = ("bond_energy", "angle_energy", "dihedral_energy", "improper_energy")
_ENERGIES = ("pair_energy", *_BONDED, "fix_energy")
_CHARGES = ("short_energy", "lattice_energy")


def _without_charges(moment: DeckMoment) -> float:
    return (moment.energy("pair_energy") - sum(moment.energy(name) for name in _CHARGES)) / moment.norm


def _entry(array: Callable[[DeckMoment], Sequence[float] | np.ndarray], k: int) -> Callable[[DeckMoment], float]:
    return lambda moment: float(array(moment)[k])


def _box_words() -> dict[str, Word]:
    words = {}
    for k, axis in enumerate("xyz"):
        words[f"l{axis}"] = Word(f"L{axis}", _entry(lambda c: c.box.edges, k))
        words[f"{axis}lo"] = Word(f"{axis.upper()}lo", _entry(lambda c: c.box.low, k))
        words[f"{axis}hi"] = Word(f"{axis.upper()}hi", _entry(lambda c: c.box.high, k))
    for k, tilt in enumerate(("xy", "xz", "yz")):
        words[tilt] = Word(tilt.capitalize(), _entry(lambda c: c.box.tilt, k))
    for k, name in enumerate("abc"):
        words[f"cell{name}"] = Word(f"Cell{name}", _entry(lambda c: [float(np.linalg.norm(row)) for row in c.box.vectors], k))
    for name, first, second in (("alpha", 1, 2), ("beta", 0, 2), ("gamma", 0, 1)):
        words[f"cell{name}"] = Word(f"Cell{name.capitalize()}", _cell_angle(first, second))
    return words


def _tensor_words() -> dict[str, Word]:
    names = [f"{'xyz'[a]}{'xyz'[b]}" for a, b in AXES_OF_TENSOR]
    return {f"p{name}": Word(f"P{name}", partial(DeckMoment.pressure_component, index=k)) for k, name in enumerate(names)}


#: Thermo words.  The last two are additions to LAMMPS's.
WORDS: dict[str, Word] = {
    "step": Word("Step", lambda c: c.step, integer=True),
    "elapsed": Word("Elapsed", _elapsed, integer=True),
    "elaplong": Word("Elaplong", lambda c: _elapsed(c, True), integer=True),
    "dt": Word("Dt", lambda c: c.state.timestep / c.units.time),
    "time": Word("Time", lambda c: c.state.time_at(c.step) / c.units.time),
    "cpu": Word("CPU", _cpu),
    "tpcpu": Word("T/CPU", lambda c: _rate(c, False)),
    "spcpu": Word("S/CPU", lambda c: _rate(c, True)),
    "atoms": Word("Atoms", lambda c: len(c.state.atoms), integer=True),
    "bonds": Word("Bonds", lambda c: len(c.state.bonds), integer=True),
    "angles": Word("Angles", lambda c: len(c.state.angles), integer=True),
    "dihedrals": Word("Diheds", lambda c: len(c.state.dihedrals), integer=True),
    "impropers": Word("Impros", lambda c: len(c.state.impropers), integer=True),
    "temp": Word("Temp", lambda c: c.temperature(c.thermo_compute())),
    "press": Word("Press", lambda c: c.pressure()),
    **_tensor_words(),
    "pe": Word("PotEng", _per_bead(*_ENERGIES)),
    "ke": Word("KinEng", _kinetic),
    "etotal": Word("TotEng", _total),
    "ecouple": Word("Ecouple", lambda c: c.coupled / c.norm),
    "econserve": Word("Econserve", lambda c: _total(c) + c.coupled / c.norm),
    "enthalpy": Word("Enthalpy", _enthalpy),
    "evdwl": Word("E_vdwl", _without_charges),
    "ecoul": Word("E_coul", _per_bead("short_energy")),
    "epair": Word("E_pair", _per_bead("pair_energy")),
    "ebond": Word("E_bond", _per_bead("bond_energy")),
    "eangle": Word("E_angle", _per_bead("angle_energy")),
    "edihed": Word("E_dihed", _per_bead("dihedral_energy")),
    "eimp": Word("E_impro", _per_bead("improper_energy")),
    "emol": Word("E_mol", _per_bead(*_BONDED)),
    "elong": Word("E_long", _per_bead("lattice_energy")),
    "etail": Word("E_tail", lambda c: 0.0),
    "vol": Word("Volume", lambda c: c.box.volume),
    "density": Word("Density", _density),
    **_box_words(),
    "fmax": Word("Fmax", lambda c: c.need("force_max") / c.units.force),
    "fnorm": Word("Fnorm", lambda c: c.need("force_norm") / c.units.force),
    "press_full": Word("PressFull", lambda c: c.pressure("virial_full")),
    "temp_conf": Word("TempConf", lambda c: c.need("kT_conf") / c.units.thermal_energy),
}
