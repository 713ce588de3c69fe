"""The device beside the host's kernel, on the state of a Context: a kernel that computes something else is not run."""

import logging
from typing import Any, cast

import numpy as np
import openmm
from openmm import unit

from ..base.errors import RunError
from ..base.names import COUNTER, DT, KT, PHASE, SEED, SHEARED, Phase
from ..kernels.layer import CONSERVATIVE, DISSIPATIVE, RANDOM
from ..kernels.shear import RATE, add_flow, flow_at
from ..model.schemes import SWEEPS
from ..plan.plan import Plan
from .fields import kept_rates, raw_fields

_LOGGER = logging.getLogger("openmm_dpd")

#: Beads of the largest scene that is compared.
MOST = 100_000

#: Largest differences, in parts of the largest force (at least a pair's): single precision has 1e-5, updates are solved to 5e-4.
FORCE, UPDATE = 1e-4, 5e-3


def check_device(context: openmm.Context, plan: Plan) -> None:
    """Compare forces, noise and one pair update.

    Raises
    ------
    RunError
        If they differ.
    """
    if plan.scene.n_beads > MOST:
        _LOGGER.info("more than %d beads: the device is not compared with the host", MOST)
        return
    wrong = {what: error for what, (error, most) in differences(context, plan).items() if not error <= most}
    if wrong:
        listing = ", ".join(f"{what} by {error:.2g}" for what, error in wrong.items())
        where = context.getPlatform().getName()
        raise RunError(
            f"the device computes something else than the host on the platform {where}, in parts of the largest: {listing}; take "
            "engine='host', and tell the developers which device and driver this is"
        )


def differences(context: openmm.Context, plan: Plan) -> dict[str, tuple[float, float]]:
    """How much the device differs from the host, and how much it may, by what is computed."""
    options, spec = plan.options, plan.spec
    state = context.getState(positions=True, velocities=True, parameters=True)
    x, v = (a.value_in_unit_system(unit.md_unit_system) for a in (state.getPositions(asNumpy=True), state.getVelocities(asNumpy=True)))
    box = None if plan.scene.box is None else state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
    parameters = state.getParameters()
    values = None if spec.fields is None else raw_fields(context, spec.fields)
    conditions = (parameters[KT], parameters[DT], int(parameters[SEED]), int(parameters[COUNTER]), values)
    engine = plan.new_engine()
    if plan.scene.shear is not None:
        flow = flow_at(plan.scene.shear, parameters[SHEARED])
        engine.set_flow(flow)
        v = v.copy()
        add_flow(v, -flow[RATE], x)
    engine.prepare(x, box)

    def of_device(phase: int) -> tuple[float, np.ndarray]:
        context.setParameter(PHASE, phase)
        try:
            found = context.getState(forces=True, energy=True, groups={options.pair_group})
        finally:
            context.setParameter(PHASE, Phase.IDLE)
        force = found.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.nanometer)
        return found.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole), force

    found: dict[str, tuple[float, float]] = {}
    mobile = (spec.inv_mass > 0) & (spec.types >= 0)
    if plan.execution.pushes:
        energy, expected, _ = engine.forces(CONSERVATIVE, None, *conditions)
        device_energy, force = of_device(Phase.CONSERVE)
        # on a lattice those of pairs add up to nothing
        of_pairs = max(float(np.abs(term.A).max()) for term in spec.terms)  # type: ignore[attr-defined]  # of all that devices have
        found["the conservative force"] = (_relative(force, expected, of_pairs), FORCE)
        found["its energy"] = (abs(device_energy - energy) / max(abs(energy), 1e-9), FORCE)
    if options.thermostat:
        expected = engine.forces(DISSIPATIVE | RANDOM, v, *conditions)[1]
        found["friction and noise"] = (_relative(of_device(Phase.FORCE_KEPT)[1], expected), FORCE)
    if spec.fields is not None:
        rates = np.where(spec.inv_mass[:, None] > 0, engine.rates, 0.0)
        found["what beads carry"] = (_relative(kept_rates(context, spec.fields, options.pair_group), rates), FORCE)
    if options.thermostat and options.scheme.sweeps and spec.fields is None:
        # the impulse of a midpoint step is that of friction and noise at the mean of the velocities before and after
        force = of_device(Phase.SWEEP_SEEN + SWEEPS.index("S"))[1]
        between = v + 0.5 * conditions[1] * spec.inv_mass[:, None] * force
        expected = engine.forces(DISSIPATIVE | RANDOM, between, *conditions)[1]
        # friction makes the more of an error in velocities the stronger it is
        told = [cast(Any, kind.device)(table) for kind, table in zip(plan.kinds, spec.terms, strict=True)]
        along = (its["gamma"] + np.maximum(its["sigma"], 0.0) ** 2 / max(2.0 * conditions[0], 1e-200) for its in told)
        frictions = sum(float(np.maximum(one, its["gammaAcross"]).max()) for one, its in zip(along, told, strict=True))
        bound = UPDATE * (1 + conditions[1] * frictions * spec.inv_mass[mobile].max(initial=0.0))
        found["the pair update"] = (_relative(force[mobile], expected[mobile]), bound)
    return found


def _relative(found: np.ndarray, expected: np.ndarray, least: float = 0.0) -> float:
    scale = float(np.abs(expected).max(initial=least))
    error = float(np.abs(found - expected).max(initial=0.0))
    return error / scale if scale > 0 else error
