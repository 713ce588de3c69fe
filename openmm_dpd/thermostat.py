"""A DPD thermostat for a System made elsewhere, by openmm.app.ForceField say: it takes the place of Langevin dynamics.

Unlike Langevin friction, pairwise friction conserves momentum and leaves hydrodynamics intact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import openmm
from openmm import unit

from .errors import ParameterError, PlanError, what_is
from .forces.pair_force import PairForceFunction, pair_force
from .integrators import Made, PairIntegrator, groups_of, masses_of, refuse_thermostat
from .kernels.engine import PairSpec
from .kernels.sweeps import EXACT, SHARDLOW
from .kinds import BeadData, kind_for
from .model.pairs import DPD, NONE, PairCoefficient, checked, describe
from .model.scene import TemperatureRamp, thermal_energy
from .model.table import PairTable, require_complete
from .names import PAIR_FORCE
from .plan import check_cutoffs, check_lam, checked_seed, tau_ratio
from .program_options import ProgramOptions
from .programs import make_program
from .schemes import scheme_of
from .units import to_md

#: Names of OpenMM's platforms, present here or not.
PLATFORMS = ("Reference", "CPU", "OpenCL", "CUDA", "HIP")


def add_thermostat(
    system: openmm.System,
    friction: DPD | PairTable | Mapping,
    temperature,
    dt,
    *,
    types: Sequence[str | None] | None = None,
    scheme: str = "middle",
    lam: float = 0.5,
    platform: str | None = None,
    seed: int | None = None,
) -> PairIntegrator:
    """Add pairwise friction and noise to a System, and make the integrator that runs it.

    The System gets one PythonForce, in the highest free force group and outside the integration groups; all its other forces act, and so do
    those that are added until a Context is made.

    With constraints the pair updates are exact only to first order in dt times the friction rate of a particle (the sum over its
    neighbours of gamma w^2/m): part of the noise pushes along constraints, which take it away.  Rigid TIP3P water at 2 fs with friction on
    all atoms within 0.8 nm is 3 % cold at gamma = 50 Da/ps (a rate of 1,000/ps on hydrogen) and
    0.4(2) % at 5 Da/ps, which still damps a hundred times as hard as Langevin dynamics at 1/ps.  Sensible values are 0.1 to 5 Da/ps.

    Parameters
    ----------
    system : openmm.System
        Constraints and virtual sites are respected with the scheme ``middle``.
    friction : DPD, PairTable or mapping
        Friction between all particles (a DPD with A = 0), or a table by type names.
    temperature : temperature, energy or TemperatureRamp
        Bare numbers are in kelvin here, as for OpenMM's integrators; those of a TemperatureRamp are kJ/mol as everywhere else, so give
        it Quantities.
    dt : time
        Step size (bare numbers: ps).
    types : sequence of str or None, optional
        Type name of each particle if ``friction`` is a table; None leaves a particle out of friction and noise.  Particles of mass 0
        (virtual sites, frozen atoms) are always left out.
    scheme, lam, platform, seed
        As in :func:`openmm_dpd.build.build`; ``platform`` only tunes the length of the trial drift of schemes that need one.

    Returns
    -------
    PairIntegrator
        A CustomIntegrator with ``getTemperature`` and ``setTemperature``.

    Raises
    ------
    ParameterError, PlanError
        If a value is out of bounds, a type pair is unset, A is not 0, the cutoff is over half the box, no force group is free, the
        System has a thermostat or a CMMotionRemover already, or the scheme cannot keep its constraints.

    Examples
    --------
    >>> import openmm, openmm_dpd as dpd
    >>> from openmm import unit
    >>> system = openmm.System()
    >>> for _ in range(8):
    ...     _ = system.addParticle(39.9 * unit.dalton)
    >>> friction = dpd.DPD(gamma=50, cutoff=0.6 * unit.nanometer)
    >>> integrator = dpd.add_thermostat(system, friction, 300 * unit.kelvin, 2 * unit.femtosecond, seed=1)
    """
    chosen = scheme_of(scheme)
    if chosen.native:
        raise ParameterError(f"the scheme {chosen.name!r} is OpenMM's own thermostat; make a DPDIntegrator for a System made elsewhere")
    step = to_md(dt, "time", "dt")
    if not isinstance(step, float) or step <= 0:
        raise ParameterError(f"dt must be a single time > 0, not {dt!r}")
    lam = checked(lam, "dimensionless", "lam")
    if lam > 1:
        raise ParameterError(f"lam (lambda of the modified velocity Verlet scheme) must be between 0 and 1, but is {lam:g}")
    check_lam(lam, chosen)
    if platform not in (None, *PLATFORMS):
        raise ParameterError(f"platform must be the name of one of OpenMM's platforms ({', '.join(PLATFORMS)}), not {platform!r}")
    check_system(system)
    ramp, kT = _temperature(temperature)
    masses = masses_of(system)
    kind, names, table, numbers = _types(friction, types, masses)
    for key, coefficient in table.items():
        if coefficient is NONE:
            continue
        if coefficient.has_conservative:
            raise ParameterError(
                f"for types {key}: a thermostat has no repulsion, but this is {describe(coefficient)}; give the System a force of its own"
            )
        for energy in (kT,) if ramp is None else (ramp.kT_start, ramp.kT_end):
            coefficient.check_temperature(energy)
    if not any(coefficient.has_thermostat for coefficient in table.values() if coefficient is not NONE):
        raise ParameterError("no pair of types has any friction or noise; give the DPD a gamma, gamma_perp or sigma > 0")
    periodic = system.usesPeriodicBoundaryConditions()
    if periodic:
        vectors = system.getDefaultPeriodicBoxVectors()
        check_cutoffs(
            np.array([[getattr(row, axis) for axis in "xyz"] for row in (v.value_in_unit(unit.nanometer) for v in vectors)]), [table]
        )
    options = ProgramOptions(
        scheme=chosen,
        dt=step,
        kT=kT,
        seed=checked_seed(seed),
        lam=lam,
        constraints=system.getNumConstraints() > 0 or any(system.isVirtualSite(k) for k in range(len(masses))),
        ramp=ramp,
        settable=ramp is None,
        pair_group=free_group(system),
        seeded=seed is not None,
        tau_ratio=tau_ratio(platform),
    )
    integrator = make_program(options).lower()
    integrator.setIntegrationForceGroups(set(range(32)) - {options.pair_group})
    assert kind.terms is not None
    spec = PairSpec(
        types=numbers,
        inv_mass=np.divide(1.0, masses, out=np.zeros_like(masses), where=masses > 0),
        terms=(kind.terms(table, BeadData(names, masses)),),
        update=SHARDLOW if chosen.shardlow else EXACT,
    )
    force = pair_force(PairForceFunction(spec, conservative=False, periodic=periodic), options=options, integrator=integrator)
    system.addForce(force)
    integrator.made = Made.of("add_thermostat()", system, [force], options)
    return integrator


def free_group(system: openmm.System) -> int:
    """The highest force group that no force of a System is in.

    Raises
    ------
    PlanError
        If there is none.
    """
    free = set(range(32)).difference(*map(groups_of, system.getForces()))
    if not free:
        raise PlanError("the forces of the System are in all 32 force groups, and the pair terms need one for themselves")
    return max(free)


def _temperature(temperature) -> tuple[TemperatureRamp | None, float]:
    """The ramp, if it is one, and the thermal energy at the first step."""
    if isinstance(temperature, TemperatureRamp):
        return temperature, temperature.at(0)
    if not unit.is_quantity(temperature):
        temperature = to_md(temperature, "temperature", "temperature") * unit.kelvin
    return None, thermal_energy(temperature, "temperature")


def _types(friction, types, masses: np.ndarray):
    """Kind of the friction, type names, resolved table, and type number of each particle (-1: left out)."""
    if isinstance(friction, PairCoefficient):
        if types is not None:
            raise ParameterError("types are given, but friction is the same for all particles; give a PairTable by type names, or no types")
        friction, types = PairTable({("*", "*"): friction}), ["particle"] * len(masses)
    if not isinstance(friction, (PairTable, Mapping)):
        raise ParameterError(f"friction must be a DPD, or a table of them by type names, not {what_is(friction)}")
    table = friction if isinstance(friction, PairTable) else PairTable(friction)
    if table.kind is None or not kind_for(table.kind).thermostat:
        raise ParameterError("friction must be a DPD, or a table of them by type names")
    if types is None:
        raise ParameterError("friction is a table by type names, so `types` must name the type of each particle")
    if len(types) != len(masses):
        raise ParameterError(f"types names {len(types)} particles, but the System has {len(masses)}")
    odd = next((name for name in types if not isinstance(name, (str, type(None)))), None)
    if odd is not None:
        raise ParameterError(f"types must hold the name of each particle's type, or None; one is {odd!r}")
    names = sorted({name for name in types if name is not None})
    if not names:
        raise ParameterError("every particle is left out of the thermostat")
    require_complete([table], names)
    number = {name: k for k, name in enumerate(names)}
    numbers = np.array(
        [-1 if name is None or mass == 0 else number[name] for name, mass in zip(types, masses, strict=True)], dtype=np.int32
    )
    if np.all(numbers < 0):
        raise ParameterError("every particle is left out of the thermostat: those with a type name have mass 0")
    return kind_for(table.kind), names, table.resolve(names), numbers


def degrees_of_freedom(system: openmm.System, *, momentum: bool = True) -> int:
    """Degrees of freedom that share the kinetic energy of a System under a DPD thermostat, for its temperature 2K/(f k_B).

    Three for each particle that moves, less one for each constraint, less three for the total momentum, which pairwise friction
    conserves.  ``openmm.app.StateDataReporter`` takes those three off only if the System has a CMMotionRemover.

    Parameters
    ----------
    system : openmm.System
    momentum : bool, default True
        Take the three of the momentum off.  Nothing is taken off where frozen particles (mass 0, no virtual sites) take up momentum, or if
        there is not more than one particle.
    """
    count = range(system.getNumParticles())
    moves = [system.getParticleMass(k).value_in_unit(unit.dalton) > 0 for k in count]
    frozen = any(not moves[k] and not system.isVirtualSite(k) for k in count)
    tied = [system.getConstraintParameters(k)[:2] for k in range(system.getNumConstraints())]
    found = 3 * sum(moves) - sum(moves[i] or moves[j] for i, j in tied)
    return found - 3 if momentum and not frozen and found > 3 else found


def check_system(system: openmm.System) -> None:
    """Raise an error if this is no System, or one that a DPD thermostat cannot be added to."""
    if not isinstance(system, openmm.System):
        raise ParameterError(f"the thermostat is added to an openmm.System, not to a {type(system).__name__}")
    for force in system.getForces():
        if force.getName() == PAIR_FORCE:
            raise PlanError("the System has DPD pair terms already; a table by type names holds several coefficients at once")
        refuse_thermostat(force)


__all__ = ["add_thermostat", "check_system", "degrees_of_freedom"]
