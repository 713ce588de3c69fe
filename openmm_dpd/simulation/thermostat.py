"""A DPD thermostat for a System made elsewhere, by openmm.app.ForceField say: it takes the place of Langevin dynamics.

Unlike Langevin friction, pairwise friction conserves momentum and leaves hydrodynamics intact.
"""

import copy
from collections.abc import Mapping, Sequence

import numpy as np
import openmm
from openmm import app, unit

from ..base.errors import ParameterError, what_is
from ..base.openmm_private import masses_of
from ..base.units import thermal_energy_of
from ..model.pairs import DPD, NONE, PairCoefficient, PairTable, describe, require_complete
from ..model.scene import Scene
from ..model.schemes import scheme_of
from ..model.temperature import TemperatureRamp
from ..plan.choices import platform_name
from ..plan.kinds import kind_for
from ..plan.made import Host, box_of, check_system, checked_positions
from ..plan.plan import make_plan
from .build import build_plan, run_in
from .built import BuiltSystem

#: Class of particles without friction and noise.
UNSEEN = "(unseen)"


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
    topology: app.Topology | None = None,
    positions=None,
    engine: str = "auto",
) -> BuiltSystem:
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
        Friction between all particles (a DPD with A = 0), or a table by type names.  It reaches 1 nm unless a ``cutoff`` is given.
    temperature : temperature, energy or TemperatureRamp
        Bare numbers are in kelvin here, as for OpenMM's integrators; those of a TemperatureRamp are kJ/mol as everywhere else, so give
        it Quantities.
    dt : time
        Step size (bare numbers: ps).
    types : sequence of str or None, optional
        Type name of each particle if ``friction`` is a table; None leaves a particle out of friction and noise.  Particles of mass 0
        (virtual sites, frozen atoms) are always left out.
    scheme, lam, platform, seed
        As in :func:`openmm_dpd.simulation.build.build`; ``platform`` tunes the length of the trial drift of schemes that need one, and is
        where ``simulation()`` runs.
    topology : openmm.app.Topology, optional
        For ``simulation()``; not needed if you make your own ``app.Simulation(topology, system, built.integrator)``.
    positions : (N, 3) array of lengths, optional
        Likewise.
    engine : str, default "auto"
        As in :func:`openmm_dpd.simulation.build.build`.

    Returns
    -------
    BuiltSystem
        With ``integrator``, a CustomIntegrator with ``getTemperature`` and ``setTemperature``, and ``system``, the one that was given.

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
    >>> built = dpd.add_thermostat(system, friction, 300 * unit.kelvin, 2 * unit.femtosecond, seed=1)
    >>> built.integrator.getTemperature()
    300.0 K
    """
    if scheme_of(scheme).native:
        name = scheme_of(scheme).name
        raise ParameterError(f"the scheme {what_is(name)} is OpenMM's own thermostat; make a DPDIntegrator for a System made elsewhere")
    chosen = platform_name(platform)
    check_system(system)
    masses = masses_of(system)
    table, classes = _types(friction, types, masses)
    names = sorted({name for name in classes if name is not None})
    friction_of = table.resolve(names)
    _check_friction(friction_of)
    x = None if positions is None else checked_positions(topology, system, positions)
    moves = masses > 0
    unseen = {} if None not in classes else {(other, UNSEEN): NONE for other in (*names, UNSEEN)}
    scene = Scene(
        masses=dict.fromkeys([*names, *([UNSEEN] if unseen else [])], 1.0),
        types=[name or UNSEEN for name in classes],
        positions=np.zeros((len(masses), 3)) if x is None else x,
        pairs=PairTable({**friction_of, **unseen}),
        kT=temperature if isinstance(temperature, TemperatureRamp) else thermal_energy_of(temperature),
        box=box_of(system),
        bead_masses=np.where(moves, masses, 1.0),
        mobile=None if moves.all() else moves,
    )
    left_out = ~moves | np.array([name is None for name in classes])
    if left_out.all():
        raise ParameterError("every particle is left out of the thermostat: those with a type name have mass 0")
    plan = make_plan(scene, dt=dt, scheme=scheme, lam=lam, platform=chosen, seed=seed, engine=engine, host=Host.of(system, left_out))
    built = build_plan(plan)
    (force,) = map(copy.deepcopy, built.system.getForces())
    system.addForce(force)
    run_in(built, system, [force], "add_thermostat()")
    built.topology, built.positions = topology, None if x is None else x * unit.nanometer
    return built


def _check_friction(table: Mapping) -> None:
    """Raise ParameterError for a table with a repulsion, or without any friction."""
    found = [(key, coefficient) for key, coefficient in table.items() if coefficient is not NONE]
    for key, coefficient in found:
        if coefficient.has_conservative:
            raise ParameterError(
                f"for types {key}: a thermostat has no repulsion, but this is {describe(coefficient)}; give the System a force of its own"
            )
    if not any(coefficient.has_thermostat for _, coefficient in found):
        raise ParameterError("no pair of types has any friction or noise; give the DPD a gamma, gamma_perp or sigma > 0")


def _types(friction, types, masses: np.ndarray) -> tuple[PairTable, list[str | None]]:
    """The table of friction, and the type name of each particle (None: left out)."""
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
        raise ParameterError(f"types must hold the name of each particle's type, or None; one is {what_is(odd)}")
    names = sorted({name for name in types if name is not None})
    if not names:
        raise ParameterError("every particle is left out of the thermostat")
    require_complete([table], names)
    return table, list(types)
