"""The choices that an integrator's program depends on."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from types import NoneType
from typing import Any
from zlib import crc32

import numpy as np

from ..base.names import PAIR_GROUP
from ..kernels.fields import ENERGY, TEMPERATURE, FieldSpec
from ..model.scene import Scene
from ..model.schemes import Scheme
from ..model.temperature import TemperatureRamp
from .execution import Execution


@dataclass(frozen=True)
class ProgramOptions:
    """Everything that an integrator's program depends on."""

    scheme: Scheme
    dt: float  #: Step size, ps
    kT: float  #: Thermal energy at the start, kJ/mol
    seed: int  #: Seed of the noise
    execution: Execution  #: Who computes what
    lam: float = 0.5  #: Weight of the velocity prediction of ``mvv``
    thermostat: bool = True  #: Whether there is friction or noise at all
    #: Whether the temperature is one number that may be set: there is friction or noise, no ramp, and no internal temperature.
    settable: bool = False
    slow_every: int = 1  #: In loops of whole steps: steps between kicks of forces that stay OpenMM's
    pair_group: int = PAIR_GROUP  #: Force group of the pair force
    seeded: bool = False  #: Whether the caller chose the seed
    constraints: bool = False  #: Whether the System has constraints
    ramp: TemperatureRamp | None = None
    tau_ratio: float = 1.0 / 32.0  #: Trial drift in units of the step size
    trial: float | None = None  #: Trial drift, ps, which replaces ``tau_ratio``
    forces: float = 0.0  #: Number of what forces are computed with, see :func:`forces_number`
    guided: str = ""  #: What a guide that acts within steps is, in words; empty if there is none
    numbers: tuple[float, ...] = ()  #: What it keeps from step to step, at the start; then three for each reaction
    frictionless: bool = False  #: Whether there is no friction and noise but what a guide may add
    impulses: tuple[tuple[int, str], ...] = ()  #: On the device: numbers and names of the parameters with what walls have taken up
    sheared: bool = False  #: Whether there is a Lees-Edwards shear
    walls: str = ""  #: Kind of the walls, "specular", "bounce-back" or "mixed"; empty if there are none
    partial: bool = False  #: Whether there are beads on which only body forces act along some axis
    bond_blocks: int = 0  #: Number of per-DOF variables with the table of bonds that form and break
    field_blocks: int = 0  #: Number of per-DOF variables that hold internal energies, temperatures or concentrations
    field_names: str = ""  #: What the per-DOF variables of fields hold, for the listing
    fields_act: bool = False  #: Whether forces depend on fields
    field_lam: float = 0.5  #: Weight of the prediction of the fields in ``mvv``
    field_reach: float = 0.1  #: Largest displacement, nm, by which fields are shown to the pair force
    field_scale: float = 1.0  #: Unit in which the pair force returns changes of fields
    #: Whether velocities or forces are less than double precision, so that energies have to be balanced by the program.
    compensated: bool = False

    @property
    def openmm_seed(self) -> int:
        """The seed for OpenMM's own random numbers, where 0 would mean any."""
        return self.seed or 2**31 - 1

    @property
    def trial_time(self) -> str:
        """Length of trial drifts, as an expression."""
        return f"dt*{self.tau_ratio!r}" if self.trial is None else repr(self.trial)

    @property
    def slow_kicks(self) -> tuple[float, float]:
        """For how many step sizes forces that stay OpenMM's kick, before and after steps: unevenly where velocities of the scheme lag."""
        return self.slow_every * (0.5 + self.scheme.lag), self.slow_every * (0.5 - self.scheme.lag)

    @property
    def predicting(self) -> bool:
        """Whether friction is a force of a predicted velocity; without friction, and fields that change, there is nothing to predict."""
        return self.scheme.predicts and (self.thermostat or self.field_blocks > 0)

    @property
    def kernel(self) -> bool:
        """Whether a pair kernel takes part at all."""
        return self.thermostat or self.execution.pushes


#: What forces of a scene are computed with, besides its pair terms.
_ACTING = "bead_masses type_ids mobile charges electrostatics bonds angles dihedrals impropers bonded_factors segments internal sources"
_ACTING += " body_forces walls interacting shear bodies reactions compat"


def forces_number(scene: Scene, *more: Any) -> float:
    """The checksum of what forces of a scene are computed with, and of ``more``; equal for equal values."""
    return float(_checksum([*(getattr(scene, name) for name in _ACTING.split()), *more]))


def _checksum(thing: Any, number: int = 0) -> int:
    if isinstance(thing, np.ndarray):
        return crc32(thing.tobytes(), number)
    if isinstance(thing, Mapping):
        thing = list(thing.items())
    elif is_dataclass(thing) and not isinstance(thing, type):
        thing = [type(thing), *(getattr(thing, each.name) for each in fields(thing))]
    if not isinstance(thing, (tuple, list)):
        known = isinstance(thing, (int, float, str, type, np.generic, NoneType))
        return crc32(str(thing if known else type(thing)).encode(), number)
    for each in thing:
        number = _checksum(each, number)
    return number


def tau_ratio(double: bool) -> float:
    """Trial drift in units of dt: short where positions are double precision, longer where they may be single."""
    return 1.0 / 32.0 if double else 0.25


def _trial_time(scene: Scene, cutoff: float, double: bool) -> float | None:
    """Trial drift for scenes that balance energies: 1/1000 of the range at a thermal velocity (1/50 where positions may be float32).  A
    power of two, so that multiplying and dividing by it is exact."""
    speed = float(np.sqrt(scene.initial_kT / scene.bead_masses.min()))
    return None if speed * cutoff <= 0 else float(2.0 ** np.round(np.log2((0.001 if double else 0.02) * cutoff / speed)))


def field_options(scene: Scene, fields: FieldSpec | None, cutoff: float, double: bool, lam: float) -> dict[str, Any]:
    """The options by which a program keeps per-bead fields and shows them to the pair force."""
    if fields is None:
        return {}
    reach = 0.25 * cutoff if double or scene.box is None else 0.2 * float(np.diag(scene.box).min())
    typical = float(np.abs(fields.initial.sum(axis=1)).mean()) or 1.0
    return {
        "trial": _trial_time(scene, cutoff, double),
        "field_blocks": fields.n_blocks,
        "fields_act": fields.acts,
        # LAMMPS: fix mvv/edpd predicts temperatures with lambda, dpd/energy and mvv/tdpd take half steps
        "field_lam": lam if fields.kind == TEMPERATURE else 0.5,
        "field_reach": float(reach),
        # forces are fixed-point numbers with 32 bits behind the point on GPU platforms
        "field_scale": 1.0 if double else float(2.0 ** (np.floor(np.log2(typical)) - 10)),
        "compensated": not double and fields.kind == ENERGY,
    }
