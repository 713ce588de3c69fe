"""Scene + choices -> Plan: the least that this scene needs, decided before anything is built."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .charge_forces import LARGEST_ERROR, longest_wave
from .errors import ParameterError, PlanError, what_is
from .html import fact_table
from .kernels.charges import cost, pme_cost
from .kernels.engine import PairSpec
from .kernels.fields import ENERGY, TEMPERATURE, FieldSpec
from .kernels.sweeps import EXACT, SHARDLOW
from .kinds import BeadData, Kind, resolved_kind
from .model.angles import HarmonicAngles
from .model.bonds import FENEBonds, HarmonicBonds, bonded_neighbours
from .model.electrostatics import EwaldSum, ewald_sum
from .model.flow import gaps, kind_of
from .model.pairs import NONE, describe
from .model.scene import Scene, TemperatureRamp
from .names import PAIR_GROUP, SHOWN
from .neighbour_list import listed
from .program_options import ProgramOptions
from .schemes import SCHEMES, Scheme, scheme_of
from .units import to_md, whole_number

#: Coefficients by pair of types, all of one kind.
ResolvedTable = dict[tuple[str, str], Any]


@dataclass(frozen=True, eq=False)
class Plan:
    """What will be built: ``layers`` are the tables of the pair kernel, ``overlays`` overlays, each {pair of types: coefficient}."""

    scene: Scene
    spec: PairSpec
    options: ProgramOptions
    layers: tuple[ResolvedTable, ...]
    overlays: tuple[ResolvedTable, ...]
    exceptions: dict[tuple[int, int], float]
    conservative: str
    platform: str | None
    notes: tuple[str, ...] = field(default=())
    ewald: EwaldSum | None = None
    charge_exceptions: dict[tuple[int, int], float] = field(default_factory=dict)
    unlooped: str | None = None
    charges_held: bool = False

    def __repr__(self) -> str:
        return f"<Plan for {self.platform}: {self.options.scheme}, dt = {self.options.dt:g} ps, {self.scene!r}>"

    def _repr_html_(self) -> str:
        return fact_table("Plan", self.facts())

    def facts(self) -> dict[str, object]:
        """What a person wants to know, by name."""
        options = self.options
        return {"platform": self.platform, "scheme": options.scheme, "dt": f"{options.dt:g} ps", "seed": options.seed, **self.scene.facts()}

    def listed(self, cutoff: float) -> bool:
        """Whether OpenMM's pair forces with this cutoff can take the pairs from a neighbour list; they go through all pairs otherwise."""
        return listed(self.platform, self.scene.box, cutoff)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kinds of ``layers``."""
        return tuple(map(resolved_kind, self.layers))

    def explain(self) -> str:
        """Half a page: what will be built, and why."""
        scene, options = self.scene, self.options
        frozen = 0 if scene.mobile is None else int((~scene.mobile).sum())
        lines = [
            f"{scene.n_beads} beads of {len(scene.masses)} type(s): " + ", ".join(f"{n} (mass {m:g})" for n, m in scene.masses.items()),
            "box: none" if scene.box is None else "box: " + _describe_box(scene.box),
            f"scheme: {options.scheme} ({options.scheme.what}), dt = {options.dt:g} ps" + self._lambda_text(),
            self._temperature_text(),
            f"seed of the noise: {options.seed}",
            "pair terms:",
        ]
        for table in (*self.layers, *self.overlays):
            lines += [f"  {a} - {b}: {describe(value)}" for (a, b), value in table.items()]
        lines.append("conservative DPD force: " + self._conservative_text())
        if not options.kernel:
            lines.append("no friction, no noise: no pair kernel, no PythonForce")
        elif options.thermostat:
            transverse = any(np.any(getattr(term, "gamma_perp", 0) > 0) for term in self.spec.terms)
            lines.append(
                "friction and noise: compiled pair kernel behind a PythonForce" + (", with transverse terms" if transverse else "")
            )
            lines.append(f"steps: one by one, by the program ({self.unlooped})" if self.unlooped else _looped(options.slow_every))
        if self.spec.fields is not None:
            lines.append(self._field_text())
        if len(scene.bond_pairs):
            lines.append(f"{self._bond_text()}; {len(self.exceptions)} bonded neighbours with a factor other than 1")
        for angles in scene.angles:
            lines.append(f"{len(angles.triples)} {'harmonic' if isinstance(angles, HarmonicAngles) else 'cosine'} angles")
        if scene.segments is not None:
            lines.append(self._segment_text())
        if scene.electrostatics is not None:
            lines += self._charge_lines()
        lines += [f"body force on single beads: {term}" for term in scene.body_forces]
        for axis, gap in gaps(scene.walls, scene.box).items():
            lines.append(f"{gap.kind} walls: {'xyz'[axis]} from {gap.low:g} to {gap.high:g} nm")
        if frozen:
            lines.append(f"{frozen} beads do not move (mass 0)")
        return "\n".join(lines + [f"note: {note}" for note in self.notes])

    def _bond_text(self) -> str:
        counts: dict[str, int] = {}
        for bonds in self.scene.bonds:
            name = {HarmonicBonds: "harmonic", FENEBonds: "FENE"}.get(type(bonds), "Morse")
            counts[name] = counts.get(name, 0) + len(bonds.pairs)
        return ", ".join(f"{count} {name} bonds" for name, count in counts.items())

    def _segment_text(self) -> str:
        segments = self.scene.segments
        assert segments is not None
        points = "midpoints" if segments.distance == "mid" else "nearest points"
        return (
            f"segmental repulsion between the {points} of {len(self.scene.segment_pairs)} bonds: A = {segments.A:g}, "
            f"cutoff {segments.cutoff:g} nm, compiled kernel behind a PythonForce of its own"
        )

    def _charge_lines(self) -> list[str]:
        charges, q, ewald = self.scene.electrostatics, self.scene.charges, self.ewald
        assert charges is not None and q is not None
        ions = int(np.count_nonzero(q))
        text = f"{ions} charged beads, total charge {q.sum():g} e: {charges.describe()}, "
        text += f"Coulomb constant {charges.coulomb(self.scene.initial_kT):.6g} kJ/mol nm/e^2"
        if self.charges_held:
            text += "; in the pair kernel"
        if ewald is None:
            return [text + "; no box: every pair, no cutoff"]
        grid = "a direct sum over waves" if self.charges_held else "PME on a grid of " + " x ".join(map(str, ewald.grid))
        lines = [text, f"  real space to {ewald.cutoff:.4g} nm, {grid}, alpha = {ewald.alpha:.4g}/nm"]
        error = charges.tail(ewald.cutoff)
        if error > 2 * charges.tolerance:
            lines.append(
                f"  beyond that charges are point charges; the smeared force differs there by a part of {error:.1g} still "
                f"({charges.tolerance:g} from {charges.reach(charges.tolerance):.3g} nm on)"
            )
        return lines

    def _field_text(self) -> str:
        fields = self.spec.fields
        assert fields is not None
        text = f"{fields.n_values} value(s) per bead in {fields.n_blocks} per-DOF variable(s): {self.options.field_names}"
        if fields.kind == ENERGY:
            eos = self.scene.internal.by_type(self.scene.type_names)  # type: ignore[union-attr]
            text += "; equation of state " + ", ".join(f"{name}: {state}" for name, state in zip(self.scene.type_names, eos, strict=True))
        if fields.kind == TEMPERATURE and self.scene.compat == "lammps":
            text += "; heat as LAMMPS computes it (compat), which does not conserve energy"
        return text + (f"; {len(fields.sources)} source(s)" if fields.sources else "")

    def _lambda_text(self) -> str:
        return f", lambda = {self.options.lam:g}" if self.options.scheme.predicts else ""

    def _temperature_text(self) -> str:
        ramp = self.options.ramp
        if ramp is None:
            return f"kT = {self.options.kT:g} kJ/mol"
        return f"kT from {ramp.kT_start:g} to {ramp.kT_end:g} kJ/mol between steps {ramp.first_step} and {ramp.last_step}"

    def _conservative_text(self) -> str:
        unlisted = "" if self.listed(_longest(self.layers)) else ", over all pairs (a list could miss some: the box is small and tilted)"
        return {
            "kernel": f"in the pair kernel, which passes over the same pairs anyway (platform {self.platform})",
            "openmm": "CustomNonbondedForce with " + ("constants" if len(self.scene.masses) == 1 else "tables of type pairs") + unlisted,
            "none": "none",
        }[self.conservative]


def _looped(slow_every: int) -> str:
    often = "each step" if slow_every == 1 else f"every {slow_every} steps"
    return (
        f"steps: up to ten at once in compiled loops; forces that stay OpenMM's kick before and after {often}, a barostat acts at the end "
        "of such a piece, which is no longer than its interval"
    )


def _describe_box(box: np.ndarray) -> str:
    edges = " x ".join(f"{edge:g}" for edge in np.diag(box))
    tilt = f", tilt {box[1, 0]:g} {box[2, 0]:g} {box[2, 1]:g}" if np.any(np.tril(box, -1)) else ""
    return f"{edges} nm{tilt}"


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
    pair_group: int = PAIR_GROUP,
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
        Name of the platform that will be used; the fastest one by default.
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
    pair_group : int, default 31
        Force group of the pair terms.

    Raises
    ------
    ParameterError, PlanError
        If a choice is out of bounds or cannot be combined with the scene.
    """
    if not isinstance(scene, Scene):
        raise ParameterError(f"expected a Scene, not {what_is(scene)}")
    step = _checked_step(dt)
    chosen = scheme_of(scheme)
    lam = to_md(lam, "dimensionless", "lam")
    if not isinstance(lam, float) or not 0.0 <= lam <= 1.0:
        raise ParameterError(f"lam (lambda of the modified velocity Verlet scheme) must be between 0 and 1, but is {lam!r}")
    check_lam(lam, chosen)
    if conservative not in ("auto", "openmm", "kernel"):
        raise ParameterError(f"conservative must be 'auto', 'openmm' or 'kernel', not {conservative!r}")
    layers, overlays = _split_tables(scene)
    kinds = list(map(resolved_kind, layers))
    check_cutoffs(scene.box, [*layers, *overlays])
    _check_scheme(chosen, kinds)
    exceptions = _exceptions(scene, scene.bonded_factors)
    repulsive = any(c is not NONE and c.has_conservative for table in layers for c in table.values())
    thermostat = any(c is not NONE and c.has_thermostat for table in layers for c in table.values())
    only = _why_kernel_only(scene, kinds, layers, exceptions, platform)
    faster = platform in DOUBLE_PLATFORMS or not listed(platform, scene.box, _longest(layers))
    where = _conservative_place(conservative, repulsive, thermostat, only, faster, chosen)
    carriers = [kind for kind in kinds if kind.fields is not None]
    fields = carriers[0].fields(scene) if carriers else None  # type: ignore[misc]
    choices = _field_options(scene, fields, _longest(layers), platform, lam)
    choices |= {"field_names": carriers[0].field_text} if carriers else {}
    unlooped = _why_no_loop(where, thermostat, chosen, platform, loop, choices.get("compensated", False))
    whole = unlooped is None and platform in DOUBLE_PLATFORMS
    options = ProgramOptions(
        scheme=chosen,
        dt=step,
        kT=scene.initial_kT,
        seed=checked_seed(seed),
        lam=float(lam),
        thermostat=thermostat,
        kernel_conservative=where == "kernel" or whole,
        loop=unlooped is None,
        whole_steps=whole,
        slow_every=_checked_interval(slow_every, unlooped),
        settable=thermostat and not isinstance(scene.kT, TemperatureRamp) and (fields is None or fields.kind != ENERGY),
        pair_group=pair_group,
        seeded=seed is not None,
        ramp=scene.kT if isinstance(scene.kT, TemperatureRamp) else None,
        tau_ratio=tau_ratio(platform),
        walls=kind_of(gaps(scene.walls, scene.box)),
        **choices,
    )
    ewald = _ewald(scene)
    return Plan(
        scene=scene,
        spec=_pair_spec(scene, kinds, layers, exceptions, chosen, fields),
        options=options,
        layers=tuple(layers),
        overlays=tuple(overlays),
        exceptions=exceptions,
        conservative=where,
        unlooped=unlooped,
        platform=platform,
        ewald=ewald,
        charges_held=unlooped is None and platform in DOUBLE_PLATFORMS and _few_charges(scene, ewald),
        charge_exceptions=_charge_exceptions(scene),
    )


#: Platforms where positions, velocities and forces are double precision.
DOUBLE_PLATFORMS = ("Reference", "CPU")


def tau_ratio(platform: str | None) -> float:
    """Trial drift in units of dt: short where positions are double precision, longer where they may be single."""
    return 1.0 / 32.0 if platform in DOUBLE_PLATFORMS else 0.25


def _longest(layers) -> float:
    return max((c.cutoff for table in layers for c in table.values()), default=0.0)


def _trial_time(scene: Scene, cutoff: float, double: bool) -> float | None:
    """Trial drift for scenes that balance energies: 1/1000 of the range at a thermal velocity (1/50 where positions may be float32).

    A power of two, so that multiplying and dividing by it is exact.
    """
    speed = float(np.sqrt(scene.initial_kT / scene.bead_masses.min()))
    if speed * cutoff <= 0:
        return None
    return float(2.0 ** np.round(np.log2((0.001 if double else 0.02) * cutoff / speed)))


def _field_options(scene: Scene, fields: FieldSpec | None, cutoff: float, platform: str | None, lam: float) -> dict[str, Any]:
    """How the program keeps and shows the per-bead fields."""
    if fields is None:
        return {}
    double = platform in DOUBLE_PLATFORMS
    reach = 0.25 * cutoff if double or scene.box is None else 0.2 * float(np.diag(scene.box).min())
    typical = float(np.abs(fields.initial.sum(axis=1)).mean()) or 1.0
    return {
        "trial": _trial_time(scene, cutoff, double),
        "field_blocks": fields.n_blocks,
        # LAMMPS: fix mvv/edpd predicts temperatures with lambda, dpd/energy and mvv/tdpd take half steps
        "field_lam": lam if fields.kind == TEMPERATURE else 0.5,
        "field_reach": float(reach),
        # forces are fixed-point numbers with 32 bits behind the point on GPU platforms
        "field_shown": float(2.0 ** np.round(np.log2(SHOWN / typical))),
        "field_scale": 1.0 if double else float(2.0 ** (np.floor(np.log2(typical)) - 10)),
        "compensated": not double and fields.kind == ENERGY,
    }


def check_lam(lam: float, scheme: Scheme) -> None:
    """Raise ParameterError if a weight of the prediction is given to a scheme that has none."""
    if lam != 0.5 and not scheme.predicts:
        able = " or ".join(repr(name) for name, known in SCHEMES.items() if known.predicts)
        raise ParameterError(f"lam is the weight of the prediction of the scheme {able}; the scheme {scheme.name!r} has none")


def _check_scheme(scheme: Scheme, kinds: list[Kind]) -> None:
    """Raise PlanError if a scheme cannot run these pair terms."""
    for kind in kinds:
        if kind.no_sweep and not scheme.predicts:
            able = " or ".join(repr(name) for name, known in SCHEMES.items() if known.predicts)
            raise PlanError(f"{kind.name} {kind.no_sweep}; only scheme={able} runs it, not {scheme.name!r}")


def _why_no_loop(where: str, thermostat: bool, scheme: Scheme, platform: str | None, loop: bool, compensated: bool) -> str | None:
    """Why the pair kernel cannot carry out whole steps by itself, or None."""
    if not loop:
        return "switched off"
    if scheme.native:
        return "OpenMM's own integrator steps"
    if where == "openmm":
        return "the conservative force is a CustomNonbondedForce"
    if where == "none" and not (thermostat and platform in DOUBLE_PLATFORMS):
        return "the pair kernel holds no conservative force"
    if compensated:
        return f"velocities on the platform {platform} are less than double precision, so that the program balances the energies"
    return None


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


def _why_kernel_only(scene: Scene, kinds: list[Kind], layers, exceptions, platform: str | None) -> str | None:
    """Why no OpenMM force can compute the conservative force, or None."""
    reasons = (kind.kernel_only(table, scene, exceptions, platform) for kind, table in zip(kinds, layers, strict=True))
    return next((reason for reason in reasons if reason is not None), None)


def _checked_interval(slow_every, unlooped: str | None) -> int:
    interval = whole_number(slow_every, "slow_every", least=1)
    if interval > 1 and unlooped:
        raise PlanError(f"slow_every = {interval} needs the loop of whole steps, which is not used here: {unlooped}")
    return interval


def _checked_step(dt) -> float:
    step = to_md(dt, "time", "dt")
    if not isinstance(step, float) or step <= 0:
        raise ParameterError(f"dt must be a single time > 0, not {dt!r}")
    return step


def checked_seed(seed: int | None) -> int:
    """The seed to use; None draws one from the operating system."""
    if seed is None:
        return secrets.randbelow(2**31 - 1) + 1
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**31:
        raise ParameterError(f"seed must be an integer with 0 <= seed < 2^31, not {seed!r}")
    return int(seed)


def _split_tables(scene: Scene):
    """Resolved tables of what the pair kernel evaluates, and those of overlays."""
    resolved = [table.resolve(scene.type_names) for table in scene.tables]
    found: list[ResolvedTable] = [table for table in resolved if any(c is not NONE for c in table.values())]
    layers = [table for table in found if resolved_kind(table).overlay is None]
    return layers, [table for table in found if resolved_kind(table).overlay is not None]


def check_cutoffs(box: np.ndarray | None, tables: list[dict]) -> None:
    """Raise ParameterError if a cutoff is over half the box."""
    if box is None:
        return
    half = 0.5 * float(np.diag(box).min())
    for table in tables:
        for (a, b), coefficient in table.items():
            if coefficient.cutoff > half * (1 + 1e-12):
                raise ParameterError(
                    f"for types ({a}, {b}): the cutoff {coefficient.cutoff:g} nm is over half the box, "
                    f"whose smallest width is {2 * half:g} nm"
                )


def _exceptions(scene: Scene, factors: tuple[float, float, float]) -> dict[tuple[int, int], float]:
    """Bonded neighbours whose factor is not 1."""
    if not len(scene.bond_pairs) or factors == (1.0, 1.0, 1.0):
        return {}
    found = bonded_neighbours(scene.bond_pairs, scene.n_beads)
    return {pair: factors[k - 1] for k, pairs in found.items() if factors[k - 1] != 1.0 for pair in pairs}


def _charge_exceptions(scene: Scene) -> dict[tuple[int, int], float]:
    """The same for the interaction of charges."""
    if scene.electrostatics is None:
        return {}
    return _exceptions(scene, scene.electrostatics.bonded_factors or scene.bonded_factors)


def _ewald(scene: Scene) -> EwaldSum | None:
    if scene.electrostatics is None or scene.charges is None or scene.box is None:
        return None
    return ewald_sum(scene.electrostatics, scene.box, int(np.count_nonzero(scene.charges)))


def _few_charges(scene: Scene, ewald: EwaldSum | None) -> bool:
    """Whether the kernel's direct sum over waves takes less time than OpenMM's PME."""
    if scene.electrostatics is None or scene.charges is None:
        return False
    count = int(np.count_nonzero(scene.charges))
    if ewald is None:
        return count < 2000
    k_max = longest_wave(ewald.alpha, min(scene.electrostatics.tolerance, LARGEST_ERROR))
    return cost(count, scene.box, k_max, ewald.cutoff) < pme_cost(ewald.grid, scene.n_beads)


def compressed_exceptions(exceptions: dict[tuple[int, int], float], n_beads: int):
    """Exceptions as compressed rows (start, bead, factor), both directions; empty arrays if there are none."""
    if not exceptions:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    rows = sorted([(i, j, f) for (i, j), f in exceptions.items()] + [(j, i, f) for (i, j), f in exceptions.items()])
    first = np.array([row[0] for row in rows])
    start = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=n_beads))])
    return start.astype(np.int64), np.array([row[1] for row in rows], np.int64), np.array([row[2] for row in rows])


def _pair_spec(scene: Scene, kinds, layers, exceptions, scheme: Scheme, fields: FieldSpec | None) -> PairSpec:
    mobile, wall_velocity = ~scene.immobile, None
    if scene.velocities is not None and np.any(scene.velocities[~mobile] != 0):
        wall_velocity = np.where(mobile[:, None], 0.0, scene.velocities)
    beads = BeadData(scene.type_names, scene.bead_masses, scene.compat)
    return PairSpec(
        # numba would compile kernels of their own for the scene's read-only arrays
        types=scene.type_ids.copy(),
        inv_mass=np.where(mobile, 1.0 / scene.bead_masses, 0.0),
        terms=tuple(kind.terms(table, beads) for kind, table in zip(kinds, layers, strict=True)),
        update=SHARDLOW if scheme.shardlow else EXACT,
        exceptions=compressed_exceptions(exceptions, scene.n_beads),
        wall_velocity=wall_velocity,
        fields=fields,
        sweeps=scheme.sweeps,
    )
