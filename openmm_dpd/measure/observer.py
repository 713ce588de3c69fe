"""Measured quantities of a running Context.

Kinetic temperature: 2K over the degrees of freedom of the mobile beads, 3N - 3 where momentum is conserved.  Configurational temperature:
<|grad U|^2>/<lap U>, a ratio of averages; it shows errors of the configurations that a thermostat hides from the kinetic one (Rugh,
Phys. Rev. Lett. 78, 772 (1997); Allen, J. Phys. Chem. B 110, 3823 (2006)).  Pressure: (2K + W)/(3V) with the virial W = sum over pairs of
r_ij . F_ij.  OpenMM's own reporters use 3N degrees of freedom and kelvin, and have no pressure.
"""

from collections.abc import Callable
from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np
import openmm
from openmm import unit

from ..base.errors import A_CONTEXT, ParameterError, RunError, require
from ..base.names import COULOMB_GROUP, EXTERNAL_GROUP, KT, LATTICE_GROUP
from ..base.openmm_private import bare
from ..kernels.fields import ENERGY, TEMPERATURE
from ..kernels.layer import LAPLACIAN
from ..kernels.motion import moments
from ..plan.kinds import resolved_kind
from ..plan.made import Freedom, groups_of
from ..plan.plan import Plan
from ..simulation.built import BuiltSystem
from .present import Present
from .sample import Sample, SystemSample
from .stress_parts import angle_sums, bond_sums, torsion_sums
from .within import Row, Within

_NM, _KJ = unit.nanometer, unit.kilojoule_per_mole
_NOT_FINITE = "the energy or a velocity is not finite at step {}; the step size may be too large{}"
#: Energies where there are only pairs.
_NO_TERMS = dict.fromkeys(("bond", "angle", "dihedral", "improper", "coulomb_real", "coulomb_reciprocal", "other"), 0.0)


class SceneSampler:
    """Measures temperatures, energies, virials and momentum of a scene."""

    def __init__(self, built: BuiltSystem):
        self.built, self.plan = built, built.plan
        self.present = Present(built)
        self._mass = self.present.mass
        self._mobile = self._mass > 0
        self._counted, self._n_mobile = self._mobile.astype(float), int(self._mobile.sum())

    @property
    def no_laplacian(self) -> str | None:
        """Why there is no configurational temperature, or None."""
        others = self.present.foreign(self.built.system.getForces())
        if others and self.plan.scene.interacting is None:
            return f"the System has forces that are not the scene's ({_names(others)}), whose Laplacian is not known"
        return self._no_laplacian

    @cached_property
    def _no_laplacian(self) -> str | None:
        """Why the scene's own forces have no configurational temperature, or None."""
        if self.plan.scene.interacting is not None:
            return "on some beads only body forces act"
        overlays, terms = (
            next(filter(None, (resolved_kind(table).why_no_laplacian(table) for table in tables)), None)
            for tables in (self.plan.overlays, self.plan.layers)
        )
        if overlays:
            return overlays
        if self.plan.scene.bodies:
            return "the Laplacian of the energy of rigid bodies is not known"
        if self.plan.scene.segments is not None:
            return "the segmental repulsion has no Laplacian here"
        if self.plan.scene.electrostatics is not None:
            return "the interaction of charges has no Laplacian here"
        if self.plan.driven is not None and self.plan.driven.continuum is not None:
            return "a continuum behind walls has no Laplacian here"
        if terms:
            return terms
        if self.plan.engine.lacks(["Laplacian"]):
            return f"the engine {self.plan.engine.name!r} has no Laplacian"
        if not self.plan.layers or (self.plan.execution.conservative == "none" and not self.plan.scene.bonded):
            return "there is no conservative force"
        return None

    @property
    def uncounted(self) -> str | None:
        """Names of foreign forces in the System, which virials and pressures leave out; None without any."""
        return _names(self.present.foreign(self.built.system.getForces())) or None

    @staticmethod
    def _half(weights: np.ndarray, vectors: np.ndarray) -> float:
        """Half the sum of weight times squared vector: a kinetic energy if the weights are masses."""
        return 0.5 * float(moments(weights, vectors)[:3].sum())

    def sample(self, context: openmm.Context) -> Sample:
        """Measure the present state of a Context."""
        present = self.present
        looked = present.look(context)
        plan = present.plan
        x, v, box, mobile = present.x, present.v, present.box, self._mobile
        others = present.others
        found = present.conservative(LAPLACIAN * (not others and self._no_laplacian is None and present.engine is not None))
        potential, every = found.potential, found.force
        # velocities that lag behind the positions would show as a spurious drag between beads that repel
        on_step = present.on_step(every)
        moving = moments(self._mass, v)
        kinetic = 0.5 * float(moving[:3].sum())
        if not isfinite(potential + kinetic):
            long = ", or a bond too long" if any(bonds.limited for bonds in plan.scene.bonds) else ""
            raise RunError(_NOT_FINITE.format(looked.getStepCount(), long))
        bond, bond_laplacian = bond_sums(plan, x, box, mobile)
        angle, angle_laplacian = angle_sums(plan, x, box, mobile)
        dihedral, dihedral_laplacian = torsion_sums(plan.scene.dihedrals, x, box, mobile)
        improper, improper_laplacian = torsion_sums(plan.scene.impropers, x, box, mobile)
        friction = present.friction(on_step, found)
        short, lattice = present.charges[:2] if "charges" in self.plan.execution.held else charge_energies(context, self.plan)
        pushed = every = friction.force
        if plan.scene.interacting is not None:
            pushes = context.getState(forces=True, groups={EXTERNAL_GROUP}).getForces(asNumpy=True).value_in_unit(_KJ / _NM)
            pushed = np.where(plan.scene.interacting, every, pushes)
        other, theirs = 0.0, set().union(*map(groups_of, others))
        if others:
            other = context.getState(energy=True, groups=theirs).getPotentialEnergy().value_in_unit(_KJ)
        if box is not None and plan.scene.body_forces and EXTERNAL_GROUP not in theirs:
            # what remains of -f.x where it has no meaning, see forces/external.py
            potential -= context.getState(energy=True, groups={EXTERNAL_GROUP}).getPotentialEnergy().value_in_unit(_KJ)
        laplacian, gradient2 = found.pairs.laplacian, 2.0 * self._half(self._counted, found.force)
        if laplacian is not None and (plan.scene.body_forces or plan.scene.sources):  # these have no Laplacian
            gradient2 -= float(self._counted @ np.sum(found.force * present.driving(), axis=1))
        if laplacian is not None:
            laplacian = laplacian + bond_laplacian + angle_laplacian + dihedral_laplacian + improper_laplacian
        pair, kinetic_on_step = (
            potential - bond - angle - dihedral - improper - other,
            kinetic if on_step is v else self._half(self._mass, on_step),
        )
        return Sample(
            step=looked.getStepCount(),
            time=bare(looked.getTime()),
            dof=self._degrees_of_freedom(others),
            kinetic=kinetic,
            pair=pair,
            potential=pair + bond + angle + dihedral + improper + other,
            other=other,
            bond=bond,
            angle=angle,
            dihedral=dihedral,
            improper=improper,
            coulomb_real=short,
            coulomb_reciprocal=lattice,
            virial_conservative=found.pairs.virial + float(present.beside_pairs()[:3].sum()) - present.inside(found.force),
            virial_dissipative=friction.dissipative,
            virial_random=friction.random,
            gradient2=gradient2,
            laplacian=laplacian,
            momentum=moving[6:],
            target_kT=present.kT,
            kinetic_on_step=kinetic_on_step,
            kinetic_pressure=0.5 * float(present.kinetic_stress(on_step, found.force)[:3].sum()) if present.corrected else kinetic_on_step,
            forces=pushed,
            untaken=every,
            **self._common(box),
            **self._internal(present.values, mobile),
        )

    def within(self, context: openmm.Context, first: int, every: int, end: int, take: Callable[[Sample], None]) -> bool:
        """Take steps and samples, without forces of beads, in the way of :meth:`.within.Within.run`."""
        present, options, known = self.present, self.plan.options, dict[str, Any]()
        if options.predicting and (present.loop is None or not present.loop.engine.parts_forces):
            return False

        def made(row: Row) -> None:
            energy, virial, drag, laplacian, conservative = row.sums
            if options.predicting:
                virial -= conservative
            else:
                conservative, (_, virial, drag, *_) = virial, row.friction
            kinetic, on_step = (0.5 * (each[0] + each[1] + each[2]) for each in (row.moving, row.on_step))
            if not isfinite(energy + kinetic):
                raise RunError(_NOT_FINITE.format(row.number, ""))
            if not known:
                known.update(_NO_TERMS, **self._common(present.box), dof=self._degrees_of_freedom([]), target_kT=present.kT)
            pressed = 0.5 * float(self._within.kinetic_stress(row)[:3].sum()) if present.corrected else on_step
            known.update(step=row.number, time=row.time, pair=energy, potential=energy, momentum=np.array(row.moving[6:]))
            known.update(kinetic=kinetic, kinetic_on_step=on_step, kinetic_pressure=pressed, gradient2=sum(row.slopes[:3]))
            known.update(virial_conservative=conservative, virial_dissipative=drag, virial_random=virial - drag)
            known["laplacian"] = laplacian if self._no_laplacian is None else None
            sample = object.__new__(Sample)  # its own __init__ takes longer than all of this
            vars(sample).update(known)
            take(sample)

        return self._within.run(context, first, every, end, made)

    @cached_property
    def _within(self) -> Within:
        more = LAPLACIAN if self.plan.options.predicting or self._no_laplacian is None else 0
        return Within(self.present, self._mass, more, sample=True)

    def _common(self, box: np.ndarray | None) -> dict[str, Any]:
        """What all samples in a box have in common."""
        volume = None if box is None else float(box[0, 0] * box[1, 1] * box[2, 2])
        return {"n_mobile": self._n_mobile, "box": box, "volume": volume, "mobile": self._mobile}

    def _degrees_of_freedom(self, others: list[openmm.Force]) -> int:
        """Degrees of freedom of the mobile beads, less one per conserved component of momentum if there are two beads or more."""
        found, kept = self._free
        theirs = any(isinstance(force, openmm.CustomExternalForce) for force in others)
        return found if theirs or found <= 3 else found - kept

    @cached_property
    def _free(self) -> tuple[int, int]:
        """Numbers of velocity components of the mobile beads and bodies, and of conserved components of momentum."""
        scene = self.plan.scene
        return scene.freedom if scene.interacting is None else int(scene.interacting[self._mobile].sum()), scene.kept_momenta

    def _internal(self, values: np.ndarray | None, mobile: np.ndarray) -> dict[str, Any]:
        """Sums of the internal energies of the mobile beads by their names in :class:`Sample`; empty if there are none."""
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
        return sums | {"theta": float(len(theta) / np.sum(1.0 / theta)) if len(theta) else np.nan}


def charge_energies(context: openmm.Context, plan: Plan) -> tuple[float, float]:
    """Energies of the charges of a scene, kJ/mol: the short-range part, less exclusions of bonded neighbours; and the lattice sum."""
    if plan.scene.electrostatics is None:
        return 0.0, 0.0
    short, lattice = (
        context.getState(energy=True, groups={group}).getPotentialEnergy().value_in_unit(_KJ) for group in (COULOMB_GROUP, LATTICE_GROUP)
    )
    return short, lattice


def _names(forces: list[openmm.Force]) -> str:
    return ", ".join(dict.fromkeys(force.getName() for force in forces))


class SystemSampler:
    """Measures temperatures, energies and momentum of all particles of a System made elsewhere."""

    no_laplacian = "the forces of a System made elsewhere have no Laplacian here"
    uncounted = None

    def __init__(self, built: BuiltSystem):
        self.built, self.plan = built, built.plan
        self._freedom = Freedom(built.system, built.plan.n_atoms)

    def sample(self, context: openmm.Context) -> SystemSample:
        """Measure the present state of a Context."""
        plan, mass = self.plan, self._freedom.mass
        state = context.getState(velocities=True, energy=True, groups=self.built.integrator.getIntegrationForceGroups())
        v = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        potential = state.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole)
        if not (np.isfinite(potential) and np.all(np.isfinite(v))):
            raise RunError(_NOT_FINITE.format(state.getStepCount(), ""))
        kT = self._freedom.kinetic_kT(v)
        box = None if plan.scene.box is None else state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
        return SystemSample(
            step=state.getStepCount(),
            time=state.getTime().value_in_unit(unit.picosecond),
            n_mobile=int(np.sum(mass > 0)),
            dof=int(self._freedom.shares["all"]),
            kinetic=0.5 * float(mass @ np.sum(v**2, axis=1)),
            potential=potential,
            volume=None if box is None else float(np.prod(np.diag(box))),
            box=box,
            momentum=mass @ v,
            target_kT=context.getParameter(KT) if KT in context.getParameters() else plan.options.kT,
            kT_atoms=kT["atoms"],
            kT_beads=kT["beads"] if len(mass) > plan.n_atoms else None,
        )


class Observer:
    """Measures a Context that runs a System built by this package.

    Parameters
    ----------
    built : BuiltSystem
        The result of :func:`openmm_dpd.build`, :func:`openmm_dpd.add_thermostat` or :func:`openmm_dpd.create_mixed_system`.  A scene
        yields a :class:`Sample`, with every term; a System made elsewhere a :class:`SystemSample`, with the quantities that any
        System has.

    Raises
    ------
    ParameterError
        If ``built`` is anything else, such as a Simulation.
    """

    def __init__(self, built: BuiltSystem):
        require_built(built, "an Observer")
        self.built, self.plan = built, built.plan
        self._sampler = SceneSampler(built) if built.plan.host is None else SystemSampler(built)

    @property
    def no_laplacian(self) -> str | None:
        """Why there is no configurational temperature, or None."""
        return self._sampler.no_laplacian

    @property
    def uncounted(self) -> str | None:
        """Names of foreign forces in the System, which virials and pressures leave out; None without any."""
        return self._sampler.uncounted

    def within(self, context: openmm.Context, first: int, every: int, end: int, take: Callable[[Sample], None]) -> bool:
        """Take steps and samples as :meth:`SceneSampler.within` does; False for a System made elsewhere."""
        return isinstance(self._sampler, SceneSampler) and self._sampler.within(context, first, every, end, take)

    def sample(self, context: openmm.Context) -> Any:
        """Measure the present state of a Context: a :class:`Sample` of a scene, a :class:`SystemSample` of a System made elsewhere."""
        require(context, openmm.Context, A_CONTEXT)
        present, made = context.getSystem().getNumParticles(), self.built.system.getNumParticles()
        if present != made:
            raise ParameterError(f"the Context has {present} particles, but this Observer was made for a System of {made}")
        return self._sampler.sample(context)


def require_built(built, what: str) -> None:
    """Raise ParameterError, in which ``what`` asks for it, if this is not a BuiltSystem."""
    require(built, BuiltSystem, f"{what} needs as built the result of openmm_dpd.build(), add_thermostat() or create_mixed_system()")
