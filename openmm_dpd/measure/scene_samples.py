"""Samples of a scene, term by term."""

from typing import NamedTuple

import numpy as np
import openmm
from openmm import unit

from ..built import BuiltSystem
from ..charge_forces import charge_terms
from ..errors import RunError
from ..fields import per_dof, raw_fields
from ..forces.expressions import VIRIAL_SWITCH
from ..forces.segments import segment_spec
from ..kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine
from ..kernels.fields import ENERGY, TEMPERATURE
from ..kernels.segments import SegmentEngine
from ..kinds import resolved_kind
from ..made import groups_of, masses_of
from ..model.bonds import FENEBonds
from ..names import COULOMB_GROUP, COULOMB_VIRIAL_GROUP, EXTERNAL_GROUP, LATTICE_GROUP, SLOW_STEP, VIRIAL_GROUP
from .bonded_sums import angle_sums, bond_sums
from .kinetic_stress import kinetic_stress
from .sample import Sample
from .temperature import noise_state

_NM, _KJ, _V = unit.nanometer, unit.kilojoule_per_mole, unit.nanometer / unit.picosecond


class Part(NamedTuple):
    """Energy, forces (N, 3) and virial of one kind of pair term."""

    energy: float
    force: np.ndarray
    virial: float


class SceneSampler:
    """Temperatures, energies, virials and momentum of a scene."""

    def __init__(self, built: BuiltSystem):
        self.built, self.plan = built, built.plan
        self._engine = PairEngine(self.plan.spec) if self.plan.layers else None
        segments = segment_spec(self.plan.scene)
        self._segments = None if segments is None else SegmentEngine(segments)
        charges = charge_terms(self.plan.scene, self.plan.ewald, self.plan.charge_exceptions) if self.plan.charges_held else None
        self._charges = None if charges is None else charges.evaluator()
        self._groups = built.integrator.getIntegrationForceGroups()
        self._mass = masses_of(built.system)
        #: (N, 3) that was added to the velocities after the last step, whose forces have not seen it.
        self.changed: np.ndarray | None = None

    @property
    def no_laplacian(self) -> str | None:
        """Why there is no configurational temperature, or None."""
        others = self._others(self.built.system)
        if self.plan.scene.interacting is not None:
            return "on some beads only body forces act"
        if others:
            return f"the System has forces that are not the scene's ({_names(others)}), whose Laplacian is not known"
        overlays, terms = (
            next(filter(None, (resolved_kind(table).why_no_laplacian(table) for table in tables)), None)
            for tables in (self.plan.overlays, self.plan.layers)
        )
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
        return [] if made is None else made.others(system)

    def sample(self, context: openmm.Context) -> Sample:
        """Measure the present state of a Context."""
        plan = self.plan
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
        target_kT, _, _, dt = noise_state(context, plan)
        seen, on_step = self._seen_velocities(context, v, force, dt)
        parts = self._pair_parts(context, x, seen, box, values)
        short, lattice, virial = self._charge_sums(context, x, box)
        parts[0] = parts[0]._replace(virial=parts[0].virial + virial)
        if plan.spec.fields is not None and plan.spec.fields.kind == TEMPERATURE:
            # outside a step the pair force does not know the temperatures its repulsion depends on
            potential, every = self._with_others(context, parts[0])
            force = every[mobile]
        if plan.options.predicting:
            every = every + parts[1].force + parts[2].force
        pushed = every
        if plan.scene.interacting is not None:
            state = context.getState(forces=True, groups={EXTERNAL_GROUP})
            pushes = state.getForces(asNumpy=True).value_in_unit(_KJ / _NM)
            pushed = np.where(plan.scene.interacting, every, pushes)
        shown = pushed[mobile]
        others = self._others(context.getSystem())
        other, theirs = 0.0, set().union(*map(groups_of, others))
        if others:
            other = context.getState(energy=True, groups=theirs).getPotentialEnergy().value_in_unit(_KJ)
        if box is not None and plan.scene.body_forces and EXTERNAL_GROUP not in theirs:
            # what is left of -f.x where nothing is to be said of it, see forces/external.py
            potential -= context.getState(energy=True, groups={EXTERNAL_GROUP}).getPotentialEnergy().value_in_unit(_KJ)
        gradient2 = float(np.sum(force**2))
        pair = potential - bond - angle - other
        return Sample(
            step=state.getStepCount(),
            time=state.getTime().value_in_unit(unit.picosecond),
            n_mobile=int(mobile.sum()),
            dof=self._degrees_of_freedom(others),
            kinetic=0.5 * float(np.sum(mass * v[mobile] ** 2)),
            pair=pair,
            potential=pair + bond + angle + other,
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
            target_kT=target_kT,
            kinetic_on_step=0.5 * float(np.sum(mass * on_step[mobile] ** 2)),
            kinetic_pressure=0.5 * float(np.sum(kinetic_stress(plan.options.scheme, mass[:, 0], on_step[mobile], force, dt)[:3])),
            forces=pushed,
            untaken=every,
            **self._internal(values, mobile),
        )

    def _degrees_of_freedom(self, others: list[openmm.Force]) -> int:
        """Those of the beads that move, less one for each component of the momentum that is kept, if there is more than one."""
        scene, mobile = self.plan.scene, self._mass > 0
        found = 3 * int(mobile.sum()) if scene.interacting is None else int(scene.interacting[mobile].sum())
        theirs = any(isinstance(force, openmm.CustomExternalForce) for force in others)
        return found if theirs or found <= 3 else found - scene.kept_momenta

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

    def _seen_velocities(self, context, v, force, dt) -> tuple[np.ndarray, np.ndarray]:
        """Velocities the friction saw last, and those of the same moment as the positions."""
        if not self.plan.options.predicting:
            # velocities behind the positions would show as a spurious drag of pairs that repel
            on_step, mobile = v.copy(), self._mass > 0
            on_step[mobile] = self.plan.options.scheme.on_step(v[mobile], force, 1.0 / self._mass[mobile], dt)
            return on_step, on_step
        return self.force_velocities(context), v

    def force_velocities(self, context: openmm.Context) -> np.ndarray:
        """(N, 3) velocities (nm/ps) that the friction in the forces of ``mvv`` saw: half-step or predicted ones.

        LAMMPS's pressure counts friction with these.
        """
        integrator, options, mobile = context.getIntegrator(), self.plan.options, self._mass > 0
        v = context.getState(velocities=True).getVelocities(asNumpy=True).value_in_unit(_V)
        if self.changed is not None:
            v = v - self.changed
        acc = per_dof(integrator, "acc")  # 0 where there is no history yet
        if options.lam == 0.5:
            dt = integrator.getStepSize().value_in_unit(unit.picosecond)
            return v - 0.5 * dt * acc - self._slow_kick(context, dt)
        return np.where(np.any(acc != 0) & mobile[:, None], per_dof(integrator, "vp"), v)

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
