"""Measured quantities of a running scene: temperatures, energies, virials and pressures, momentum, and forces term by term.

Kinetic temperature: 2K/(3N - 3), over the beads that move (all schemes here conserve momentum).  Configurational temperature:
<|grad U|^2>/<lap U>, a ratio of averages, which shows errors of the configurations that a thermostat hides from the kinetic one (Rugh,
Phys. Rev.
Lett. 78, 772 (1997); Allen, J. Phys. Chem. B 110, 3823 (2006)).  Pressure: (2K + W)/(3V) with the virial W = sum over pairs of r_ij . F_ij.
OpenMM's own reporters use 3N degrees of freedom, kelvin, and no pair term.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import openmm
from openmm import unit

from .build import Built
from .errors import RunError
from .forces.expressions import VIRIAL_SWITCH
from .kernels.engine import CONSERVATIVE, DISSIPATIVE, RANDOM, PairEngine
from .model.scene import TemperatureRamp
from .names import COUNTER, KT, SEED, VIRIAL_GROUP
from .plan import Plan
from .units import BOLTZMANN

_NM, _KJ, _V = unit.nanometer, unit.kilojoule_per_mole, unit.nanometer / unit.picosecond


@dataclass(frozen=True)
class Sample:
    """What one configuration says; MD units (nm, Da, ps, kJ/mol; pressures in kJ/mol/nm^3).

    Attributes
    ----------
    step, time : steps done and time
    n_mobile, dof : beads that move, and their degrees of freedom, 3N - 3
    kinetic, pair, bond : energies
    virial_conservative, virial_dissipative, virial_random : sums of r_ij . F_ij
    volume : nm^3, or None without a box
    box : (3, 3) box vectors or None
    gradient2 : sum over mobile beads of the squared conservative force
    force_norm, force_max : length of the vector of all conservative forces, and its largest component
    laplacian : sum over mobile beads of the Laplacian of the potential energy, or None (see ``no_laplacian``)
    momentum : (3,) total momentum
    target_kT : thermal energy the thermostat is set to
    """

    step: int
    time: float
    n_mobile: int
    dof: int
    kinetic: float
    pair: float
    bond: float
    virial_conservative: float
    virial_dissipative: float
    virial_random: float
    volume: float | None
    box: np.ndarray | None
    gradient2: float
    force_norm: float
    force_max: float
    laplacian: float | None
    momentum: np.ndarray
    target_kT: float

    @property
    def potential(self) -> float:
        """Potential energy: pairs and bonds."""
        return self.pair + self.bond

    @property
    def kT(self) -> float:
        """Kinetic temperature as an energy, 2K/(3N - 3)."""
        return 2.0 * self.kinetic / self.dof if self.dof else 0.0

    @property
    def configurational_kT(self) -> float | None:
        """This configuration's |grad U|^2 / lap U; average both before dividing."""
        return None if not self.laplacian else self.gradient2 / self.laplacian

    def pressure(self, full: bool = True) -> float | None:
        """(2K + W)/(3V) with all pair terms, or with the conservative ones only; None without a box."""
        if self.volume is None:
            return None
        virial = self.virial_conservative + ((self.virial_dissipative + self.virial_random) if full else 0.0)
        return (2.0 * self.kinetic + virial) / (3.0 * self.volume)


class Observer:
    """Takes samples from a Context that runs a built scene.

    Parameters
    ----------
    built : Built
        The scene's System, integrator and plan.
    """

    def __init__(self, built: Built):
        self.built, self.plan = built, built.plan
        self._engine = PairEngine(self.plan.spec) if self.plan.layers else None
        self._groups = built.integrator.getIntegrationForceGroups()
        self._mass = np.array([m.value_in_unit(unit.dalton) for m in map(built.system.getParticleMass, range(self.plan.scene.n_beads))])

    @property
    def no_laplacian(self) -> str | None:
        """Why there is no configurational temperature, or None."""
        if self.plan.partners:
            return "a conservative term (Lennard-Jones or tabulated) has no Laplacian here"
        if not self.plan.layers or (self.plan.conservative == "none" and not len(self.plan.scene.bond_pairs)):
            return "there is no conservative force"
        return None

    def sample(self, context: openmm.Context) -> Sample:
        """Measure the present state of a Context."""
        plan = self.plan
        state = context.getState(positions=True, velocities=True, forces=True, energy=True, groups=self._groups)
        x = state.getPositions(asNumpy=True).value_in_unit(_NM)
        v = state.getVelocities(asNumpy=True).value_in_unit(_V)
        mobile = self._mass > 0
        force = state.getForces(asNumpy=True).value_in_unit(_KJ / _NM)[mobile]
        potential = state.getPotentialEnergy().value_in_unit(_KJ)
        if not (np.isfinite(potential) and np.all(np.isfinite(v))):
            raise RunError(f"the energy or a velocity is not finite at step {state.getStepCount()}; the step size may be too large")
        box = None if plan.scene.box is None else state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(_NM)
        bond, bond_virial, bond_laplacian = bond_sums(plan, x, box, mobile)
        mass = self._mass[mobile][:, None]
        seen = v
        if plan.options.scheme == "middle":
            # its velocities are half a kick behind the positions, which would show as a spurious drag of pairs that repel
            seen = v.copy()
            seen[mobile] += 0.5 * context.getIntegrator().getStepSize().value_in_unit(unit.picosecond) * force / mass
        if plan.options.scheme == "mvv" and plan.options.thermostat:
            # the friction in the force saw half-step velocities; LAMMPS's pressure counts it so (no history yet: acc is 0)
            acc = np.array(context.getIntegrator().getPerDofVariableByName("acc"), dtype=np.float64)
            seen = v - 0.5 * context.getIntegrator().getStepSize().value_in_unit(unit.picosecond) * acc
        virials = self._pair_virials(context, x, seen, box)
        gradient2 = float(np.sum(force**2))
        return Sample(
            step=state.getStepCount(),
            time=state.getTime().value_in_unit(unit.picosecond),
            n_mobile=int(mobile.sum()),
            dof=max(0, 3 * int(mobile.sum()) - 3),
            kinetic=0.5 * float(np.sum(mass * v[mobile] ** 2)),
            pair=potential - bond,
            bond=bond,
            virial_conservative=virials[0] + bond_virial,
            virial_dissipative=virials[1],
            virial_random=virials[2],
            volume=None if box is None else float(np.prod(np.diag(box))),
            box=box,
            gradient2=gradient2,
            force_norm=gradient2**0.5,
            force_max=float(np.abs(force).max(initial=0.0)),
            laplacian=None if self.no_laplacian or self._engine is None else self._engine.laplacian() + bond_laplacian,
            momentum=np.sum(mass * v[mobile], axis=0),
            target_kT=noise_state(context, plan)[0],
        )

    def _pair_virials(self, context, x, v, box) -> tuple[float, float, float]:
        """Conservative, dissipative and random virial; leaves the engine prepared at x."""
        parts = [0.0, 0.0, 0.0]
        if self._engine is not None:
            self._engine.prepare(x, box)
            kT, seed, counter, dt = noise_state(context, self.plan)
            if self.plan.options.scheme != "mvv":
                # the last sweep's noise has already moved the beads; as a force it would be correlated with their positions
                counter += 1
            for k, which in enumerate((CONSERVATIVE, DISSIPATIVE, RANDOM)):
                parts[k] = self._engine.forces(which, v, kT, dt, seed, counter)[2]
        if self.plan.partners:
            context.setParameter(VIRIAL_SWITCH, 1.0)
            groups = {VIRIAL_GROUP - k for k in range(10)}
            try:
                parts[0] += context.getState(energy=True, groups=groups).getPotentialEnergy().value_in_unit(_KJ)
            finally:
                context.setParameter(VIRIAL_SWITCH, 0.0)
        return parts[0], parts[1], parts[2]


def noise_state(context: openmm.Context, plan: Plan) -> tuple[float, int, int, float]:
    """Thermal energy, seed, noise counter and step size of a Context."""
    dt = context.getIntegrator().getStepSize().value_in_unit(unit.picosecond)
    if KT not in context.getParameters():
        return plan.options.kT, plan.options.seed, context.getStepCount(), dt
    return context.getParameter(KT), int(context.getParameter(SEED)), int(context.getParameter(COUNTER)), dt


def bond_sums(plan: Plan, x: np.ndarray, box: np.ndarray | None, mobile: np.ndarray) -> tuple[float, float, float]:
    """Energy, virial and Laplacian of harmonic bonds U = k (r - r0)^2 at the positions x.

    The Laplacian is U'' + 2U'/r = 2k + 4k (r - r0)/r per bond and mobile bead.
    """
    energy = virial = laplacian = 0.0
    for bonds in plan.scene.bonds:
        i, j = bonds.pairs.T
        d = x[i] - x[j]
        if box is not None:
            for k in (2, 1, 0):
                d -= np.outer(np.rint(d[:, k] / box[k, k]), box[k])
        r = np.linalg.norm(d, axis=1)
        stretch = r - bonds.r0
        energy += float(np.sum(bonds.k * stretch**2))
        virial -= float(np.sum(2 * bonds.k * stretch * r))
        ends = mobile[i].astype(float) + mobile[j]
        with np.errstate(divide="ignore", invalid="ignore"):
            laplacian += float(np.sum(ends * np.where(r > 1e-10, 2 * bonds.k + 4 * bonds.k * stretch / r, 0.0)))
    return energy, virial, laplacian


def force_terms(
    built: Built, positions=None, velocities=None, *, counter: int = 1, properties: dict[str, str] | None = None
) -> dict[str, np.ndarray]:
    """Forces term by term at given positions and velocities, always in force form, whatever the scheme.

    Parameters
    ----------
    built : Built
    positions, velocities : (N, 3) arrays, optional
        nm and nm/ps; the scene's own by default.
    counter : int
        Count of the noise; another count gives independent random forces.
    properties : dict, optional
        Platform properties.

    Returns
    -------
    dict of (N, 3) arrays, kJ/mol/nm
        ``conservative`` (all pair potentials, from the plan's platform), ``bond`` if there are bonds, ``dissipative`` and ``random``.
        They add up to the total force.
    """
    plan = built.plan
    scene, spec = plan.scene, plan.spec
    x = np.ascontiguousarray(scene.positions if positions is None else positions, dtype=np.float64)
    v = np.ascontiguousarray(built.velocities.value_in_unit(_V) if velocities is None else velocities, dtype=np.float64)
    # an integrator belongs to one Context: this one is thrown away
    integrator = openmm.VerletIntegrator(plan.options.dt)
    context = openmm.Context(built.system, integrator, openmm.Platform.getPlatformByName(plan.platform), properties or {})
    context.setPositions(x)
    groups = built.integrator.getIntegrationForceGroups()
    terms = {}
    if len(scene.bond_pairs):
        terms["bond"] = _forces(context, {0})
        groups = {g for g in range(32) if groups & (1 << g)} - {0} if isinstance(groups, int) else set(groups) - {0}
    terms["conservative"] = _forces(context, groups)
    engine = PairEngine(spec)
    engine.prepare(x, scene.box)
    for name, which in (("dissipative", DISSIPATIVE), ("random", RANDOM)):
        terms[name] = engine.forces(which, v, scene.initial_kT, plan.options.dt, plan.options.seed, counter)[1]
    return terms


def _forces(context: openmm.Context, groups) -> np.ndarray:
    return context.getState(forces=True, groups=groups).getForces(asNumpy=True).value_in_unit(_KJ / _NM)


def set_temperature(context: openmm.Context, temperature) -> None:
    """Set the thermal energy of a running Context (energy, or a Quantity in kelvin); not for scenes with a temperature ramp."""
    from .model.scene import thermal_energy

    context.setParameter(KT, thermal_energy(temperature))


def kelvin(kT: float) -> float:
    """Temperature in kelvin of a thermal energy in kJ/mol."""
    return kT / BOLTZMANN


__all__ = ["Observer", "Sample", "TemperatureRamp", "bond_sums", "force_terms", "kelvin", "noise_state", "set_temperature"]
