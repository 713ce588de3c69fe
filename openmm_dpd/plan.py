"""Scene + choices -> Plan: the least that this scene needs, decided before anything is built."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .charge_forces import charge_factors, ewald_of, few_charges
from .choices import check_cutoffs, checked_interval, checked_lam, checked_seed, checked_step, predicting
from .errors import ParameterError, PlanError, what_is
from .host import Host
from .html import fact_table
from .kernels.engine import PairSpec
from .kernels.fields import ENERGY
from .kinds import Kind, bonded_kind, resolved_kind
from .model.electrostatics import EwaldSum
from .model.flow import gaps, kind_of
from .model.pairs import NONE
from .model.scene import Scene
from .model.temperature import TemperatureRamp
from .names import PAIR_GROUP
from .neighbour_list import listed
from .pair_spec import Factors, longest, neighbour_factors, pair_spec
from .program_options import DOUBLE_PLATFORMS, ProgramOptions, field_options, tau_ratio
from .schemes import Scheme, scheme_of

#: Coefficients by pair of types, all of one kind.
ResolvedTable = dict[tuple[str, str], Any]


@dataclass(frozen=True, eq=False)
class Plan:
    """What will be built.

    Attributes
    ----------
    scene : Scene
        All particles.  Those of a System made elsewhere come first: their classes are further types, their positions those that were given
        (or 0), and their masses stand in ``bead_masses``.
    spec : PairSpec
        The pair terms, for the engine.
    options : ProgramOptions
        What the integrator's program has to know.
    layers, overlays : tuples of tables
        What the pair kernel evaluates, and overlays, each {pair of types: coefficient} of one kind.
    exceptions, charge_exceptions : dict
        Factors of bonded neighbours other than 1.
    conservative : {"kernel", "openmm", "none"}
        Where the conservative force is computed.
    platform : str or None
        Name of the platform.
    ewald : EwaldSum or None
        Settings of the lattice sum of charges.
    unlooped : str or None
        Why the pair kernel does not carry out whole steps, or None if it does.
    charges_held : bool
        Whether the kernel holds the charges.
    host : Host or None
        The System made elsewhere that the pair terms are added to.
    """

    scene: Scene
    spec: PairSpec
    options: ProgramOptions
    layers: tuple[ResolvedTable, ...]
    overlays: tuple[ResolvedTable, ...]
    exceptions: Factors
    conservative: str
    platform: str | None
    ewald: EwaldSum | None = None
    charge_exceptions: Factors = field(default_factory=dict)
    unlooped: str | None = None
    charges_held: bool = False
    host: Host | None = None

    def __repr__(self) -> str:
        options = self.options
        return f"<Plan for {self.platform}: {options.scheme}, dt = {options.dt:g} ps, {self.scene!r}>"

    def _repr_html_(self) -> str:
        return fact_table("Plan", self.facts())

    def facts(self) -> dict[str, object]:
        """What a person wants to know, by name."""
        options = self.options
        known = {"platform": self.platform, "scheme": options.scheme, "dt": f"{options.dt:g} ps", "seed": options.seed}
        if self.host is None:
            return {**known, **self.scene.facts()}
        return {"atoms": self.n_atoms, **known, **self.scene.facts(), "beads": self.scene.n_beads - self.n_atoms or None}

    @property
    def n_atoms(self) -> int:
        """Number of particles of a System made elsewhere; beads come after them."""
        return 0 if self.host is None else len(self.host.masses)

    def listed(self, cutoff: float) -> bool:
        """Whether OpenMM's pair forces with this cutoff can take the pairs from a neighbour list; they go through all pairs otherwise."""
        return listed(self.platform, self.scene.box, cutoff)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kinds of ``layers``."""
        return tuple(map(resolved_kind, self.layers))


def make_plan(
    scene: Scene,
    *,
    dt,
    scheme: str = "middle",
    lam: float = 0.5,
    conservative: str = "auto",
    platform: str | None = None,
    seed: int | None = None,
    loop: bool = True,
    slow_every: int = 1,
    host: Host | None = None,
) -> Plan:
    """Decide what to build.

    Parameters
    ----------
    scene : Scene
    dt : time
        Step size (bare numbers: ps).
    scheme : str, default "middle"
        Name of one of :data:`openmm_dpd.schemes.SCHEMES`, or a word of drifts ``A``, kicks ``B`` and sweeps of pair updates, exact
        ones ``O`` or Shardlow's ``S``, each with its part of the step: ``"B/2 A/2 O A/2 B/2"``.
    lam : float, default 0.5
        Weight of the velocity prediction of ``mvv``, between 0 and 1; 0.5 is plain velocity Verlet.
    conservative : {"auto", "openmm", "kernel"}
        Where the conservative DPD force is computed: a CustomNonbondedForce, or the pair kernel.  ``auto`` takes the kernel on the CPU
        platform, where it is faster, and OpenMM elsewhere (but on the Reference platform in small tilted boxes, where OpenMM would go
        through all pairs, the kernel).
    platform : str, optional
        Name of the platform that will be used, if it is known.
    seed : int, optional
        Seed of the noise, 0 <= seed < 2^31; drawn from the operating system and recorded in the plan by default.
    loop : bool, default True
        Whether the kernel carries out many whole steps at once where it can: where it holds every fast force of the scene, on the CPU and
        Reference platforms, and on others if it holds the conservative force.  Forces that stay OpenMM's (lattice sums of many charges,
        formulas of the position, whatever is added to the System) then kick before and after each step, and a barostat acts at the end
        of up to ten steps.  Otherwise the program does one step at a time.
    slow_every : int, default 1
        In such loops: after how many steps of the Context forces that stay OpenMM's kick (multiple time steps, impulses as in r-RESPA:
        Tuckerman, Berne and Martyna, J. Chem. Phys. 97, 1990 (1992)).
    host : Host, optional
        A System made elsewhere whose particles are the first of the scene; its forces act beside the pair terms.

    Raises
    ------
    ParameterError, PlanError
        If a choice is out of bounds or cannot be combined with the scene.
    """
    if not isinstance(scene, Scene):
        raise ParameterError(f"expected a Scene, not {what_is(scene)}")
    step = checked_step(dt)
    chosen = scheme_of(scheme)
    lam = checked_lam(lam, chosen)
    if conservative not in ("auto", "openmm", "kernel"):
        raise ParameterError(f"conservative must be 'auto', 'openmm' or 'kernel', not {conservative!r}")
    resolved = [table.resolve(scene.type_names) for table in scene.tables]
    tables: list[ResolvedTable] = [table for table in resolved if any(c is not NONE for c in table.values())]
    layers = [table for table in tables if resolved_kind(table).overlay is None]
    overlays = [table for table in tables if resolved_kind(table).overlay is not None]
    kinds = list(map(resolved_kind, layers))
    for group in scene.bonded:
        bonded_kind(type(group))  # or it is refused
    check_cutoffs(scene.box, [*layers, *overlays])
    for kind in kinds:
        if kind.no_sweep and not chosen.predicts:
            raise PlanError(f"{kind.name} {kind.no_sweep}; only scheme={predicting()} runs it, not {chosen.name!r}")
    if scene.interacting is not None and not chosen.predicts:
        raise PlanError(
            f"`interacting` takes forces from beads, but the pair updates of scheme {chosen.name!r} change velocities without forces; "
            f"only scheme={predicting()} can do that"
        )
    exceptions = neighbour_factors(scene, scene.bonded_factors)
    repulsive = any(c is not NONE and c.has_conservative for table in layers for c in table.values())
    thermostat = any(c is not NONE and c.has_thermostat for table in layers for c in table.values())
    reasons = (kind.kernel_only(table, scene, exceptions, platform) for kind, table in zip(kinds, layers, strict=True))
    only = next(filter(None, reasons), None)
    faster = platform in DOUBLE_PLATFORMS or not listed(platform, scene.box, longest(layers))
    where = _conservative_place(conservative, repulsive, thermostat, only, faster, chosen)
    carriers = [kind for kind in kinds if kind.fields is not None]
    fields = carriers[0].fields(scene) if carriers else None  # type: ignore[misc]
    choices = field_options(scene, fields, longest(layers), platform, lam)
    choices |= {"field_names": carriers[0].field_text} if carriers else {}
    unlooped = _why_no_loop(where, thermostat, chosen, platform, loop, choices.get("compensated", False), scene, host)
    whole = unlooped is None and platform in DOUBLE_PLATFORMS
    options = ProgramOptions(
        scheme=chosen,
        dt=step,
        kT=scene.initial_kT,
        seed=checked_seed(seed),
        lam=lam,
        thermostat=thermostat,
        kernel_conservative=where == "kernel" or whole,
        loop=unlooped is None,
        whole_steps=whole,
        slow_every=checked_interval(slow_every, unlooped),
        settable=thermostat and not isinstance(scene.kT, TemperatureRamp) and (fields is None or fields.kind != ENERGY),
        pair_group=PAIR_GROUP if host is None else host.pair_group,
        constraints=host is not None and host.constrained,
        seeded=seed is not None,
        ramp=scene.kT if isinstance(scene.kT, TemperatureRamp) else None,
        tau_ratio=tau_ratio(platform),
        walls=kind_of(gaps(scene.walls, scene.box)),
        partial=scene.interacting is not None,
        **choices,
    )
    ewald = ewald_of(scene)
    left_out = None if host is None else np.pad(host.left_out, (0, scene.n_beads - len(host.masses)))
    return Plan(
        scene=scene,
        spec=pair_spec(scene, kinds, layers, exceptions, chosen, fields, left_out),
        options=options,
        layers=tuple(layers),
        overlays=tuple(overlays),
        exceptions=exceptions,
        conservative=where,
        unlooped=unlooped,
        platform=platform,
        ewald=ewald,
        charges_held=unlooped is None and platform in DOUBLE_PLATFORMS and few_charges(scene, ewald),
        charge_exceptions=charge_factors(scene),
        host=host,
    )


def _why_no_loop(
    where: str, thermostat: bool, scheme: Scheme, platform: str | None, loop: bool, compensated: bool, scene: Scene, host: Host | None
) -> str | None:
    """Why the pair kernel cannot carry out whole steps by itself, or None."""
    less = f"velocities on the platform {platform} are less than double precision, so that the program balances the energies"
    reasons = {
        "the forces of a System made elsewhere act as well": host is not None,
        "switched off": not loop,
        "on some beads only body forces act": scene.interacting is not None,
        "OpenMM's own integrator steps": scheme.native,
        "the conservative force is a CustomNonbondedForce": where == "openmm",
        "the pair kernel holds no conservative force": where == "none" and not (thermostat and platform in DOUBLE_PLATFORMS),
        less: compensated,
    }
    return next((reason for reason, holds in reasons.items() if holds), None)


def _conservative_place(conservative: str, repulsive: bool, thermostat: bool, only: str | None, faster: bool, scheme: Scheme) -> str:
    """Where the conservative force is computed: "kernel", "openmm" or "none".

    ``only`` is the reason why it must be the kernel, ``faster`` whether that passes over the pairs faster than OpenMM does.
    """
    if not repulsive:
        return "none"
    if only is not None:
        if scheme.native or conservative == "openmm":
            what = "the native scheme" if scheme.native else "conservative='openmm'"
            raise PlanError(f"{what} is not possible: {only}")
        return "kernel"
    if conservative != "auto":
        where = conservative
    else:
        # without friction there is no kernel, and OpenMM's own force needs no company
        where = "kernel" if faster and thermostat and not scheme.native else "openmm"
    if scheme.native and where == "kernel":
        raise PlanError("the native scheme has no pair kernel; use conservative='openmm'")
    return where
