"""eDPD: coefficients that depend on the temperatures of the beads."""

from ...kernels.edpd import ThermalTable
from ...kernels.fields import TEMPERATURE, FieldSpec
from ...model.edpd import EDPD
from ...model.internal import BeadTemperatures
from ...model.scene import Scene
from .record import BeadData, Kind, Resolved, register, symmetric_arrays


def _terms(table: Resolved, beads: BeadData) -> ThermalTable:
    same = "A gamma kappa exponent exponent_T cutoff_T exponent_polynomial kappa_polynomial"
    ranges = {"cutoff_F": lambda c: c.cutoff, "cutoff": lambda c: max(c.cutoff, c.cutoff_T)}
    return ThermalTable(**symmetric_arrays(table, beads.names, same, **ranges), lammps=beads.compat == "lammps")


def _fields(scene: Scene) -> FieldSpec:
    internal = scene.internal
    assert isinstance(internal, BeadTemperatures)
    capacity = internal.heat_capacities(scene.n_beads)
    return FieldSpec(TEMPERATURE, internal.values(scene.n_beads), scene.immobile, capacity=capacity, sources=tuple(scene.sources))


def _no_sweep(scene: Scene) -> str | None:
    lammps = "EDPD with compat='lammps' has no pair updates: an update keeps the energy of a pair, which LAMMPS's heat does not"
    return lammps if scene.compat == "lammps" else None


register(
    Kind(
        coefficient=EDPD,
        terms=_terms,
        why_kernel_only=lambda *_: "the repulsion of EDPD depends on the temperatures of the beads, which no OpenMM force sees",
        fields=_fields,
        field_text="temperature of the bead",
        no_sweep=_no_sweep,
        why_no_laplacian=lambda _: "the repulsion depends on the temperatures of the beads (EDPD)",
        unlike_lammps="pair edpd: friction, noise and conduction keep the energy here, which LAMMPS's heat does not (--compat lammps "
        "computes it): with --scheme middle to rounding, with mvv to first order in the step, so that beads heat slowly",
    )
)
