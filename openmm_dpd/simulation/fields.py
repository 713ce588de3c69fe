"""Per-bead fields of a running scene (internal energies, temperatures, concentrations): reading, setting, and saving them.

They are per-DOF variables of the integrator (``field0``, ``field1``, ..., three values per bead in each), so OpenMM's checkpoints and saved
states hold them.
"""

from itertools import chain
from typing import Any

import numpy as np
import openmm
from openmm import unit

from ..base.errors import A_CONTEXT, ParameterError, RunError, require, what_is
from ..base.names import BONDS, FIELD, KEPT, PHASE, RATE, WRITTEN, Phase
from ..base.units import thermal_energies, to_md
from ..kernels.fields import ENERGY, TEMPERATURE, FieldSpec
from ..model.internal import InternalEnergy
from ..plan.plan import Plan


def field_variables(values: np.ndarray, name: str = FIELD) -> dict[str, np.ndarray]:
    """Per-DOF variables (N, 3) by name, for values (N, K)."""
    padded = np.zeros((-(-values.shape[1] // 3), len(values), 3))
    for column in range(values.shape[1]):
        padded[column // 3, :, column % 3] = values[:, column]
    return {f"{name}{k}": block for k, block in enumerate(padded)}


def per_dof(integrator: openmm.CustomIntegrator, name: str) -> np.ndarray:
    """(N, 3) values of a per-DOF variable."""
    whole = getattr(integrator, "whole", None)
    kept = {} if whole is None else whole.kept(integrator)
    if name in kept:
        return kept[name]
    values = integrator.getPerDofVariableByName(name)
    # 80 times faster than np.array(values)
    return np.fromiter(chain.from_iterable(values), np.float64, 3 * len(values)).reshape(-1, 3)


def swap_kept(context: openmm.Context, group: int, number: int) -> None:
    """Have a device swap velocities of the beads that move with a block of :data:`openmm_dpd.base.names.KEPT` that it keeps."""
    asked = openmm.Context.getParameter(context, PHASE)  # a look at forces may be on the way
    openmm.Context.setParameter(context, PHASE, Phase.EXCHANGE + number)
    openmm.Context.getState(context, energy=True, groups={group})
    openmm.Context.setParameter(context, PHASE, asked)


def check_written(context: openmm.Context) -> None:
    """RunError if beads that do not move, whose fields no device takes over, have others than at the start."""
    parameters = openmm.Context.getParameters(context)
    if WRITTEN in parameters and parameters[WRITTEN]:
        raise RunError(
            "immobile beads have other temperatures or concentrations than at the start (write_fields): devices cannot take these"
        )


def hand_over(context: openmm.Context, group: int) -> None:
    """Have a device take over the fields of a Context, through its velocities, which are what they were afterwards."""
    check_written(context)
    integrator = context.getIntegrator()
    names = [name for name in map(integrator.getPerDofVariableName, range(integrator.getNumPerDofVariables())) if name.startswith(FIELD)]
    velocities = openmm.Context.getState(context, velocities=True).getVelocities(asNumpy=True)
    for name in names:
        openmm.Context.setVelocities(context, per_dof(integrator, name))
        swap_kept(context, group, KEPT[FIELD] + int(name.removeprefix(FIELD)))
        openmm.Context.setVelocities(context, velocities)


def kept_rates(context: openmm.Context, spec: FieldSpec, group: int) -> np.ndarray:
    """(N, K) changes of the fields per time that a device has computed last, 0 of beads that do not move."""
    blocks = []
    for number in range(KEPT[RATE], KEPT[RATE] + spec.n_blocks):
        swap_kept(context, group, number)
        v = openmm.Context.getState(context, velocities=True).getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        blocks.append(np.where(spec.immobile[:, None], 0.0, v))
        swap_kept(context, group, number)
    return np.concatenate(blocks, axis=1)[:, : spec.n_values]


def raw_fields(context: openmm.Context, spec: FieldSpec) -> np.ndarray:
    """(N, K) values of the fields in a Context."""
    values = _blocks(context, FIELD, spec)
    if spec.kind == ENERGY:
        # the third component is what rounding lost of the sum
        values[:, 1] += values[:, 2]
    return values[:, : spec.n_values].copy()


def raw_rates(context: openmm.Context, spec: FieldSpec) -> np.ndarray:
    """(N, K) changes of the fields per time, as the last step of a scheme that keeps them left them."""
    return _blocks(context, RATE, spec)[:, : spec.n_values].copy()


def _blocks(context: openmm.Context, name: str, spec: FieldSpec) -> np.ndarray:
    integrator = context.getIntegrator()
    return np.concatenate([per_dof(integrator, f"{name}{k}") for k in range(spec.n_blocks)], axis=1)


def raw_bonds(integrator: openmm.CustomIntegrator) -> np.ndarray:
    """The table of the bonds that form and break, see :mod:`openmm_dpd.kernels.reactions`."""
    count = integrator.getNumPerDofVariables() if isinstance(integrator, openmm.CustomIntegrator) else 0
    names = [name for k in range(count) if (name := integrator.getPerDofVariableName(k)).startswith(BONDS)]
    if not names:
        raise ParameterError("the Context has no bonds that form and break: it is not that of built.simulation()")
    return np.concatenate([per_dof(integrator, name) for name in names], axis=1).astype(np.int64)


def check_running(context: openmm.Context, plan: Plan) -> None:
    """Raise ParameterError unless these are a Context and a Plan."""
    require(context, openmm.Context, A_CONTEXT)
    require(plan, Plan, "plan must be a Plan, such as built.plan")


def read_fields(context: openmm.Context, plan: Plan) -> dict[str, np.ndarray]:
    """Per-bead fields of a running scene, by name.

    Parameters
    ----------
    context : openmm.Context
    plan : Plan
        ``built.plan``.

    Returns
    -------
    dict of arrays
        InternalEnergy: ``u_cond``, ``u_mech`` and ``theta``, each (N,), kJ/mol.  BeadTemperatures: ``theta`` (N,), kJ/mol.
        Concentrations: ``concentrations`` (N, K).  MDPD: ``density`` (N,), the local densities at the present positions.  Reactions:
        ``bonds`` (N, W), the bonds of each bead that form and break, 1 + partner + N sort, and 0 where there is none.  Empty for a scene
        without any of these.
    """
    check_running(context, plan)
    spec = plan.spec.fields
    bonds = {"bonds": raw_bonds(context.getIntegrator())} if plan.scene.reactions else {}
    if spec is None:
        return _densities(context, plan) | bonds
    values = raw_fields(context, spec)
    if spec.kind == ENERGY:
        assert spec.eos is not None
        return {"u_cond": values[:, 0], "u_mech": values[:, 1], "theta": spec.eos.thetas(values.sum(axis=1))}
    return {"theta": values[:, 0]} if spec.kind == TEMPERATURE else {"concentrations": values} | bonds


def _densities(context: openmm.Context, plan: Plan) -> dict[str, np.ndarray]:
    many_body = [k for k, kind in enumerate(plan.kinds) if kind.has_densities]
    if not many_body:
        return {}
    state = context.getState(positions=True)
    box = None if plan.scene.box is None else state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
    engine = plan.new_engine()
    engine.prepare(state.getPositions(asNumpy=True).value_in_unit(unit.nanometer), box)
    return {"density": np.sum([engine.densities(k) for k in many_body], axis=0)}


def write_fields(context: openmm.Context, plan: Plan, **values: Any) -> None:
    """Set the per-bead fields of a running scene.

    Those of immobile beads (walls that are heated, say) can be set where the kernel does whole steps, which ``built.explain()`` says;
    with internal energies these beads are reservoirs, which stay as they are.  Programs of OpenMM's then refuse to step.

    Parameters
    ----------
    context : openmm.Context
    plan : Plan
    **values
        Names of :func:`read_fields` with one value per bead (or one for all that move), with units if you like.  For internal energies
        either ``theta`` (everything becomes mechanical energy) or ``u_cond`` and/or ``u_mech``.

    Raises
    ------
    ParameterError
        If the scene has no such field, a shape is wrong, a temperature or energy is outside the equation of state (the bead is named), or
        an immobile bead cannot take another value.
    """
    check_running(context, plan)
    spec = plan.spec.fields
    known = () if spec is None else {ENERGY: ("theta", "u_cond", "u_mech"), TEMPERATURE: ("theta",)}.get(spec.kind, ("concentrations",))
    for name in values:
        if name not in known:
            raise ParameterError(f"the beads of this scene have no {what_is(name)}; their fields are: {', '.join(known) or 'none'}")
    if spec is None or not values:
        return
    old = raw_fields(context, spec)
    new, n = old.copy(), len(old)
    if spec.kind == ENERGY:
        if "theta" in values:
            if len(values) > 1:
                raise ParameterError("give either theta or the energies, not both")
            assert isinstance(plan.scene.internal, InternalEnergy)
            internal = InternalEnergy(plan.scene.internal.eos, values["theta"])
            new[...] = internal.energies(plan.scene.type_ids, plan.scene.type_names)
        for column, name in enumerate(("u_cond", "u_mech")):
            if name in values:
                new[:, column] = _per_bead(to_md(values[name], "energy", name), (n,), name)
        assert spec.eos is not None
        bad = np.flatnonzero(np.isnan(spec.eos.thetas(new.sum(axis=1))) & ~spec.immobile)
        if len(bad):
            raise ParameterError(f"the internal energy {new[bad[0]].sum():g} of bead {bad[0]} is outside its equation of state")
    elif spec.kind == TEMPERATURE:
        new[:, 0] = _per_bead(thermal_energies(values["theta"], "theta"), (n,), "theta")
        if np.any(new <= 0):
            raise ParameterError(f"the theta of bead {int(np.argmin(new[:, 0]))} is {new.min():g}; it must be > 0")
    else:
        new[...] = _per_bead(to_md(values["concentrations"], "dimensionless", "concentrations"), new.shape, "concentrations")
    integrator = context.getIntegrator()
    if all(np.ndim(value / value.unit if unit.is_quantity(value) else value) == 0 for value in values.values()):
        new[spec.immobile] = old[spec.immobile]
    # the temperature of a reservoir depends on the sum alone
    differ = ~np.isclose(new.sum(axis=1), old.sum(axis=1), rtol=1e-9) if spec.kind == ENERGY else np.any(new != old, axis=1)
    other = np.flatnonzero(differ & spec.immobile)
    if len(other) and (spec.kind == ENERGY or getattr(integrator, "whole", None) is None):
        why = "beads with internal energies that do not move are reservoirs" if spec.kind == ENERGY else "a program of OpenMM's skips it"
        raise ParameterError(f"bead {other[0]} is immobile and keeps its value, since {why}; leave such beads what read_fields returns")
    for name, block in field_variables(new).items():
        integrator.setPerDofVariableByName(name, block)
    if spec.kind != ENERGY:
        context.setParameter(WRITTEN, float(spec.written(new)))


def _per_bead(value, shape: tuple[int, ...], name: str) -> np.ndarray:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim and array.shape != shape:
        raise ParameterError(f"{name} must be one number or an array of shape {shape}, not {array.shape}")
    return np.broadcast_to(array, shape)
