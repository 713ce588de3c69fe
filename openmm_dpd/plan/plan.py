"""Scene and choices to a Plan: what this scene needs and no more, decided before anything is built."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..base.errors import PlanError, fact_table, require, require_one
from ..base.names import PAIR_GROUP
from ..base.platforms import fastest_platform
from ..kernels.driven import Continuum, Driven
from ..kernels.engines import EngineKind, engine_kind
from ..kernels.fields import ENERGY
from ..kernels.interface import Engine
from ..kernels.layer import PairSpec
from ..kernels.moment import Guide
from ..kernels.solids import Solids
from ..model.bonds import BondedTerms
from ..model.flow import kind_of
from ..model.pairs import NONE
from ..model.scene import Scene
from ..model.schemes import scheme_of
from ..model.temperature import TemperatureRamp
from .charge_forces import few_charges
from .choices import check_cutoffs, checked_interval, checked_lam, checked_seed, checked_step, listed, platform_name, predicting
from .continuum import check_driven, driven_walls
from .device import DEVICE, DRIVEN, PRECISION, chosen_engine
from .execution import (
    DOUBLE_PLATFORMS,
    REACTING,
    Execution,
    check_rigid,
    check_whole_steps,
    conservative_place,
    why_no_loop,
    why_not_native,
    why_parts,
)
from .kinds import Kind, bonded_kind, resolved_kind
from .made import Host
from .pair_spec import Factors, inner_factors, longest, neighbour_factors, pair_spec
from .program_options import ProgramOptions, field_options, forces_number, tau_ratio
from .reactions import bonds_at_start, table_blocks

#: Coefficients by pair of types, all of one kind.
ResolvedTable = dict[tuple[str, str], Any]


#: What an engine needs for the letters of a word that sweep.
_SWEEPS = {"O": "exact pair updates", "S": "Shardlow's pair updates"}


@dataclass(frozen=True, eq=False)
class Plan:
    """Everything that is decided about a simulation before it is built.

    Attributes
    ----------
    scene : Scene
        All particles.  Those of a System made elsewhere come first: their classes are further types, their positions those that were given
        (or 0), and their masses are in ``bead_masses``.
    spec : PairSpec
        The pair terms, for the engine.
    options : ProgramOptions
        What the integrator's program has to know.
    layers, overlays : tuples of tables
        Tables {pair of types: coefficient} of one kind each: pair terms of the kernel, and radial potentials laid over them.
    exceptions, charge_exceptions : dict
        Factors of bonded neighbours other than 1, for pair terms and for charges.
    platform : str or None
        Name of the platform.
    host : Host or None
        The System made elsewhere that the pair terms are added to.
    driven : Driven, Solids or None
        Walls, if some move, or have a shape or something behind them.
    """

    scene: Scene
    spec: PairSpec
    options: ProgramOptions
    layers: tuple[ResolvedTable, ...]
    overlays: tuple[ResolvedTable, ...]
    exceptions: Factors
    charge_exceptions: Factors
    platform: str | None
    host: Host | None = None
    driven: Driven | Solids | None = None

    def __repr__(self) -> str:
        options = self.options
        return f"<Plan for {self.platform}: {options.scheme}, dt = {options.dt:g} ps, {self.scene!r}>"

    def _repr_html_(self) -> str:
        return fact_table("Plan", self.facts())

    def facts(self) -> dict[str, object]:
        """The main facts by name, for people; None for what there is not."""
        options = self.options
        known = {"platform": self.platform, "scheme": options.scheme, "dt": f"{options.dt:g} ps", "seed": options.seed}
        if self.host is None:
            return {**known, **self.scene.facts()}
        return {"atoms": self.n_atoms, **known, **self.scene.facts(), "beads": self.scene.n_beads - self.n_atoms or None}

    @property
    def execution(self) -> Execution:
        """Who computes what in a step, and why."""
        return self.options.execution

    @property
    def no_potential(self) -> str | None:
        """Why the conservative force derives from no potential, or None."""
        return next(filter(None, (resolved_kind(table).why_no_potential(table) for table in self.layers)), None)

    def no_volume_moves(self, axes: str) -> str | None:
        """Why no Monte Carlo move can change the box along these axes, or None."""
        scene = self.scene
        walled = next(("xyz"[axis] for axis in scene.gaps if "xyz"[axis] in axes), None)
        reasons = {
            "a scene without a box has no pressure to hold constant": scene.box is None,
            "a barostat would scale the positions of immobile beads; it needs a scene where all beads move": (
                self.host is None and bool(scene.immobile.any())
            ),
            "a barostat does not know the sliding images of a Lees-Edwards shear": scene.shear is not None,
            "a barostat needs a scene where all forces act on all beads; `interacting` takes some away": scene.interacting is not None,
            f"a barostat moves beads and not {DRIVEN}": self.driven is not None,
            f"a barostat judges volumes by an energy, but {self.no_potential}": self.no_potential is not None,
            f"a barostat that changes {walled} would move beads behind walls; leave it out of axes, coupled=False": walled is not None,
        }
        return next((reason for reason, holds in reasons.items() if holds), None)

    def no_barostat(self, axes: str) -> str | None:
        """Why none of OpenMM's barostats can change the box along these axes, or None."""
        fields = self.spec.fields
        if fields is None:
            ramp = "OpenMM's barostats have one temperature; a temperature ramp cannot be combined with them"
            return self.no_volume_moves(axes) or (None if self.options.ramp is None else ramp)
        if fields.kind == ENERGY:
            return "the beads have internal energies: use EnthalpyBarostat"
        return "there is no barostat for beads with temperatures or concentrations (EDPD, TDPD)"

    @property
    def engine(self) -> EngineKind:
        """The kind of engine that evaluates the pair terms."""
        return engine_kind(self.execution.engine)

    @property
    def behind(self) -> tuple[Continuum, ...]:
        """What is behind walls, where the pair force has that without the host's loop."""
        on_device = isinstance(self.driven, Driven) and not self.execution.looped
        return tuple(filter(None, [self.driven.continuum])) if on_device else ()  # type: ignore[union-attr]

    def new_engine(self) -> Engine:
        """A new engine for the pair terms, and for what is :attr:`behind` walls."""
        return self.engine.make(replace(self.spec, extras=self.behind))

    def needs(self) -> Iterator[str]:
        """Names of what an engine must be able to do: kinds of pair coefficients, pair updates, boxes, beads, and parts of the scene."""
        scene, options = self.scene, self.options
        yield from dict.fromkeys(kind.name for kind in self.kinds)
        if options.predicting:
            yield "friction as a force"
        yield from dict.fromkeys(_SWEEPS[letter] for letter, _ in options.scheme.steps(options.thermostat) if letter in _SWEEPS)
        features = {
            "several tables": len(self.layers) > 1,
            "scenes without a box": scene.box is None,
            "tilted boxes": scene.box is not None and bool(np.any(np.tril(scene.box, -1))),
            "Lees-Edwards shear": scene.shear is not None,
            "rigid bodies": bool(scene.bodies),
            "factors of bonded neighbours": bool(self.exceptions),
            "immobile beads": bool(scene.immobile.any()),
            "particles that are left out": self.host is not None and bool(self.host.left_out.any()),
            DRIVEN: self.driven is not None,
            REACTING: bool(scene.reactions),
        }
        yield from (name for name, there in features.items() if there)
        yield from (part for part in self.execution.why if part in self.execution.held)

    def holds(self, group: BondedTerms) -> bool:
        """Whether the pair kernel holds these bonds, angles, dihedrals or impropers."""
        return bonded_kind(type(group)).name in self.execution.held

    @property
    def n_atoms(self) -> int:
        """Number of particles of a System made elsewhere; beads come after them."""
        return 0 if self.host is None else len(self.host.masses)

    def listed(self, cutoff: float) -> bool:
        """Whether OpenMM's pair forces with this cutoff can take the pairs from a neighbour list; they go through all pairs otherwise."""
        return listed(self.platform, self.scene.box, cutoff)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kind of each of the ``layers``."""
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
    engine: str = "auto",
    host: Host | None = None,
    guide: Guide | None = None,
) -> Plan:
    """Decide what to build: the plan of a scene.

    Parameters
    ----------
    scene : Scene
    dt : time
        Step size (bare numbers: ps).
    scheme : str, default "middle"
        Name of one of :data:`openmm_dpd.model.schemes.SCHEMES`, or a word of drifts ``A``, kicks ``B`` and sweeps of pair updates, exact
        ones ``O`` or Shardlow's ``S``, each with its part of the step: ``"B/2 A/2 O A/2 B/2"``.
    lam : float, default 0.5
        Weight of the velocity prediction of ``mvv``, between 0 and 1; 0.5 is plain velocity Verlet.
    conservative : {"auto", "openmm", "kernel"}
        Where the conservative DPD force is computed: a CustomNonbondedForce, or the pair kernel.  ``auto`` takes the kernel on the CPU
        platform, where it is faster, and OpenMM elsewhere (but on the Reference platform in small tilted boxes, where OpenMM would go
        through all pairs, the kernel).
    platform : str, optional
        Name of the platform that will be used, the fastest one here by default; with a ``host`` none, since others may choose it later.
    seed : int, optional
        Seed of the noise, 0 <= seed < 2^31; drawn from the operating system and recorded in the plan by default.
    loop : bool, default True
        Whether the kernel carries out many whole steps at once where it can: where it holds every fast force of the scene, on the CPU and
        Reference platforms, and on others if it holds the conservative force.  Forces that stay OpenMM's (lattice sums of many charges,
        formulas of the position, forces added to the System) then kick before and after each step, and a barostat acts at the end
        of up to ten steps.  Otherwise the program does one step at a time, and all forces kick at every ``B``.  On the device steps are
        whole ones either way, and this says where such forces kick.
    slow_every : int, default 1
        In loops of whole steps: number of steps between kicks of forces that stay OpenMM's (multiple time steps, impulses as in r-RESPA:
        Tuckerman, Berne and Martyna, J. Chem. Phys. 97, 1990 (1992)).
    engine : str, default "auto"
        What evaluates the pair terms: "host" is the compiled kernel, "device" the plugin openmm-dpd-device, which "auto" takes on a GPU
        where it can; others have to be registered (:func:`openmm_dpd.kernels.engines.register_engine`).
    guide : Guide, optional
        What acts within the steps of ``mvv``; it needs whole steps of the pair kernel.
    host : Host, optional
        A System made elsewhere whose particles are the first of the scene; its forces act beside the pair terms.

    Raises
    ------
    ParameterError, PlanError
        If a choice is out of bounds or cannot be combined with the scene.
    """
    require(scene, Scene, "expected a Scene")
    require(guide, Guide | None, "guide must be a Guide")
    require(host, Host | None, "host must be a Host")
    resolved = [table.resolve(scene.type_names) for table in scene.tables]
    tables: list[ResolvedTable] = [table for table in resolved if any(c is not NONE for c in table.values())]
    chosen = scheme_of(scheme)
    step, lam, key = checked_step(dt), checked_lam(lam, chosen), checked_seed(seed)
    platform = platform_name(platform) or (fastest_platform() if host is None else None)
    require_one(conservative, ("auto", "openmm", "kernel"), "conservative")
    require(loop, bool, "loop must be True or False")
    check_cutoffs(scene.box, tables)
    layers = [table for table in tables if resolved_kind(table).overlay is None]
    overlays = [table for table in tables if resolved_kind(table).overlay is not None]
    kinds = list(map(resolved_kind, layers))
    for kind in kinds:
        reason = None if chosen.predicts else kind.no_sweep(scene)
        if reason:
            raise PlanError(f"{reason}; only scheme={predicting()} runs it, not {chosen.name!r}")
    if scene.interacting is not None and not chosen.predicts:
        raise PlanError(
            f"`interacting` takes forces from beads, but the pair updates of scheme {chosen.name!r} change velocities without forces; "
            f"only scheme={predicting()} can do that"
        )
    (exceptions, charge_exceptions), reach = neighbour_factors(scene, bonds_at_start(scene)), longest(layers)
    exceptions |= inner_factors(scene, max(reach, longest(overlays)))
    repulsive = any(c is not NONE and c.has_conservative for table in layers for c in table.values())
    rubs = any(c is not NONE and c.has_thermostat for table in layers for c in table.values())
    thermostat = rubs or guide is not None  # a guide changes forces, which has steps of mvv only
    reasons = (kind.kernel_only(table, scene, exceptions, platform) for kind, table in zip(kinds, layers, strict=True))
    only = next(filter(None, reasons), None)
    double, driven = platform in DOUBLE_PLATFORMS, any(wall.driven for wall in scene.walls)
    check_driven(scene, chosen, tables, thermostat)
    only = only or (f"{DRIVEN} need whole steps of the pair kernel" if driven else None)
    only = only or ("rigid bodies need whole steps of the pair kernel" if scene.bodies else None)
    only = only or (None if guide is None or not repulsive else f"{guide.what} need whole steps of the pair kernel")
    only = only or (f"{REACTING} need whole steps of the pair kernel" if scene.reactions and repulsive else None)
    all_on_device = all(kind.device_repels for kind in kinds)
    acts = thermostat or (repulsive and conservative != "openmm" and all_on_device)
    cut = conservative == "openmm" or bool(overlays) or scene.segments is not None
    held_by_kernel = repulsive and (only is not None or conservative == "kernel")
    engine_name, why_engine = chosen_engine(engine, platform, chosen, kinds, acts, scene, guide is not None, cut, held_by_kernel)
    on_device = engine_name == DEVICE.name
    slower = "" if double or on_device or not listed(platform, scene.box, reach) else "it takes less time on this platform"
    slower = "the device leaves it to OpenMM" if on_device and not all_on_device else slower
    where, why_there = conservative_place(conservative, repulsive, thermostat or on_device, only, slower, chosen)
    carriers = [kind for kind in kinds if kind.fields is not None]
    fields = carriers[0].fields_of(scene) if carriers else None
    choices = field_options(scene, fields, reach, double, lam) | ({"field_names": carriers[0].field_text} if carriers else {})
    no_loop = "the device does them" if on_device else None
    no_loop = no_loop or why_no_loop(where, thermostat, chosen, platform, loop, choices.get("compensated", False), scene, host is not None)
    if guide is not None and (no_loop is not None or not chosen.predicts):
        why = no_loop or f"scheme {chosen.name!r} has no sum of all forces; use {predicting()}"
        raise PlanError(f"{guide.what} need whole steps of the pair kernel with all forces: {why}")
    if driven and no_loop is not None and not on_device:
        raise PlanError(f"{DRIVEN} need whole steps of the pair kernel, which are not possible here: {no_loop}")
    if scene.shear is not None and not on_device:
        check_whole_steps("Lees-Edwards shear needs", no_loop, platform)
    if scene.reactions:
        check_whole_steps(f"{REACTING} need", no_loop, platform)
    check_rigid(scene, kinds, layers, lam, no_loop, platform)
    bonded = [bonded_kind(type(group)).name for group in scene.bonded]
    held, why_held = why_parts(scene, bonded, bool(overlays), no_loop is None, double and few_charges(scene), double)
    constrained = host is not None and host.constrained
    whole = on_device and not constrained
    execution = Execution(
        engine=engine_kind(engine_name).name,
        steps="openmm" if chosen.native else "device" if whole else "program" if no_loop else "loop",
        conservative=where,
        held=held,
        precision="double" if double else PRECISION if on_device else "single",
        slow=whole and loop and host is None,
        why={
            "engine": why_engine,
            "steps": no_loop or "the pair kernel holds all fast forces",
            "conservative": why_there,
            "precision": f"platform {platform}" if platform else "no platform is named",
            **why_held,
        },
    )
    walls = driven_walls(scene, layers, lam)
    named = walls.impulses.items() if on_device and isinstance(walls, Driven) else ()
    options = ProgramOptions(
        scheme=chosen,
        dt=step,
        kT=scene.initial_kT,
        seed=key,
        lam=lam,
        thermostat=thermostat,
        execution=execution,
        slow_every=checked_interval(slow_every, no_loop),
        settable=rubs and not isinstance(scene.kT, TemperatureRamp) and (fields is None or fields.kind != ENERGY),
        pair_group=PAIR_GROUP if host is None else host.pair_group,
        constraints=constrained,
        seeded=seed is not None,
        forces=forces_number(scene, *tables, lam),
        ramp=scene.kT if isinstance(scene.kT, TemperatureRamp) else None,
        tau_ratio=tau_ratio(double),
        walls=kind_of(scene.gaps),
        sheared=scene.shear is not None,
        impulses=tuple((6 * axis + 3 * side + k, name) for (axis, side, k), name in named),
        partial=scene.interacting is not None,
        guided="" if guide is None else guide.what,
        numbers=(*(() if guide is None else guide.numbers), *(0.0,) * (3 * len(scene.reactions))),
        frictionless=thermostat and not rubs,
        bond_blocks=table_blocks(scene) if scene.reactions else 0,
        **choices,
    )
    left_out = None if host is None else np.pad(host.left_out, (0, scene.n_beads - len(host.masses)))
    spec = pair_spec(scene, kinds, layers, exceptions, chosen, fields, left_out, walls.carried if isinstance(walls, Solids) else None)
    parts = scene, spec, options, tuple(layers), tuple(overlays), exceptions, charge_exceptions, platform
    plan = Plan(*parts, host, walls)
    if engine != "auto":
        _check_engine(plan)
    reason = why_not_native(scene, kinds, layers, bool(exceptions), platform) if chosen.native else None
    if reason is not None:
        raise PlanError(f"OpenMM's DPDIntegrator cannot run this scene: {reason}")
    return plan


def _check_engine(plan: Plan) -> None:
    """Raise PlanError if the engine would have nothing to do, or cannot do it all."""
    execution, known = plan.execution, {kind.name for kind in plan.kinds if plan.execution.on_device and kind.device is not None}
    lacks = plan.engine.lacks(need for need in plan.needs() if need not in known)
    if plan.options.scheme.native or not plan.options.kernel:
        raise PlanError(f"the engine {execution.engine!r} would have nothing to do: {execution.why['steps']}")
    if lacks is not None:
        raise PlanError(f"the engine {execution.engine!r} cannot run this scene: it has no {lacks}")
