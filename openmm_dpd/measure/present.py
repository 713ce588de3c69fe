"""The present state of a Context that runs a scene, and sums over the forces in it.

Where the pair force carries out whole steps, its own engine does the sums: it has the pair list of the last step, and the next step
reuses what is computed here.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import openmm

from ..base.errors import ParameterError
from ..base.names import BEGUN, EXTERNAL_GROUP, PAIR_FORCE, SHEARED, SLOW_STEP
from ..base.openmm_private import bare, masses_of, vectors
from ..kernels import motion
from ..kernels.bodies import Bodies
from ..kernels.charges import ChargeEvaluator
from ..kernels.columns import Totals
from ..kernels.fields import TEMPERATURE
from ..kernels.interface import Engine
from ..kernels.layer import CONSERVATIVE, DISSIPATIVE, LAPLACIAN, RANDOM, STRESS
from ..kernels.moment import LastStep, Stepper
from ..kernels.shear import add_flow, flow_at, rate_at
from ..plan.made import acting, groups_of
from ..plan.plan import Plan
from ..simulation.bonds import with_bonds
from ..simulation.built import BuiltSystem
from ..simulation.fields import per_dof, raw_bonds, raw_fields
from .stress_parts import Part, charge_evaluator, kinetic_deficit, kinetic_stress, needs_forces, stress_parts
from .temperature import noise_state


class Conservative(NamedTuple):
    """Potential energy, all conservative forces (N, 3), those of the pair engine alone, and sums over the pair terms."""

    potential: float
    force: np.ndarray
    held: np.ndarray
    pairs: Totals


class FrictionSums(NamedTuple):
    """All forces (N, 3), with friction and noise where these are forces (``mvv``), and the virials of friction and of noise."""

    force: np.ndarray
    dissipative: float
    random: float


def why_no_stress(plan: Plan) -> str | None:
    """Why there is no stress tensor of a scene, or None."""
    if plan.scene.box is None:
        return "there is no periodic box"
    if plan.spec.bodies is not None:
        return "that of the forces that keep bodies rigid is not known"
    if plan.spec.fields is not None:
        return "its beads have energies, temperatures or concentrations"
    if plan.engine.lacks(["stress"]):
        return f"the engine {plan.engine.name!r} has none"
    unknown = next((kind.name for kind in plan.kinds if not kind.has_stress), None)
    if unknown is not None:
        return f"the stress of {unknown} is not known"
    layers = getattr(plan.new_engine(), "layers", ()) if plan.layers else ()
    lacking = next((type(layer).__name__ for layer in layers if not hasattr(layer, "tensors")), None)
    return None if lacking is None else f"{lacking} has no method tensors, though its kind says has_stress=True"


def require_stress(plan: Plan) -> None:
    """Raise ParameterError if a scene has no stress tensor."""
    reason = why_no_stress(plan)
    if reason is not None:
        raise ParameterError(f"no stress tensor of this scene: {reason}")


class Present:
    """Reads the state of Contexts that run a built scene.

    After :meth:`look`, it has ``x``, ``v``, ``box`` (or None), the foreign forces in the System (``others``), ``kT``, the key of the noise
    (``seed``, ``counter``), the step size ``dt``, and ``changed`` (N, 3) or None: what was added to the velocities after the last step,
    which the forces of that step have not seen.  In a Lees-Edwards shear, ``v`` is relative to the flow (of the present ``rate``, after
    the time ``sheared``), and ``with_flow`` has the velocities of the Context.
    """

    def __init__(self, built: BuiltSystem):
        self.built, self.plan = built, built.plan
        whole = built.integrator.whole
        self._function = None if whole is None else whole.function
        self._own = self.plan.new_engine() if self.plan.layers and whole is None else None
        self._groups = built.integrator.getIntegrationForceGroups()
        self.mass, self._deficit = masses_of(built.system), kinetic_deficit(self.plan.options.scheme)
        self.bodies = None if self.plan.spec.bodies is None else Bodies(self.plan.spec.bodies, len(self.mass))
        self.changed: np.ndarray | None = None
        self.bonds: np.ndarray | None = None  #: Table of the bonds that form and break, which are in the plan's scene
        #: Number of forces in the System when only the pair force acts.
        self._alone: int | None = None

    def renew(self) -> None:
        """Forget what was made of the coefficients of overlays, which have changed."""
        vars(self).pop("_stress_parts", None)

    def foreign(self, forces: Sequence[openmm.Force]) -> list[openmm.Force]:
        """Forces in the System that are not the scene's own."""
        made = self.built.integrator.made
        return [] if made is None else made.others(forces)

    def look(self, context: openmm.Context) -> openmm.State:
        """Read the state of a Context, and return it."""
        self._context, system = context, context.getSystem()
        if system.getNumForces() != self._alone:  # a look at every force takes as long as some measurements
            forces = system.getForces()
            beside = [force for force in acting(forces) if force.getName() != PAIR_FORCE]
            self._beside = {group for force in beside for group in groups_of(force) if self._groups >> group & 1}
            self.others = self.foreign(forces)
            self._alone = None if self.others or self._beside else len(forces)
        state = context.getState(positions=True, velocities=True)
        self.x, self.v = vectors(state, openmm.State.Positions), vectors(state, openmm.State.Velocities)
        self.rate, self.sheared, self.with_flow = 0.0, 0.0, self.v
        if self.plan.scene.shear is not None:
            self.sheared = context.getParameter(SHEARED)
            self.rate = rate_at(self.plan.scene.shear, self.sheared)
            self.v = self._without_flow(self.v)
        self.box = None if self.plan.scene.box is None else bare(state.getPeriodicBoxVectors(asNumpy=True))
        self.kT, self.seed, self.counter, self.dt = noise_state(context, self.plan)
        if self.plan.scene.reactions and not np.array_equal(table := raw_bonds(context.getIntegrator()), self.bonds):  # type: ignore[arg-type]
            self.plan, self.bonds = with_bonds(self.built.plan, table), table
            self.renew()
        self._values: np.ndarray | None = None
        self._charges: tuple[float, float, np.ndarray] | None = None
        self._prepared: Engine | None = None
        self._last: tuple[LastStep | None] | None = None
        return state

    @property
    def values(self) -> np.ndarray | None:
        """(N, K) values of the fields, or None."""
        if self.plan.spec.fields is not None and self._values is None:
            self._values = raw_fields(self._context, self.plan.spec.fields)
        return self._values

    @property
    def engine(self) -> Engine | None:
        """The engine that evaluates the pair terms, with the pair list of these positions; None if there are no pair terms."""
        if self._prepared is None:
            if self._function is None:
                self._prepared = self._own
                if self._own is not None and self.plan.scene.shear is not None:
                    self._own.set_flow(flow_at(self.plan.scene.shear, self.sheared))
            else:
                local = self._function.thread_state()
                self._function.take_over(local, self._context.getParameters())
                self._prepared = local.engine
                if self.bonds is not None:
                    local.loop.show(self.bonds)  # type: ignore[union-attr]
            if self._prepared is not None:
                self._prepared.prepare(self.x, self.box)
        return self._prepared

    @property
    def plain(self) -> bool:
        """Whether all forces are those of pairs with repulsion, friction and noise as in isothermal DPD, and the kernel's."""
        loop, scene, plan = self.loop, self.plan.scene, self.plan
        if (
            self._alone is None
            or loop is None
            or not loop.engine.repels_by_pairs
            or loop.engine.spec.extras
            or scene.reactions
            or scene.interacting is not None
        ):
            return False
        return not (scene.bodies or scene.electrostatics or scene.shear or plan.driven or plan.options.ramp)

    @property
    def loop(self) -> Stepper | None:
        """What does the steps, if the kernel does."""
        return None if self._function is None else self._function.thread_state().loop

    # -- forces ------------------------------------------------------------------------------------------------------------------
    def conservative(self, more: int = 0) -> Conservative:
        """All conservative forces; ``more`` asks for STRESS and LAPLACIAN of the pair terms."""
        engine, loop, fields = self.engine, self.loop, self.plan.spec.fields
        pairs, force = Totals(0.0, 0.0, 0.0), np.zeros_like(self.x) if engine is None else np.empty_like(self.x)
        last = None if more & STRESS else self._last_step
        if loop is not None:
            loop.more |= LAPLACIAN
        if loop is not None and not loop.spec.predicts:
            force[...], pairs = loop.conserve(self.values, more)
        elif last is not None and last.held is not None:
            force, found = last.held, last.totals
            pairs = Totals(found.energy, found.conservative or 0.0, 0.0, None, found.laplacian if more else None)
        elif engine is not None:
            pairs = engine.sums(CONSERVATIVE | more, None, 0.0, 1.0, 0, 0, self.values, force)
        # outside a step the pair force does not know the internal temperatures that a repulsion may depend on
        if self._function is None and (fields is None or fields.kind != TEMPERATURE):
            state = self._context.getState(forces=True, energy=True, groups=self._groups)
            return Conservative(bare(state.getPotentialEnergy()), bare(state.getForces(asNumpy=True)), force, pairs)
        if not self._beside:
            return Conservative(pairs.energy, force, force, pairs)
        state = self._context.getState(forces=True, energy=True, groups=self._beside)
        energy, beside = bare(state.getPotentialEnergy()), bare(state.getForces(asNumpy=True))
        return Conservative(pairs.energy + energy, force + beside, force, pairs)

    def driving(self) -> np.ndarray:
        """(N, 3) body forces and buoyancy."""
        state, fields = self._context.getState(forces=True, groups={EXTERNAL_GROUP}), self.plan.spec.fields
        force = np.array(bare(state.getForces(asNumpy=True)))
        for extra in getattr(self.engine, "extras", ()):
            if extra.terms.term == "external":
                extra.add_to(self.x, self.box, force, self.engine.body_scale)  # type: ignore[union-attr]  # it has extras
        for source in () if fields is None else fields.sources:
            source.push(force, self.values)  # type: ignore[arg-type]  # there are fields
        return force

    def friction(self, v: np.ndarray, conservative: Conservative) -> FrictionSums:
        """Friction at velocities (N, 3); in ``mvv``, where it is a force, friction and noise at the velocities that the last step saw.
        Schemes with sweeps leave out the noise: that of past sweeps is in the velocities, and that of the next has a virial of mean 0,
        independent of the present state, which would only add scatter."""
        engine, last = self.engine, self._last_step
        if engine is None:
            return FrictionSums(conservative.force, 0.0, 0.0)
        if last is not None:
            total, counted = last.force, last.totals
            if conservative.force is not conservative.held:
                total = conservative.force + (total - conservative.held)
            inside = self.inside(total - conservative.force)
            return FrictionSums(total, counted.drag, counted.virial - conservative.pairs.virial - counted.drag - inside)
        force, which = np.empty_like(self.x), DISSIPATIVE
        if self.plan.options.predicting:
            v, which = self.force_velocities(), DISSIPATIVE | RANDOM
        found = engine.sums(which, v, self.kT, self.dt, self.seed, self.counter, self.values, force)
        total, drag = conservative.force + force if which & RANDOM else conservative.force, found.drag - self.inside(force)
        return FrictionSums(total, drag, found.virial - found.drag)

    def inside(self, force: np.ndarray) -> float:
        """What is to be taken off a virial because of forces (N, 3) on beads of rigid bodies, whose pressure is that on their centres."""
        return 0.0 if self.bodies is None else self.bodies.inside(self.x, force)

    @property
    def _last_step(self) -> LastStep | None:
        """The last step (``mvv``), or None if something has changed since."""
        if self._last is None:
            loop, engine, found = self.loop, self.engine, None
            if loop is not None and engine is not None and self.plan.spec.fields is None:  # with fields, a step sees predicted ones
                found = loop.last()
            m = None if found is None else found.moment
            there = m is not None and (m.kT, m.seed, m.counter, m.dt) == (self.kT, self.seed, self.counter, self.dt)
            self._last = (found if m is not None and there and motion.same(self.with_flow, m.v) else None,)
        return self._last[0]

    # -- stress tensors ----------------------------------------------------------------------------------------------------------
    def stress(self) -> np.ndarray:
        """(6,) sums of r F (xx, yy, zz, xy, xz, yz) over pairs, bonds, angles, bonded segments and charges, kJ/mol, with friction and
        noise where they are forces (``mvv``).  With transverse friction the tensor is asymmetric; xy is then the sum of r_x F_y, as in
        LAMMPS."""
        engine = self.engine
        if engine is None:
            return self.beside_pairs()
        pairs = self._of_all_forces(engine) if self.plan.options.predicting else self.conservative(STRESS).pairs
        return self.beside_pairs() + pairs.stress

    def beside_pairs(self) -> np.ndarray:
        """(6,) sums of r F (xx, yy, zz, xy, xz, yz) over everything but the pair terms, kJ/mol."""
        if not self._stress_parts and self._evaluator is None:
            return np.zeros(6)
        return sum((part(self.x, self.box) for part in self._stress_parts), np.zeros(6)) + self.charges[2]

    @property
    def charges(self) -> tuple[float, float, np.ndarray]:
        """Short-range and lattice energy of the charges, kJ/mol, and the stress tensor (6,) of their sum."""
        if self._charges is None:
            self._charges = (0.0, 0.0, np.zeros(6)) if self._evaluator is None else self._evaluator.parts(self.x, self.box)
        return self._charges

    @cached_property
    def _evaluator(self) -> ChargeEvaluator | None:
        return charge_evaluator(self.plan)

    @property
    def apart(self) -> int:
        """STRESS if the tensor of the pair potentials must be summed with the conservative forces, 0 if it comes with the friction."""
        return 0 if self.engine is None or self.engine.repels_by_pairs else STRESS

    def tensors(self, v: np.ndarray, conservative: Conservative | None) -> tuple[np.ndarray, np.ndarray, float]:
        """Stress tensors (6,) of all conservative forces and of radial friction at velocities (N, 3), and the sum of f gamma w^(2s) r^2.
        ``conservative`` must have been computed with :attr:`apart`, and may be None if that is 0."""
        if self.plan.scene.shear is not None and self.plan.options.predicting:
            v = self.force_velocities()
        pairs, friction, moment = (np.zeros(6), np.zeros(6), 0.0) if self.engine is None else self.engine.tensors(v, self.kT)
        swept = self.loop.swept(self.counter) if self.plan.scene.shear is not None and self.loop is not None else None
        if swept is not None:
            friction = swept / self.dt
        if self.apart:
            assert conservative is not None and conservative.pairs.stress is not None
            pairs = conservative.pairs.stress
        return pairs + self.beside_pairs(), friction, moment

    @cached_property
    def _stress_parts(self) -> list[Part]:
        return stress_parts(self.plan)

    def _of_all_forces(self, engine: Engine) -> Totals:
        loop, last = self.loop, self._last_step
        if loop is not None:
            loop.more |= STRESS
        if last is not None and last.totals.stress is not None:
            return last.totals
        which = CONSERVATIVE | DISSIPATIVE | RANDOM | STRESS
        return engine.sums(which, self.force_velocities(), self.kT, self.dt, self.seed, self.counter, self.values)

    # -- velocities --------------------------------------------------------------------------------------------------------------
    def on_step(self, force: np.ndarray | None) -> np.ndarray:
        """Velocities at the time of the positions, (N, 3); those of some schemes lag by part of a kick."""
        found = self.plan.options.scheme.on_step(self.v, force, self.plan.spec.inv_mass, self.dt)
        if self.bodies is not None and found is not self.v:
            self.bodies.keep(self.x, self.v)
            self.bodies.carry(self.x, found, 0.0)
        return found

    def seen(self) -> tuple[np.ndarray, np.ndarray]:
        """Conservative forces (N, 3), 0 if kinetic stresses of the scheme need none, and velocities at the time of the positions."""
        force = self.conservative().force if needs_forces(self.plan.options.scheme) else np.zeros_like(self.x)
        return force, self.on_step(force)

    @property
    def corrected(self) -> bool:
        """Whether the kinetic stress is not just the sum of m v v: it needs a correction for the scheme, or bodies turn."""
        return self._deficit != 0.0 or self.bodies is not None

    def kinetic_stress(self, v: np.ndarray, force: np.ndarray | None, product: Callable | None = None):
        """Kinetic stress of the mobile beads with velocities v under conservative forces, :func:`.stress_parts.kinetic_stress`; of rigid
        bodies that of their centres."""
        rest = {} if product is None else {"product": product}
        if self.bodies is not None:
            v = self.bodies.centred(v, self.x)
            force = None if force is None else self.bodies.centred(force * self.plan.spec.inv_mass[:, None]) * self.mass[:, None]
        return kinetic_stress(self._deficit, self.mass, v, force, self.dt, self.plan.spec.inv_mass, **rest)

    def force_velocities(self) -> np.ndarray:
        """(N, 3) velocities (nm/ps) for which ``mvv`` evaluated the friction: half-step or predicted ones, which LAMMPS's pressure uses."""
        integrator, options = self._context.getIntegrator(), self.plan.options
        v = self.v if self.changed is None else self.v - self.changed
        if self._context.getParameter(BEGUN) == 0.0:  # to read that it is 0 before the first step takes longer than some steps
            return v
        acc = per_dof(integrator, "acc")
        if options.lam == 0.5:
            return v - 0.5 * self.dt * acc - self._slow_kick()
        return np.where(np.any(acc != 0) & (self.mass > 0)[:, None], self._without_flow(per_dof(integrator, "vp")), v)

    def _without_flow(self, v: np.ndarray) -> np.ndarray:
        """Velocities (N, 3) relative to the flow of a Lees-Edwards shear; unchanged without one."""
        if self.plan.scene.shear is None:
            return v
        relative = v.copy()
        add_flow(relative, -self.rate, self.x)
        return relative

    def _slow_kick(self) -> np.ndarray | float:
        """Change of the velocities by OpenMM's slow forces after the last step, (N, 3); 0 where OpenMM carries out the steps."""
        integrator, options, groups = self._context.getIntegrator(), self.plan.options, self._beside
        begun = integrator.getGlobalVariableByName("valid_for") != -1.0
        waiting = options.slow_every > 1 and integrator.getGlobalVariableByName(SLOW_STEP) != 0.0
        if not self.plan.execution.looped or self.plan.options.guided or not groups or not begun or waiting:
            return 0.0
        slow = bare(self._context.getState(forces=True, groups=groups).getForces(asNumpy=True))
        return options.slow_kicks[1] * self.dt * slow * self.plan.spec.inv_mass[:, None]
