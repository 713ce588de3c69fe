"""Measurements during a run, for thermo output, averages and dumps."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import openmm
from openmm import unit

from ...base.names import SHEARED
from ...kernels.layer import STRESS
from ...kernels.motion import moments
from ...kernels.shear import rate_at, strain_at
from ...measure import Sample
from ...measure.observer import SceneSampler
from ...measure.of_beads import bead_shares, pair_terms
from ...measure.present import require_stress, why_no_stress
from ...measure.within import Row, Within
from ...model.schemes import scheme_of
from ...simulation.bonds import read_reacted
from ...simulation.built import BuiltSystem
from ...simulation.fields import read_fields
from ...simulation.whole_steps import guide_variables
from ..scene.axes import SAME, Axes
from ..scene.flow import guided
from ..scene.reacting import reacted_values, take_bonds
from ..state.records import ACTING_FIXES, FIX_VALUES, NO_SLIDE, DeckSample, Slide
from ..values.resolver import Resolver
from .acting import acted_on
from .guide import DeckGuide
from .request import RunRequest

_NM, _V = unit.nanometer, unit.nanometer / unit.picosecond


def arrays(context: openmm.Context, axes: Axes = SAME):
    """Positions, velocities and box vectors, in the deck's axes."""
    state = context.getState(positions=True, velocities=True)
    x, v = state.getPositions(asNumpy=True).value_in_unit(_NM), state.getVelocities(asNumpy=True).value_in_unit(_V)
    return axes.of_deck(x), axes.of_deck(v), axes.box_of_deck(state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(_NM))


def slide_of(built: BuiltSystem, context: openmm.Context, axes: Axes) -> Slide:
    """Present slide of the images above the box."""
    scene = built.plan.scene
    if scene.shear is None:
        return NO_SLIDE
    assert scene.box is not None
    time, height = context.getParameter(SHEARED), float(scene.box[1, 1])
    return Slide(strain_at(scene.shear, time) * height, rate_at(scene.shear, time) * height, axes.plane)


class LiveSample(DeckSample):
    """A measurement during a run.  Energies, forces, the stress tensor and fields are computed when they are first read, before the next
    step."""

    sampler: "Sampler"
    asked: set[str]  #: Names of what has been read
    measured: Sample | None = None  #: The energies and forces, once something has read one of them

    def __init__(self, **known: Any):
        vars(self).update(_NO_ENERGIES, asked=set(), **known)

    def read(self, name: str) -> Any:
        self.asked.add(name)
        if getattr(self, name) is None:
            self.sampler.measure(self)
        return getattr(self, name)

    def kept(self) -> DeckSample:
        """The part that outlasts the step: everything but forces."""
        gone = "sampler", "asked", "measured", "forces", "pair_terms"
        return DeckSample(**{name: value for name, value in vars(self).items() if name not in gone})

    @cached_property
    def pair_terms(self) -> list[tuple[np.ndarray, np.ndarray]]:
        found = pair_terms(self.sampler.observer.present, friction=False)
        return [(beads, self.sampler.axes.shares_of_deck(values)) for beads, values in found]

    @cached_property
    def shares_of_beads(self) -> dict[str, np.ndarray]:
        found = bead_shares(self.sampler.observer.present)
        return {part: self.sampler.axes.shares_of_deck(values) for part, values in found.items()}

    @cached_property
    def virial(self) -> float:
        """From the energies and forces if these are known, otherwise from the stress tensor, which takes less."""
        sampler = self.sampler
        if self.measured is None and why_no_stress(sampler.built.plan) is None:
            return float(self.virial_tensor[:3].sum())
        return sampler.virials(sampler.measure(self))[0]

    @cached_property
    def virial_tensor(self) -> np.ndarray:
        require_stress(self.sampler.built.plan)
        return self.sampler.axes.tensors_of_deck(self.sampler.observer.present.stress())

    @cached_property
    def fields(self) -> dict[str, np.ndarray]:
        return read_fields(self.sampler.context, self.sampler.built.plan)


#: Energies that are not measured yet.
_NO_ENERGIES = dict.fromkeys(f"{part}_energy" for part in ("short", "lattice", "bond", "angle", "dihedral", "improper", "fix"))


#: What samples within a run have.  Whether a virial comes from the tensor depends on what else is measured.
WITHIN = {"kinetic", "kinetic_tensor", "virial", "virial_tensor"}, {"kinetic", "kinetic_tensor", "pair_energy", "virial_tensor"}


class Sampler:
    """Takes samples during a run."""

    def __init__(self, request: RunRequest, built: BuiltSystem, context: openmm.Context):
        self.request, self.built, self.context = request, built, context
        self.observer, self.axes = SceneSampler(built), request.axes
        guide = getattr(built.integrator.whole, "guide", None)
        self.guide = guide if isinstance(guide, DeckGuide) else None  #: What acts within the steps of this run
        self._within = Within(self.observer.present, request.state.bead_masses(), STRESS)
        self._masses, self._guided = request.state.bead_masses(), guided(request.state) or request.minimization is not None

    def virials(self, measured: Sample) -> tuple[float, float]:
        """The virial counted by LAMMPS, which includes the dissipative and random parts only if they are forces, and the one that always
        includes them."""
        friction = measured.virial_dissipative + measured.virial_random
        virial = measured.virial_conservative + (friction if (predicts := scheme_of(self.request.scheme).predicts) else 0.0)
        if self.built.plan.scene.bodies:  # the forces that keep bodies rigid hold beads on their circles
            virial += 2.0 * (measured.kinetic_pressure - measured.kinetic_on_step)
        return virial, virial if predicts else virial + friction

    def sample(self, step: int, cpu: float) -> LiveSample:
        """A sample of the present state."""
        self.observer.present.look(self.context)
        if self.request.state.fixes_of("adapt"):
            self.observer.present.renew()
        present, slide = self.observer.present, slide_of(self.built, self.context, self.axes)
        if present.bonds is not None:
            take_bonds(self.request.state, present.bonds, present.plan.scene.types)
        # of all beads: LAMMPS counts the velocities of immobile beads, too
        products = moments(self._masses, self._velocities(slide))[:6]
        place = {"positions": self.axes.of_deck(present.x), "box": self.axes.box_of_deck(present.box)}
        known = {"kinetic": float(products[:3].sum()) / 2, "kinetic_tensor": products, "velocities": self.axes.of_deck(present.with_flow)}
        return LiveSample(sampler=self, step=step, cpu=cpu, slide=slide, **place, **known)

    def within(self, step: int, first: int, every: int, end: int, take: Callable[[DeckSample], None]) -> bool:
        """From this step on, as :meth:`~openmm_dpd.measure.within.Within.run`, with samples that have the values :data:`WITHIN`."""

        def made(row: Row) -> None:
            if "box" not in known:
                known["box"] = self.axes.box_of_deck(self.observer.present.box)
            sample, moving, stress = object.__new__(DeckSample), row.moving, row.stress
            known.update(step=row.number - ahead, kinetic=(moving[0] + moving[1] + moving[2]) / 2, kinetic_tensor=np.array(moving[:6]))
            known.update(pair_energy=row.sums[0], virial=float(stress[0] + stress[1] + stress[2]), virial_tensor=stress)
            vars(sample).update(known)
            take(sample)

        ahead, known = self.context.getStepCount() - step, dict[str, Any](fields={})
        return self._within.run(self.context, first + ahead, every, end + ahead, made)

    def measure(self, sample: LiveSample) -> Sample:
        """Add energies, virials and forces to a sample of the present state, unless it has them."""
        if sample.measured is not None:
            return sample.measured
        measured, state = self.observer.sample(self.context), self.request.state
        # of all beads, as in LAMMPS: forces act on immobile beads, too
        forces, acted = self.axes.of_deck(measured.forces), dict[str, list[float]]()
        if state.fixes_of(*FIX_VALUES, *ACTING_FIXES):
            found, acted = self._acted_on(sample, measured.untaken)
            # otherwise they are those of the simulation
            forces = found if self._guided or state.fixes_of("setforce") else forces
        if self.built.plan.scene.reactions:
            acted = acted | self.reacted(sample.step)
        vars(sample).update(
            measured=measured,
            pair_energy=measured.pair,
            short_energy=measured.coulomb_real,
            lattice_energy=measured.coulomb_reciprocal,
            bond_energy=measured.bond,
            angle_energy=measured.angle,
            dihedral_energy=measured.dihedral,
            improper_energy=measured.improper,
            virial_full=self.virials(measured)[1],
            force_norm=float(np.sqrt(np.sum(forces**2))),
            force_max=float(np.abs(forces).max()),
            kT_conf=measured.kT_conf if state.dimension == 3 else None,
            forces=forces,
            acted=acted,
            fix_energy=sum(acted[fix.name][0] for fix in state.fixes.values() if fix.parameters.get("counted")) * state.units.energy,
        )
        return measured

    def _acted_on(self, sample: LiveSample, forces: np.ndarray) -> tuple[np.ndarray, dict[str, list[float]]]:
        """Forces as changed by the deck's fixes, if the simulation's forces acted on all beads, and the values of these fixes."""
        state, window = self.request.state, self.request.window
        moment, unit = Resolver(state, sample, window), state.units.force
        if not self._guided:
            added, _ = acted_on(moment, np.zeros_like(forces))
            found, values = acted_on(moment, forces / unit - added)
            return found * unit, values
        # a guide has seen the velocities of the half step
        v = sample.velocities if self.guide is None else self.observer.present.force_velocities()
        halfway = DeckSample(sample.step, positions=sample.positions, velocities=v, box=sample.box)
        found, values = acted_on(Resolver(state, halfway, window), forces / unit)
        return found * unit, values if self.guide is None else values | self.guide.values(self.numbers(), moment)

    def reacted(self, step: int) -> dict[str, list[float]]:
        """Values of the fixes that make and break bonds."""
        reacted = read_reacted(self.context, self.built.plan)
        return reacted_values(self.request.state, reacted, step, self.request.first_step)

    def numbers(self) -> np.ndarray:
        """What the guide has kept in the Context."""
        names = () if self.guide is None else guide_variables(self.guide)
        return np.array([self.built.integrator.getGlobalVariableByName(name) for name in names])

    def _velocities(self, slide: Slide) -> np.ndarray:
        """Velocities (N, 3), which with a shear include the flow, as in LAMMPS."""
        present, state = self.observer.present, self.request.state
        if not slide.speed:
            return present.v
        x, v = self.axes.of_deck(present.x), self.axes.of_deck(present.with_flow)
        sample = DeckSample(0, positions=x, velocities=v, box=self.axes.box_of_deck(present.box), slide=slide)
        return Resolver(state, sample, self.request.window).velocities * state.units.velocity
