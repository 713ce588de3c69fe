"""Measuring a running simulation, for thermo output and for averages: no more than is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import openmm
from openmm import unit

from ...build import BuiltSystem
from ...fields import read_fields
from ...geometry import symmetric_products
from ...made import masses_of
from ...measure import Sample
from ...measure.scene_samples import SceneSampler
from ...measure.stress_sums import StressSums
from ...schemes import scheme_of
from ..scene.flow import held_beads
from ..state.sample import DeckSample
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
        self.held = held_beads(request.state)
        self._stress = StressSums(built.plan) if "virial_tensor" in request.needs else None

    def full(self, step: int, needs: frozenset[str], cpu: float) -> tuple[DeckSample, Sample]:
        """A sample with energies and virial, and the fields of ``needs``.

        ``virial`` counts what LAMMPS counts: the dissipative and random parts only if they are forces.
        """
        measured = self.observer.sample(self.context)
        assert measured.forces is not None
        # of all beads, as LAMMPS has them: those that do not move feel forces too, but for those that fix setforce has taken
        forces = np.where(self.held[:, None], 0.0, measured.forces)
        full = measured.virial_conservative + measured.virial_dissipative + measured.virial_random
        sample = DeckSample(
            step=step,
            kinetic=measured.kinetic,
            dof=measured.dof,
            pair_energy=measured.pair,
            short_energy=measured.coulomb_real,
            lattice_energy=measured.coulomb_reciprocal,
            bond_energy=measured.bond,
            angle_energy=measured.angle,
            virial=full if scheme_of(self.request.scheme).predicts else measured.virial_conservative,
            virial_full=full,
            force_norm=float(np.sqrt(np.sum(forces**2))),
            force_max=float(np.abs(forces).max()),
            kT_conf=measured.configurational_kT,
            box=measured.box,
            cpu=cpu,
            forces=forces if "forces" in needs else None,
            **self._of_beads(needs),
            **(self._tensors() if "virial_tensor" in needs else {}),
        )
        return sample, measured

    def _tensors(self) -> dict[str, Any]:
        """The two parts of the pressure tensor."""
        assert self._stress is not None
        mass = masses_of(self.built.system)[:, None]
        velocities = arrays(self.context)[1]
        return {
            "virial_tensor": self._stress.counted(self.context, self.observer),
            "kinetic_tensor": symmetric_products(mass * velocities, velocities),
        }

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
