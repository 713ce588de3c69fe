"""The properties of a kind of pair coefficients, as one record; the register of all kinds; coefficients as arrays."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, NamedTuple, cast

import numpy as np
import openmm

from ...base.errors import ParameterError
from ...base.serialized import trust
from ...kernels.fields import ENERGY, SPECIES, TEMPERATURE, FieldSpec
from ...kernels.layer import Table
from ...kernels.radial import Tables
from ...model.pairs import NONE, PairCoefficient
from ...model.scene import Scene
from ..forces.expressions import PairExpression

#: Coefficients by pair of types, all of one kind or NONE.
Resolved = Mapping[tuple[str, str], Any]


class BeadData(NamedTuple):
    """What coefficients may depend on: names of the types, masses of the beads, the scene's ``compat``, and its kT at the start."""

    names: list[str]
    masses: np.ndarray
    compat: str = "consistent"
    kT: float = 1.0


class Curves(NamedTuple):
    """A table of radial potentials for :class:`openmm_dpd.kernels.radial.RadialTerms`: Lennard-Jones, formulas, or piecewise cubics."""

    which: np.ndarray
    numbers: np.ndarray
    tables: Tables


@dataclass(frozen=True, eq=False, kw_only=True)
class Kind:
    """One kind of pair coefficients.  What is not given is not possible, and refused where it is asked for."""

    coefficient: type[PairCoefficient]  #: A frozen dataclass of :mod:`openmm_dpd.model`
    #: The coefficients as the pair kernel's table, which makes the layer that evaluates them; or else
    terms: Callable[[Resolved, BeadData], Table] | None = None
    # (of a table and names of types) what makes it a radial potential without friction beside the pair terms: the kernel's form
    overlay: Callable[[Resolved, list[str]], Curves] | None = None
    #: (of a table and names of types) the conservative force, or its radial part, as an OpenMM expression
    potential: Callable[[Resolved, list[str]], PairExpression] | None = None
    #: (of a table, names, type numbers, excluded pairs, whether it is periodic) a many-body force of OpenMM's that goes with it
    density_force: Callable[..., openmm.Force] | None = None
    #: (of a table, Scene, exceptions, platform) why only the kernel can compute the conservative force of a scene, or None
    why_kernel_only: Callable[[Resolved, Scene, dict[tuple[int, int], float], str | None], str | None] | None = None
    fields: Callable[[Scene], FieldSpec] | None = None  #: Per-bead fields, for the kernel; for coefficients that have ``internal``
    field_text: str = ""  #: What the per-DOF variables hold
    #: (of a Scene) why no scheme with sweeps runs it, a sentence that begins with its name, or None
    no_sweep: Callable[[Scene], str | None] = lambda _: None
    caution: Callable[[Scene], str | None] | None = None  #: What to know of its beads' fields: said at build, and by explain
    #: Why OpenMM's DPDIntegrator cannot apply its friction, a part of a sentence, or None
    why_not_native: Callable[[Any], str | None] | None = None
    #: Why there is no Laplacian of the potential, hence no configurational temperature, or None
    why_no_laplacian: Callable[[Resolved], str | None] = lambda _: None
    #: Why its conservative force derives from no potential, or None
    why_no_potential: Callable[[Resolved], str | None] = lambda _: None
    has_stress: bool = False  #: Whether its layers sum stress tensors; :class:`openmm_dpd.kernels.dpd.SweptLayer` has what that needs
    has_densities: bool = False  #: Whether its layers have local densities of the beads
    beside_atoms: bool = False  #: Whether beads beside atoms of a force field may have it, and it may act between the two
    thermostat: bool = False  #: Whether it can be the friction between atoms
    repulsion: Callable[[Any, float], float] = lambda c, _: c.A  #: (of a coefficient and kT) A of a soft repulsion, kJ/mol/nm
    # (of a coefficient and kT) friction coefficients (Da/ps) with the exponents of their noise, of a soft repulsion A (1 - r/cutoff): what
    # the table of steps is about
    frictions: Callable[[Any, float], list[tuple[float, float]]] | None = None
    #: (of a coefficient and the density of beads) rate at which two beads exchange a species, 1/ps, or a bead with all others, over 3.2
    exchange: Callable[[Any, float], float] = lambda *_: 0.0
    #: (of its kernel table) attributes of the plugin's Force, see :mod:`openmm_dpd.plan.forces.device_force`; None: not on the device
    device: Callable[[Any], dict[str, np.ndarray]] | None = None
    device_repels: bool = True  #: Whether the device has its conservative force too; otherwise OpenMM computes that there, by ``potential``
    unlike_lammps: str | None = None  #: Differences from LAMMPS unless a scene has ``compat="lammps"``

    def __post_init__(self):
        if (self.terms is None) == (self.overlay is None):
            raise ParameterError(f"the kind {self.name} must be either terms of the pair kernel or an overlay")
        if self.overlay is not None and self.potential is None:
            raise ParameterError(f"the overlay {self.name} needs a potential for OpenMM")
        if (self.coefficient.internal is None) != (self.fields is None):
            raise ParameterError(f"the kind {self.name} must name its per-bead fields and say how the kernel reads them, or neither")

    @property
    def name(self) -> str:
        """Name of the class of coefficients."""
        return self.coefficient.__name__

    def fields_of(self, scene: Scene) -> FieldSpec:
        """Per-bead fields of a scene, checked."""
        found, n = cast(Any, self.fields)(scene), scene.n_beads
        needs, width = {ENERGY: ("eos", 2), TEMPERATURE: ("capacity", 1), SPECIES: ("initial", 0)}.get(getattr(found, "kind", ""), ("", 0))
        values, immobile = (np.array(getattr(found, name, None)) for name in ("initial", "immobile"))
        shapes = (n, width or values.size // n), (n,)
        if getattr(found, needs, None) is None or values.dtype != np.float64 or (values.shape, immobile.shape) != shapes:
            raise ParameterError(f"the fields of {self.name} must be a whole FieldSpec: values (N, K), float64, flags (N,), N = {n}")
        return found

    def kernel_only(self, table: Resolved, scene: Scene, exceptions: dict[tuple[int, int], float], platform: str | None) -> str | None:
        """Why only the pair kernel can compute the conservative force in a scene, or None."""
        if self.potential is None and self.why_kernel_only is None:
            return f"there is no OpenMM force for {self.name}"
        return self.why_kernel_only(table, scene, exceptions, platform) if self.why_kernel_only else None


#: All kinds, by the class of their coefficients.
KINDS: dict[type[PairCoefficient], Kind] = {}


def register(kind: Kind) -> Kind:
    """Make a kind known to the package; ParameterError if there is another one for its coefficients.  Tables and layers of the module of
    these can be read by :func:`openmm_dpd.load_xml`."""
    if KINDS.setdefault(kind.coefficient, kind) is not kind:
        raise ParameterError(f"there is a kind for {kind.name} already")
    trust(kind.coefficient.__module__)
    return kind


def kind_for(coefficient: type[PairCoefficient]) -> Kind:
    """The kind of a class of coefficients; ParameterError if none was registered."""
    if coefficient not in KINDS:
        raise ParameterError(f"nothing is known of pair terms {coefficient.__name__}; register their kind (openmm_dpd.plan.kinds.register)")
    return KINDS[coefficient]


def resolved_kind(table: Resolved) -> Kind:
    """The kind of a resolved table that is not empty."""
    return kind_for(next(type(c) for c in table.values() if c is not NONE))


def symmetric_arrays(table: Resolved, names: list[str], fields: str, **others: Callable[[Any], Any]) -> dict[str, Any]:
    """(T, T, ...) symmetric arrays of these fields of the coefficients, and of what others are; zeros for pairs without a coefficient."""
    place = {name: k for k, name in enumerate(names)}
    found = [(place[a], place[b], c) for (a, b), c in table.items() if c is not NONE]
    arrays: dict[str, np.ndarray] = {}
    if found:
        first, second, coefficients = zip(*found, strict=True)
        for key, value in ({name: attrgetter(name) for name in fields.split()} | others).items():
            given = np.array([value(c) for c in coefficients], dtype=float)
            array = np.zeros((len(names), len(names), *given.shape[1:]))
            array[first, second] = array[second, first] = given
            arrays[key] = array
    return arrays
