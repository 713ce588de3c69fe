"""Measuring a running simulation, for thermo output and for averages: no more than is asked for."""

from __future__ import annotations

import numpy as np
import openmm
from openmm import unit

from ...build import BuiltSystem
from ...fields import read_fields
from ...geometry import symmetric_products
from ...measure import Sample
from ...measure.scene_samples import SceneSampler
from ...measure.stress_sums import StressSums
from ...schemes import scheme_of
from ..state.sample import DeckSample
from ..values.force_fixes import acted_on
from ..values.resolver import Resolver
from .request import RunRequest

_NM, _V = unit.nanometer, unit.nanometer / unit.picosecond

#: Fields of DeckSample that need no forces and no energies.
CHEAP = frozenset(("positions", "velocities", "fields"))


def arrays(context: openmm.Context):
    """Positions, velocities and box vectors."""
    state = context.getState(positions=True, velocities=True)
    x, v = state.getPositions(asNumpy=True).value_in_unit(_NM), state.getVelocities(asNumpy=True).value_in_unit(_V)
    return x, v, state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(_NM)


class Sampler:
    """Takes samples during one run.

    Parameters
    ----------
    request : RunRequest
    built : BuiltSystem
    context : openmm.Context
    """

    def __init__(self, request: RunRequest, built: BuiltSystem, context: openmm.Context):
        self.request, self.built, self.context = request, built, context
        self.observer = SceneSampler(built)
        self._masses = request.state.bead_masses()
        # what fixes make of the forces, where these are not just the ones that the simulation has
        self._replaced = any(fix.style == "setforce" for fix in request.state.fixes.values())
        plan = built.plan
        # OpenMM sums virials of potentials under a thermostat in single precision on the CPU platform; with lattice sums ours are dear
        self._single = bool(plan.overlays) and plan.ewald is None and StressSums.why_not(plan) is None
        self._stress = StressSums(plan) if self._single or "virial_tensor" in request.needs else None

    def full(self, step: int, needs: frozenset[str], cpu: float) -> tuple[DeckSample, Sample]:
        """A sample with energies and virial, and the fields of ``needs``.

        ``virial`` counts what LAMMPS counts: the dissipative and random parts only if they are forces.
        """
        measured = self.observer.sample(self.context)
        # of all beads, as LAMMPS has them: those that do not move feel forces too
        forces, before = measured.forces, None
        if self._replaced or "before" in needs:
            forces, before = self._acted_on(step, measured.untaken)
        products = self._kinetic_tensor()
        friction, predicts = measured.virial_dissipative + measured.virial_random, scheme_of(self.request.scheme).predicts
        virial = measured.virial_conservative + (friction if predicts else 0.0)
        tensor = None
        if self._stress is not None and (self._single or "virial_tensor" in needs):
            tensor = self._stress.counted(self.context, self.observer)
            virial = float(tensor[:3].sum())
        sample = DeckSample(
            step=step,
            kinetic=float(products[:3].sum()) / 2,
            kinetic_tensor=products,
            pair_energy=measured.pair,
            short_energy=measured.coulomb_real,
            lattice_energy=measured.coulomb_reciprocal,
            bond_energy=measured.bond,
            angle_energy=measured.angle,
            virial=virial,
            virial_full=virial if predicts else virial + friction,
            virial_tensor=tensor,
            force_norm=float(np.sqrt(np.sum(forces**2))),
            force_max=float(np.abs(forces).max()),
            kT_conf=measured.configurational_kT,
            box=measured.box,
            cpu=cpu,
            forces=forces if "forces" in needs else None,
            before=before,
            **self._of_beads(needs),
        )
        return sample, measured

    def _acted_on(self, step: int, forces: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Forces of the simulation, as if all of them acted on all beads, as the deck's fixes make them; and what each fix has found."""
        state = self.request.state
        moment, unit = Resolver(state, self.cheap(step, frozenset(("positions",)), 0.0), self.request.window), state.units.force
        added, _ = acted_on(moment, np.zeros_like(forces))
        found, before = acted_on(moment, forces / unit - added)
        return found * unit, {name: vector * unit for name, vector in before.items()}

    def _kinetic_tensor(self) -> np.ndarray:
        """(6,) sums of m v v over all beads, with the velocity that those have which do not move: LAMMPS counts them."""
        velocities = arrays(self.context)[1]
        return symmetric_products(self._masses[:, None] * velocities, velocities)

    def cheap(self, step: int, needs: frozenset[str], cpu: float) -> DeckSample:
        """A sample with values of beads and the box only."""
        box = self.context.getState().getPeriodicBoxVectors(asNumpy=True).value_in_unit(_NM)
        energies = dict.fromkeys(("short_energy", "lattice_energy", "bond_energy", "angle_energy"))
        return DeckSample(step=step, box=box, cpu=cpu, **energies, **self._of_beads(needs))

    def _of_beads(self, needs: frozenset[str]) -> dict:
        found: dict = {}
        if needs & {"positions", "velocities"}:
            found["positions"], found["velocities"], _ = arrays(self.context)
        if "fields" in needs:
            found["fields"] = read_fields(self.context, self.built.plan)
        return found
