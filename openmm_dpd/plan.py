"""Scene + choices -> Plan: the least that this scene needs, decided before anything is built."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, field
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from .errors import ParameterError, PlanError
from .kernels.engine import PairSpec, TermTable
from .kernels.sweeps import EXACT, SHARDLOW
from .model.bonds import bonded_neighbours
from .model.pairs import DPD, NONE, describe
from .model.scene import Scene, TemperatureRamp
from .units import to_md

#: Schemes and what each one is.
SCHEMES = {
    "mvv": "modified velocity Verlet: friction and noise are forces (LAMMPS: fix nve, fix mvv/dpd)",
    "shardlow": "one sweep of Shardlow's pair updates, then velocity Verlet (LAMMPS: fix shardlow)",
    "middle": "kick, half drift, sweep of exact pair updates, half drift",
    "aboba": "half drift, half kick, sweep of exact pair updates, half kick, half drift",
    "native": "OpenMM's own DPDIntegrator",
}

#: Coefficients by pair of types, all of one kind.
ResolvedTable = dict[tuple[str, str], Any]

#: Platforms on which the kernel passes over the pairs faster than a CustomNonbondedForce does.
KERNEL_PLATFORMS = ("CPU",)


@dataclass(frozen=True)
class ProgramOptions:
    """All that a program has to know.

    Attributes
    ----------
    scheme : str
        A key of :data:`SCHEMES`.
    dt : float
        Step size, ps.
    kT : float
        Thermal energy at the start, kJ/mol.
    seed : int
        Seed of the noise.
    lam : float
        Weight of the velocity prediction of ``mvv``.
    thermostat : bool
        Whether there is friction or noise at all.
    kernel_conservative : bool
        Whether the pair kernel holds a conservative force.
    sole_force : bool
        Whether there is no force but the kernel's.
    constraints : bool
        Whether the System has constraints.
    ramp : TemperatureRamp or None
    tau_ratio : float
        Trial drift in units of the step size.
    """

    scheme: str
    dt: float
    kT: float
    seed: int
    lam: float = 0.5
    thermostat: bool = True
    kernel_conservative: bool = False
    sole_force: bool = False
    constraints: bool = False
    ramp: TemperatureRamp | None = None
    tau_ratio: float = 1.0 / 32.0

    @property
    def kernel(self) -> bool:
        """Whether a pair kernel takes part at all."""
        return self.thermostat or self.kernel_conservative


@dataclass(frozen=True, eq=False)
class Plan:
    """What will be built: ``layers`` are the DPD tables, ``partners`` those of all other pair terms, each {pair of types: coefficient}."""

    scene: Scene
    spec: PairSpec
    options: ProgramOptions
    layers: tuple[ResolvedTable, ...]
    partners: tuple[ResolvedTable, ...]
    exceptions: dict[tuple[int, int], float]
    conservative: str
    platform: str | None
    notes: tuple[str, ...] = field(default=())

    def explain(self) -> str:
        """Half a page: what will be built, and why."""
        scene, options = self.scene, self.options
        frozen = 0 if scene.mobile is None else int((~scene.mobile).sum())
        lines = [
            f"{scene.n_beads} beads of {len(scene.masses)} type(s): " + ", ".join(f"{n} (mass {m:g})" for n, m in scene.masses.items()),
            "box: none" if scene.box is None else "box: " + _describe_box(scene.box),
            f"scheme: {options.scheme} ({SCHEMES[options.scheme]}), dt = {options.dt:g} ps" + self._lambda_text(),
            self._temperature_text(),
            f"seed of the noise: {options.seed}",
            "pair terms:",
        ]
        for table in (*self.layers, *self.partners):
            lines += [f"  {a} - {b}: {describe(value)}" for (a, b), value in table.items()]
        lines.append("conservative DPD force: " + self._conservative_text())
        if not options.kernel:
            lines.append("no friction, no noise: no pair kernel, no PythonForce")
        elif options.thermostat:
            transverse = any(np.any(term.gamma_perp > 0) for term in self.spec.terms)
            lines.append(
                "friction and noise: compiled pair kernel behind a PythonForce" + (", with transverse terms" if transverse else "")
            )
        if len(scene.bond_pairs):
            lines.append(f"{len(scene.bond_pairs)} harmonic bonds; {len(self.exceptions)} bonded neighbours with a factor other than 1")
        if frozen:
            lines.append(f"{frozen} beads do not move (mass 0)")
        return "\n".join(lines + [f"note: {note}" for note in self.notes])

    def _lambda_text(self) -> str:
        return f", lambda = {self.options.lam:g}" if self.options.scheme == "mvv" else ""

    def _temperature_text(self) -> str:
        ramp = self.options.ramp
        if ramp is None:
            return f"kT = {self.options.kT:g} kJ/mol"
        return f"kT from {ramp.start:g} to {ramp.stop:g} kJ/mol between steps {ramp.begin} and {ramp.end}"

    def _conservative_text(self) -> str:
        return {
            "kernel": f"in the pair kernel, which passes over the same pairs anyway (platform {self.platform})",
            "openmm": "CustomNonbondedForce with " + ("constants" if len(self.scene.masses) == 1 else "tables of type pairs"),
            "none": "none",
        }[self.conservative]


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
) -> Plan:
    """Decide what to build.

    Parameters
    ----------
    scene : Scene
    dt : time
        Step size (bare numbers: ps).
    scheme : str, default "middle"
        One of :data:`SCHEMES`.
    lam : float, default 0.5
        Weight of the velocity prediction of ``mvv``, between 0 and 1; 0.5 is plain velocity Verlet.
    conservative : {"auto", "openmm", "kernel"}
        Where the conservative DPD force is computed: a CustomNonbondedForce, or the pair kernel.  ``auto`` takes the kernel on the CPU
        platform, where it is faster, and OpenMM elsewhere.
    platform : str, optional
        Name of the platform that will be used; the fastest one by default.
    seed : int, optional
        Seed of the noise, 0 <= seed < 2^31; drawn from the operating system and recorded in the plan by default.

    Raises
    ------
    ParameterError, PlanError
        If a choice is out of bounds or cannot be combined with the scene.
    """
    step = _checked_step(dt)
    if scheme not in SCHEMES:
        raise ParameterError(f"unknown scheme {scheme!r}; it must be one of {', '.join(SCHEMES)}")
    lam = to_md(lam, "dimensionless", "lam")
    if not isinstance(lam, float) or not 0.0 <= lam <= 1.0:
        raise ParameterError(f"lam (lambda of the modified velocity Verlet scheme) must be between 0 and 1, but is {lam!r}")
    if conservative not in ("auto", "openmm", "kernel"):
        raise ParameterError(f"conservative must be 'auto', 'openmm' or 'kernel', not {conservative!r}")
    layers, partners = _split_tables(scene)
    check_cutoffs(scene.box, [*layers, *partners])
    exceptions = _exceptions(scene)
    repulsive = any(c is not NONE and c.has_conservative for table in layers for c in table.values())
    thermostat = any(c is not NONE and c.has_thermostat for table in layers for c in table.values())
    if not repulsive:
        where = "none"
    elif conservative != "auto":
        where = conservative
    else:
        # without friction there is no kernel, and OpenMM's own force needs no company
        where = "kernel" if platform in KERNEL_PLATFORMS and thermostat and scheme != "native" else "openmm"
    if scheme == "native" and where == "kernel":
        raise PlanError("the native scheme has no pair kernel; use conservative='openmm'")
    options = ProgramOptions(
        scheme=scheme,
        dt=step,
        kT=scene.initial_kT,
        seed=checked_seed(seed),
        lam=float(lam),
        thermostat=thermostat,
        kernel_conservative=where == "kernel",
        sole_force=where == "kernel" and not partners and not len(scene.bond_pairs),
        ramp=scene.kT if isinstance(scene.kT, TemperatureRamp) else None,
        tau_ratio=tau_ratio(platform),
    )
    return Plan(
        scene=scene,
        spec=_pair_spec(scene, layers, exceptions, scheme),
        options=options,
        layers=tuple(layers),
        partners=tuple(partners),
        exceptions=exceptions,
        conservative=where,
        platform=platform,
    )


def tau_ratio(platform: str | None) -> float:
    """Trial drift in units of dt: short where positions are double precision, longer where they may be single."""
    return 1.0 / 32.0 if platform in ("Reference", "CPU") else 0.25


def _checked_step(dt) -> float:
    step = to_md(dt, "time", "dt")
    if not isinstance(step, float) or step <= 0:
        raise ParameterError(f"dt must be a single time > 0, not {dt!r}")
    return step


def checked_seed(seed: int | None) -> int:
    """The seed to use; None draws one from the operating system."""
    if seed is None:
        return secrets.randbelow(2**31 - 1) + 1
    if not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**31:
        raise ParameterError(f"seed must be an integer with 0 <= seed < 2^31, not {seed!r}")
    return int(seed)


def _split_tables(scene: Scene):
    layers, partners = [], []
    for table in scene.tables:
        resolved = table.resolve(scene.type_names)
        if table.kind is DPD:
            layers.append(resolved)
        elif table.kind is not None:
            partners.append(resolved)
    return layers, partners


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


def _exceptions(scene: Scene) -> dict[tuple[int, int], float]:
    """Bonded neighbours whose factor is not 1."""
    if not len(scene.bond_pairs) or scene.special == (1.0, 1.0, 1.0):
        return {}
    found = bonded_neighbours(scene.bond_pairs, scene.n_beads)
    return {pair: scene.special[k - 1] for k, pairs in found.items() if scene.special[k - 1] != 1.0 for pair in pairs}


def term_table(table: dict, names: list[str]) -> TermTable:
    """(T, T) arrays of one table of DPD coefficients; pairs without one get cutoff 0."""
    size = len(names)
    arrays = {key: np.zeros((size, size)) for key in TermTable.__dataclass_fields__}
    for a, b in combinations_with_replacement(range(size), 2):
        coefficient = table.get((names[a], names[b]), NONE)
        if coefficient is NONE:
            continue
        fixed_sigma = coefficient.sigma is not None and coefficient.gamma is None
        values = {
            "A": coefficient.A,
            "gamma": np.nan if fixed_sigma else coefficient.gamma or 0.0,
            "sigma": coefficient.sigma if fixed_sigma else np.nan,
            "gamma_perp": coefficient.gamma_perp,
            "exponent": coefficient.exponent,
            "exponent_perp": coefficient.exponent_perp,
            "cutoff": coefficient.cutoff,
        }
        for key, value in values.items():
            arrays[key][a, b] = arrays[key][b, a] = value
    return TermTable(**arrays)


def compressed_exceptions(exceptions: dict[tuple[int, int], float], n_beads: int):
    """Exceptions as compressed rows (start, bead, factor), both directions; empty arrays if there are none."""
    if not exceptions:
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    rows = sorted([(i, j, f) for (i, j), f in exceptions.items()] + [(j, i, f) for (i, j), f in exceptions.items()])
    first = np.array([row[0] for row in rows])
    start = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=n_beads))])
    return start.astype(np.int64), np.array([row[1] for row in rows], np.int64), np.array([row[2] for row in rows])


def _pair_spec(scene: Scene, layers, exceptions, scheme: str) -> PairSpec:
    mobile = np.ones(scene.n_beads, bool) if scene.mobile is None else scene.mobile
    wall_velocity = None
    if scene.velocities is not None and np.any(scene.velocities[~mobile] != 0):
        wall_velocity = np.where(mobile[:, None], 0.0, scene.velocities)
    return PairSpec(
        types=scene.type_ids,
        inv_mass=np.where(mobile, 1.0 / scene.bead_masses, 0.0),
        terms=tuple(term_table(table, scene.type_names) for table in layers),
        update=SHARDLOW if scheme == "shardlow" else EXACT,
        exceptions=compressed_exceptions(exceptions, scene.n_beads),
        wall_velocity=wall_velocity,
    )
