"""Measuring a running simulation, for thermo output and for averages: no more than is asked for."""

from typing import Any

import numpy as np
import openmm
from openmm import unit

from ...base.names import SHEARED
from ...kernels.motion import second_moments
from ...kernels.shear import rate_at, strain_at
from ...measure import Sample
from ...measure.present import require_stress, why_no_stress
from ...measure.scene_samples import SceneSampler
from ...model.schemes import scheme_of
from ...simulation.build import BuiltSystem
from ...simulation.fields import read_fields
from ..state.records import FORCE_FIXES, NO_SLIDE, DeckSample, Slide
from ..values.resolver import Resolver, evaluate_beads
from .request import RunRequest


def acted_on(moment: Resolver, forces: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """What the fixes make of forces (N, 3), and the total force on the group of each before it acts; all in the deck's units."""
    found, before = forces.copy(), {}
    for fix in moment.state.fixes_of(*FORCE_FIXES):
        members = moment.state.group(fix.group)
        before[fix.name] = found[members].sum(axis=0)
        for k, word in enumerate(fix.parameters["force"]):
            if word != "NULL":
                kept = 0.0 if fix.style == "setforce" else found[members, k]
                found[members, k] = kept + evaluate_beads(word, moment, len(found))[members]
    return found, before


_NM, _V = unit.nanometer, unit.nanometer / unit.picosecond


def arrays(context: openmm.Context):
    """Positions, velocities and box vectors."""
    state = context.getState(positions=True, velocities=True)
    x, v = state.getPositions(asNumpy=True).value_in_unit(_NM), state.getVelocities(asNumpy=True).value_in_unit(_V)
    return x, v, state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(_NM)


def slide_of(built: BuiltSystem, context: openmm.Context) -> Slide:
    """How the images above the box slide now."""
    scene = built.plan.scene
    if scene.shear is None:
        return NO_SLIDE
    assert scene.box is not None
    time, height = context.getParameter(SHEARED), float(scene.box[1, 1])
    return Slide(strain_at(scene.shear, time) * height, rate_at(scene.shear, time) * height)


class Sampler:
    """Takes samples during one run."""

    def __init__(self, request: RunRequest, built: BuiltSystem, context: openmm.Context):
        self.request, self.built, self.context = request, built, context
        self.observer = SceneSampler(built)
        self._masses = request.state.bead_masses()
        # what fixes make of the forces, where these are not just the ones that the simulation has
        self._replaced = bool(request.state.fixes_of("setforce"))
        if "virial_tensor" in request.needs:
            require_stress(built.plan)
        #: Fields of DeckSample that :meth:`light` measures.
        self.light_needs = frozenset(("positions", "velocities", "fields", "kinetic"))
        if why_no_stress(built.plan) is None:
            self.light_needs |= {"virial_tensor", "virial"}

    def full(self, step: int, needs: frozenset[str], cpu: float) -> tuple[DeckSample, Sample]:
        """A sample with energies and virial, and the fields of ``needs``.  ``virial`` counts what LAMMPS counts: the dissipative and random
        parts only if they are forces."""
        measured = self.observer.sample(self.context)
        # of all beads, as LAMMPS has them: those that do not move feel forces too
        forces, before = measured.forces, None
        if self._replaced or "before" in needs:
            forces, before = self._acted_on(step, measured.untaken)
        friction, predicts = measured.virial_dissipative + measured.virial_random, scheme_of(self.request.scheme).predicts
        virial = measured.virial_conservative + (friction if predicts else 0.0)
        sample = DeckSample(
            pair_energy=measured.pair,
            short_energy=measured.coulomb_real,
            lattice_energy=measured.coulomb_reciprocal,
            bond_energy=measured.bond,
            angle_energy=measured.angle,
            dihedral_energy=measured.dihedral,
            virial_full=virial if predicts else virial + friction,
            force_norm=float(np.sqrt(np.sum(forces**2))),
            force_max=float(np.abs(forces).max()),
            kT_conf=measured.kT_conf,
            forces=forces if "forces" in needs else None,
            before=before,
            **self._light(step, (needs | {"kinetic"}) - {"virial"}, cpu) | {"virial": virial},
        )
        return sample, measured

    def _acted_on(self, step: int, forces: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Forces of the simulation, as if all of them acted on all beads, as the deck's fixes make them; and what each fix has found."""
        state = self.request.state
        moment, unit = Resolver(state, self.light(step, frozenset(("positions",)), 0.0), self.request.window), state.units.force
        added, _ = acted_on(moment, np.zeros_like(forces))
        found, before = acted_on(moment, forces / unit - added)
        return found * unit, {name: vector * unit for name, vector in before.items()}

    def light(self, step: int, needs: frozenset[str], cpu: float) -> DeckSample:
        """A sample without energies: the fields of ``needs``, which are among :attr:`light_needs`."""
        energies: dict[str, Any] = dict.fromkeys(("short_energy", "lattice_energy", "bond_energy", "angle_energy", "dihedral_energy"))
        return DeckSample(**energies, **self._light(step, needs, cpu))

    def _light(self, step: int, needs: frozenset[str], cpu: float) -> dict[str, Any]:
        present = self.observer.present
        present.look(self.context)
        found: dict[str, Any] = {"step": step, "cpu": cpu, "box": present.box, "slide": slide_of(self.built, self.context)}
        if needs & {"positions", "velocities"}:
            found["positions"], found["velocities"] = present.x, present.with_flow
        if needs & {"kinetic", "virial_tensor"}:
            # of all beads, with the velocity that those have which do not move: LAMMPS counts them
            products = second_moments(self._masses, self._velocities(found["slide"]))
            found |= {"kinetic": float(products[:3].sum()) / 2, "kinetic_tensor": products}
        if needs & {"virial", "virial_tensor"}:
            found["virial_tensor"] = present.stress()
            found["virial"] = float(found["virial_tensor"][:3].sum())
        if "fields" in needs:
            found["fields"] = read_fields(self.context, self.built.plan)
        return found

    def _velocities(self, slide: Slide) -> np.ndarray:
        """Velocities (N, 3), in a shear those of beads in the box with the flow, which LAMMPS counts."""
        present, state = self.observer.present, self.request.state
        if not slide.speed:
            return present.v
        sample = DeckSample(0, positions=present.x, velocities=present.with_flow, box=present.box, slide=slide)
        return Resolver(state, sample, self.request.window).velocities * state.units.velocity
