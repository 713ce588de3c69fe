"""Measured quantities of a running scene: temperatures, energies, virials and pressures, momentum, and forces term by term.

Kinetic temperature: 2K/(3N - 3), over the beads that move (all schemes here conserve momentum).  Configurational temperature:
<|grad U|^2>/<lap U>, a ratio of averages, which shows errors of the configurations that a thermostat hides from the kinetic one (Rugh,
Phys. Rev.
Lett. 78, 772 (1997); Allen, J. Phys. Chem. B 110, 3823 (2006)).  Pressure: (2K + W)/(3V) with the virial W = sum over pairs of r_ij . F_ij.
OpenMM's own reporters use 3N degrees of freedom, kelvin, and no pair term.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import openmm
from openmm import unit

from .bonded_sums import angle_sums, bond_sums
from .build import BuiltSystem
from .charge_forces import charge_terms
from .errors import ParameterError, RunError
from .fields import per_dof, raw_fields
from .forces.expressions import VIRIAL_SWITCH
from .forces.segments import segment_spec
from .integrators import RAMPED, PairIntegrator, groups_of, masses_of
from .kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine
from .kernels.fields import ENERGY, TEMPERATURE
from .kernels.segments import SegmentEngine
from .kinds import Resolved, resolved_kind
from .mixed_system import MixedSystem
from .model.bonds import FENEBonds
from .model.scene import TemperatureRamp, thermal_energy
from .names import (
    BONDED_GROUP,
    COULOMB_GROUP,
    COULOMB_VIRIAL_GROUP,
    COUNTER,
    EXTERNAL_GROUP,
    KT,
    LATTICE_GROUP,
    RAMP_STEP,
    SEED,
    SLOW_STEP,
    VIRIAL_GROUP,
    VOLUME_MOVES,
)
from .names import (
    TEMPERATURE as TEMPERATURE_VARIABLE,
)
from .plan import Plan
from .sample import Sample
from .units import BOLTZMANN, to_md, whole_number

_NM, _KJ, _V = unit.nanometer, unit.kilojoule_per_mole, unit.nanometer / unit.picosecond


class Observer:
    """Takes samples from a Context that runs a built scene.

    Parameters
    ----------
    built : BuiltSystem or MixedSystem
        The scene's System, integrator and plan: what :func:`openmm_dpd.build` or :func:`openmm_dpd.create_mixed_system` returned.
        Of atoms and beads in one System a :class:`Sample` has less in it, see there.

    Raises
    ------
    ParameterError
        If it is something else, a Simulation say.
    """

    def __init__(self, built: BuiltSystem | MixedSystem):
        if not isinstance(built, (BuiltSystem, MixedSystem)):
            raise ParameterError(
                f"an Observer wants what openmm_dpd.build() or create_mixed_system() returned, not a {type(built).__name__}"
            )
        self.built, self.plan = built, built.plan
        self._engine = PairEngine(self.plan.spec) if self.plan.layers else None
        segments = segment_spec(self.plan.scene)
        self._segments = None if segments is None else SegmentEngine(segments)
        charges = charge_terms(self.plan.scene, self.plan.ewald, self.plan.charge_exceptions) if self.plan.charges_held else None
        self._charges = None if charges is None else charges.evaluator()
        self._groups = built.integrator.getIntegrationForceGroups()
        self._mass = masses_of(built.system)

    @property
    def no_laplacian(self) -> str | None:
        """Why there is no configurational temperature, or None."""
        if isinstance(self.built, MixedSystem):
            return "the forces of atoms have no Laplacian here"
        others = self._others(self.built.system)
        if others:
            return f"the System has forces that are not the scene's ({_names(others)}), whose Laplacian is not known"
        overlays, terms = map(_without_laplacian, (self.plan.overlays, self.plan.layers))
        if overlays:
            return overlays
        if self._segments is not None:
            return "the segmental repulsion has no Laplacian here"
        if self.plan.scene.electrostatics is not None:
            return "the interaction of charges has no Laplacian here"
        if terms:
            return terms
        if not self.plan.layers or (self.plan.conservative == "none" and not self.plan.scene.bonds and not self.plan.scene.angles):
            return "there is no conservative force"
        return None

    @property
    def uncounted(self) -> str | None:
        """Names of forces that do not count in virials and pressures, because somebody else added them to the System; None without any."""
        return _names(self._others(self.built.system)) or None

    def _others(self, system: openmm.System) -> list[openmm.Force]:
        """Forces that somebody else added to the System of a scene."""
        made = self.built.integrator.made
        return [] if made is None or isinstance(self.built, MixedSystem) else made.others(system)

    def sample(self, context: openmm.Context) -> Sample:
        """Measure the present state of a Context."""
        plan = self.plan
        _check_context(context)
        if isinstance(self.built, MixedSystem):
            return self.built.sample(context)
        state = context.getState(positions=True, velocities=True, forces=True, energy=True, groups=self._groups)
        x = state.getPositions(asNumpy=True).value_in_unit(_NM)
        v = state.getVelocities(asNumpy=True).value_in_unit(_V)
        mobile = self._mass > 0
        every = state.getForces(asNumpy=True).value_in_unit(_KJ / _NM)
        force = every[mobile]
        potential = state.getPotentialEnergy().value_in_unit(_KJ)
        if not (np.isfinite(potential) and np.all(np.isfinite(v))):
            long = ", or a FENE bond too long" if any(isinstance(bonds, FENEBonds) for bonds in plan.scene.bonds) else ""
            raise RunError(f"the energy or a velocity is not finite at step {state.getStepCount()}; the step size may be too large{long}")
        box = None if plan.scene.box is None else state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(_NM)
        bond, bond_virial, bond_laplacian = bond_sums(plan, x, box, mobile)
        angle, angle_laplacian = angle_sums(plan, x, box, mobile)
        mass = self._mass[mobile][:, None]
        values = None if plan.spec.fields is None else raw_fields(context, plan.spec.fields)
        seen, on_step = self._seen_velocities(context, v, force, mass, mobile)
        parts = self._pair_parts(context, x, seen, box, values)
        short, lattice, virial = self._charge_sums(context, x, box)
        parts[0] = parts[0]._replace(virial=parts[0].virial + virial)
        if plan.spec.fields is not None and plan.spec.fields.kind == TEMPERATURE:
            # outside a step the pair force does not know the temperatures its repulsion depends on
            potential, every = self._with_others(context, parts[0])
            force = every[mobile]
        if plan.options.predicting:
            every = every + parts[1].force + parts[2].force
        shown = every[mobile]
        others = self._others(context.getSystem())
        other, theirs = 0.0, set().union(*map(groups_of, others))
        if others:
            other = context.getState(energy=True, groups=theirs).getPotentialEnergy().value_in_unit(_KJ)
        if box is not None and plan.scene.body_forces and EXTERNAL_GROUP not in theirs:
            # what is left of -f.x where nothing is to be said of it, see forces/external.py
            potential -= context.getState(energy=True, groups={EXTERNAL_GROUP}).getPotentialEnergy().value_in_unit(_KJ)
        gradient2 = float(np.sum(force**2))
        return Sample(
            step=state.getStepCount(),
            time=state.getTime().value_in_unit(unit.picosecond),
            n_mobile=int(mobile.sum()),
            dof=max(0, 3 * int(mobile.sum()) - 3),
            kinetic=0.5 * float(np.sum(mass * v[mobile] ** 2)),
            pair=potential - bond - angle - other,
            other=other,
            bond=bond,
            angle=angle,
            coulomb_real=short,
            coulomb_reciprocal=lattice,
            virial_conservative=parts[0].virial + bond_virial,
            virial_dissipative=parts[1].virial,
            virial_random=parts[2].virial,
            volume=None if box is None else float(np.prod(np.diag(box))),
            box=box,
            gradient2=gradient2,
            force_norm=float(np.sum(shown**2)) ** 0.5,
            force_max=float(np.abs(shown).max(initial=0.0)),
            laplacian=None
            if others or self.no_laplacian or self._engine is None
            else self._engine.laplacian() + bond_laplacian + angle_laplacian,
            momentum=np.sum(mass * v[mobile], axis=0),
            target_kT=noise_state(context, plan)[0],
            kinetic_on_step=0.5 * float(np.sum(mass * on_step[mobile] ** 2)),
            forces=every,
            **self._internal(values, mobile),
        )

    def _charge_sums(self, context: openmm.Context, x: np.ndarray, box: np.ndarray | None) -> tuple[float, float, float]:
        """Energies of the charges, short-ranged and lattice, and the virial of both."""
        plan = self.plan
        if plan.scene.electrostatics is None:
            return 0.0, 0.0, 0.0
        if self._charges is not None:
            short, lattice, virial = self._charges.parts(x, box)
        else:
            short, lattice = charge_energies(context)
            virial = 0.0 if plan.ewald is None else short + lattice + _switched_energy(context, COULOMB_VIRIAL_GROUP)
        return short, lattice, virial if plan.ewald is not None else 0.0

    def _internal(self, values: np.ndarray | None, mobile: np.ndarray) -> dict[str, float]:
        """Sums over the internal energies of the mobile beads."""
        fields = self.plan.spec.fields
        if fields is None or values is None or fields.kind not in (ENERGY, TEMPERATURE):
            return {}
        if fields.kind == TEMPERATURE:
            assert fields.capacity is not None
            theta, sums = values[mobile, 0], {"internal": float(fields.capacity[mobile] @ values[mobile, 0])}
        else:
            assert fields.eos is not None
            theta = fields.eos.thetas(values.sum(axis=1))[mobile]
            sums = {"internal": float(values[mobile].sum()), "conductive": float(values[mobile, 0].sum())}
        return sums | {"theta": float(len(theta) / np.sum(1.0 / theta))}

    def _seen_velocities(self, context, v, force, mass, mobile) -> tuple[np.ndarray, np.ndarray]:
        """Velocities the friction saw last, and those of the same moment as the positions."""
        options, integrator = self.plan.options, context.getIntegrator()
        dt = integrator.getStepSize().value_in_unit(unit.picosecond)
        if not options.predicting:
            # velocities behind the positions would show as a spurious drag of pairs that repel
            on_step = v.copy()
            on_step[mobile] = options.scheme.on_step(v[mobile], force, 1.0 / mass[:, 0], dt)
            return on_step, on_step
        # the friction in the force saw half-step or predicted velocities; LAMMPS's pressure counts it so (no history yet: acc is 0)
        acc = per_dof(integrator, "acc")
        if options.lam == 0.5:
            return v - 0.5 * dt * acc - self._slow_kick(context, dt), v
        predicted = per_dof(integrator, "vp")
        return np.where(np.any(acc != 0) & mobile[:, None], predicted, v), v

    def _slow_kick(self, context: openmm.Context, dt: float) -> np.ndarray | float:
        """What forces that stay OpenMM's have added to the velocities after the last step, where the pair force carries out steps."""
        integrator, options = context.getIntegrator(), self.plan.options
        begun = integrator.getGlobalVariableByName("valid_for") != -1.0
        if self.plan.unlooped is not None or not begun or (options.slow_every > 1 and integrator.getGlobalVariableByName(SLOW_STEP) != 0.0):
            return 0.0
        groups = integrator.getIntegrationForceGroups() & ~(1 << options.pair_group) & 0xFFFFFFFF
        slow = context.getState(forces=True, groups=groups).getForces(asNumpy=True).value_in_unit(_KJ / _NM)
        return options.slow_kicks[1] * dt * slow * self.plan.spec.inv_mass[:, None]

    def _with_others(self, context: openmm.Context, part: Part) -> tuple[float, np.ndarray]:
        """Energy and forces of a pair term, and of everything that is not in the pair force."""
        state = context.getState(forces=True, energy=True, groups=self._groups & ~(1 << self.plan.options.pair_group) & 0xFFFFFFFF)
        energy = state.getPotentialEnergy().value_in_unit(_KJ)
        return part.energy + energy, part.force + state.getForces(asNumpy=True).value_in_unit(_KJ / _NM)

    def _pair_parts(self, context, x, v, box, values) -> list[Part]:
        """Conservative, dissipative and random energies, forces and virials of pairs; leaves the engine prepared at x."""
        parts = [Part(0.0, np.zeros_like(x), 0.0) for _ in range(3)]
        if self._engine is not None:
            self._engine.prepare(x, box)
            kT, seed, counter, dt = noise_state(context, self.plan)
            if not self.plan.options.scheme.predicts:
                # the last sweep's noise has already moved the beads; as a force it would be correlated with their positions
                counter += 1
            parts = [Part(*self._engine.forces(which, v, kT, dt, seed, counter, values)) for which in (CONSERVATIVE, DISSIPATIVE, RANDOM)]
        if self.plan.overlays:
            virial = _switched_energy(context, *(VIRIAL_GROUP - k for k in range(10)))
            parts[0] = Part(parts[0].energy, parts[0].force, parts[0].virial + virial)
        if self._segments is not None:
            parts[0] = parts[0]._replace(virial=parts[0].virial + self._segments.forces(x, box)[2])
        return parts


def _without_laplacian(tables: Iterable[Resolved]) -> str | None:
    """Why one of some tables of pair terms has no Laplacian, or None."""
    return next(filter(None, (resolved_kind(table).no_laplacian(table) for table in tables)), None)


def _switched_energy(context: openmm.Context, *groups: int) -> float:
    """Sum of the "energies" of virial forces."""
    context.setParameter(VIRIAL_SWITCH, 1.0)
    try:
        return context.getState(energy=True, groups=set(groups)).getPotentialEnergy().value_in_unit(_KJ)
    finally:
        context.setParameter(VIRIAL_SWITCH, 0.0)


def charge_energies(context: openmm.Context) -> tuple[float, float]:
    """Energy of the charges of a scene, kJ/mol: the short-ranged part with what is taken out for bonded neighbours, and the lattice sum."""
    short, lattice = (
        context.getState(energy=True, groups={group}).getPotentialEnergy().value_in_unit(_KJ) for group in (COULOMB_GROUP, LATTICE_GROUP)
    )
    return short, lattice


def _names(forces: list[openmm.Force]) -> str:
    return ", ".join(dict.fromkeys(force.getName() for force in forces))


class Part(NamedTuple):
    """Energy, forces (N, 3) and virial of one kind of pair term."""

    energy: float
    force: np.ndarray
    virial: float


def noise_state(context: openmm.Context, plan: Plan) -> tuple[float, int, int, float]:
    """Thermal energy, seed, noise counter and step size of a Context."""
    dt = context.getIntegrator().getStepSize().value_in_unit(unit.picosecond)
    if KT not in context.getParameters():
        native = isinstance(context.getIntegrator(), openmm.DPDIntegrator)
        kT = BOLTZMANN * context.getIntegrator().getTemperature().value_in_unit(unit.kelvin) if native else plan.options.kT
        return kT, plan.options.seed, context.getStepCount(), dt
    return context.getParameter(KT), int(context.getParameter(SEED)), int(context.getParameter(COUNTER)), dt


def force_terms(
    built: BuiltSystem, positions=None, velocities=None, *, counter: int = 1, properties: dict[str, str] | None = None
) -> dict[str, np.ndarray]:
    """Forces term by term at given positions and velocities, always in force form, whatever the scheme.

    Parameters
    ----------
    built : BuiltSystem
    positions, velocities : (N, 3) arrays, optional
        Bare numbers: nm and nm/ps; the scene's own by default.
    counter : int
        Count of the noise; another count gives independent random forces.
    properties : dict, optional
        Platform properties.

    Returns
    -------
    dict of (N, 3) arrays, kJ/mol/nm
        ``conservative`` (all pair potentials but charges, from the plan's platform), ``electrostatic`` if there are charges,
        ``bond`` if there are bonds or angles, ``external`` if there are body forces, ``other`` if somebody else added forces to the System,
        ``dissipative`` and ``random``.  They add up to the total force.  If beads have internal energies, temperatures or concentrations,
        ``rates_dissipative`` and ``rates_random`` (N, K) are their changes per time at the scene's initial values.

    Raises
    ------
    ParameterError
        If a value has the wrong shape, or ``built`` is something else: the terms of atoms beside beads are not told apart.
    """
    if not isinstance(built, BuiltSystem):
        remedy = "; for atoms and beads ask for context.getState(forces=True)" if isinstance(built, MixedSystem) else ""
        raise ParameterError(f"force_terms wants what openmm_dpd.build() returned, but this is: {type(built).__name__}{remedy}")
    plan = built.plan
    scene, spec = plan.scene, plan.spec
    x = _vectors(scene.positions if positions is None else positions, "length", "positions", scene.n_beads)
    v = _vectors(built.velocities if velocities is None else velocities, "velocity", "velocities", scene.n_beads)
    counter = whole_number(counter, "counter", least=0)
    # an integrator belongs to one Context: this one is thrown away
    integrator = openmm.VerletIntegrator(plan.options.dt)
    context = openmm.Context(built.system, integrator, openmm.Platform.getPlatformByName(plan.platform), properties or {})
    context.setPositions(x)
    used = built.integrator.getIntegrationForceGroups()
    groups = {g for g in range(32) if used & (1 << g)}
    others = [] if built.integrator.made is None else built.integrator.made.others(built.system)
    apart = {
        "bond": {BONDED_GROUP} if scene.bonds or scene.angles else set(),
        "external": {EXTERNAL_GROUP} if scene.body_forces else set(),
        "electrostatic": {COULOMB_GROUP, LATTICE_GROUP} if scene.electrostatics is not None else set(),
        "other": set().union(*map(groups_of, others)),
    }
    terms = {name: _forces(context, found) for name, found in apart.items() if found}
    terms["conservative"] = _forces(context, groups.difference(*apart.values()))
    for extra in () if built.integrator.whole is None else built.integrator.whole.function.spec.extras:
        if extra.term != "conservative":
            # the pair force holds it
            part = np.zeros_like(x)
            extra.evaluator().add_to(x, scene.box, part, 1.0)
            terms[extra.term] = terms.get(extra.term, 0.0) + part
            terms["conservative"] -= part
    engine = PairEngine(spec)
    engine.prepare(x, scene.box)
    values = None if spec.fields is None else spec.fields.initial
    for name, which in (("dissipative", DISSIPATIVE), ("random", RANDOM)):
        terms[name] = engine.forces(which, v, scene.initial_kT, plan.options.dt, plan.options.seed, counter, values)[1]
        if values is not None:
            # rates: conductive and mechanical energy, dT/dt, or dC/dt of each species
            terms[f"rates_{name}"] = engine.rates.copy()
    return terms


def _vectors(value, dimension: str, name: str, count: int) -> np.ndarray:
    array = np.ascontiguousarray(to_md(value, dimension, name))
    if array.shape != (count, 3):
        raise ParameterError(f"{name} must have shape {(count, 3)}, not {array.shape}")
    return array


def _check_context(context) -> None:
    if not isinstance(context, openmm.Context):
        raise ParameterError(f"an openmm.Context is wanted here (simulation.context), not a {type(context).__name__}")


def _forces(context: openmm.Context, groups) -> np.ndarray:
    if not groups:
        return np.zeros((context.getSystem().getNumParticles(), 3))
    return context.getState(forces=True, groups=groups).getForces(asNumpy=True).value_in_unit(_KJ / _NM)


def set_temperature(context: openmm.Context, temperature) -> None:
    """Set the thermal energy of a running Context.

    Parameters
    ----------
    context : openmm.Context
    temperature : energy or temperature
        Bare numbers are kJ/mol, also for Systems with :func:`openmm_dpd.add_thermostat`; a Quantity may be in kelvin.

    Raises
    ------
    ParameterError
        If the value is out of bounds, or the Context has no such parameter or a ramp that would overwrite it.
    """
    _check_context(context)
    kT, integrator = thermal_energy(temperature), context.getIntegrator()
    if KT not in context.getParameters():
        native = isinstance(integrator, openmm.DPDIntegrator)
        remedy = "use setTemperature of its DPDIntegrator" if native else "nothing in it has friction or noise"
        raise ParameterError(f"this Context has no thermostat of openmm_dpd's; {remedy}")
    if isinstance(integrator, openmm.CustomIntegrator):
        names = map(integrator.getGlobalVariableName, range(integrator.getNumGlobalVariables()))
        if RAMP_STEP in names:
            raise ParameterError(RAMPED)
    if VOLUME_MOVES in context.getParameters():
        raise ParameterError("the beads of this Context have internal temperatures, which follow their energies; see write_fields")
    if isinstance(integrator, PairIntegrator) and TEMPERATURE_VARIABLE in integrator.variables():
        integrator.settle(context)
        integrator.agree(context, kT, kelvin(kT))
    else:
        context.setParameter(KT, kT)


def kelvin(kT: float) -> float:
    """Temperature in kelvin of a thermal energy in kJ/mol."""
    return kT / BOLTZMANN


__all__ = ["Observer", "Sample", "TemperatureRamp", "bond_sums", "force_terms", "kelvin", "noise_state", "set_temperature"]
