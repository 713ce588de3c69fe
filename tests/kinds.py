"""One small scene for everything that a whole step may have to do, and runs of it in all the ways there are."""

import io
from dataclasses import replace

import numpy as np
import openmm
from devices import Device
from scenes import BOXES, EXTENDED, MASSES, PARTIAL, PLAIN, fluid, place, state_of

import openmm_dpd as dpd
from openmm_dpd.model.eos import ConstantHeatCapacity, TabulatedEOS
from openmm_dpd.plan.plan import Plan, make_plan
from openmm_dpd.simulation.build import build_plan
from openmm_dpd.simulation.fields import raw_fields

N, SEED = 60, 11
TILTED = BOXES["tilted"]
#: Fewer beads want a smaller box: what is narrower than three cutoffs has no cells, and all pairs are gone through.
SMALL = np.diag([3.7, 3.6, 3.8])

ENERGY = {
    ("A", "A"): dpd.EnergyDPD(A=25, sigma=3, kappa=2.0, cutoff=1.0),
    ("A", "B"): dpd.EnergyDPD(A=31, sigma=2, kappa=1.0, cutoff=1.2),
    ("B", "B"): dpd.EnergyDPD(A=18, sigma=4, kappa=3.0, cutoff=0.9),
}
TABULATED = {"A": ConstantHeatCapacity(40.0), "B": TabulatedEOS.from_functions(lambda theta: 50 * theta + 5 * theta**2, (0.2, 5.0))}
HEAT = {
    ("A", "A"): dpd.EDPD(A=18, gamma=4.5, kappa=2e-3, cutoff=1.0, exponent=0.8, exponent_polynomial=(2.0, -1.0, 0.5, 0.0)),
    ("A", "B"): dpd.EDPD(A=15, gamma=3.0, kappa=1e-3, cutoff=0.9, cutoff_T=1.2, kappa_polynomial=(-0.4, 0.1, 0.0, 0.0)),
    ("B", "B"): dpd.EDPD(A=22, gamma=6.0, kappa=3e-3, cutoff=1.1, cutoff_T=0.8),
}
SPECIES = {
    ("A", "A"): dpd.TDPD(A=18, gamma=4.5, kappa=(1.0, 2.0, 0.0, 0.5), epsilon=0.02, exponent=0.8),
    ("A", "B"): dpd.TDPD(A=15, gamma=3.0, kappa=(0.5, 1.0, 1.0, 0.1), cutoff_c=1.2, exponent_c=(2, 1, 2, 3)),
    ("B", "B"): dpd.TDPD(A=22, gamma=6.0, kappa=(2.0, 2.0, 2.0, 2.0), epsilon=(0.0, 0.1, 0.0, 0.0), cutoff=0.9),
}


def plain(table=EXTENDED, box=SMALL, **options) -> dpd.Scene:
    """Beads of two types; on a lattice that is shaken, so that nothing flies apart."""
    side = 4
    rng = np.random.default_rng(7)
    places = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)[:N] + 0.5
    edges = np.diag([3.6] * 3) if box is None else box
    x = (places / side + rng.normal(size=(N, 3)) * 0.03) @ edges
    return fluid(table, box, n=N, positions=options.pop("positions", x), **options)


def walled(kind_x: str | None, kind_z: str, **options) -> dpd.Scene:
    """Walls across z (and x): beads between 0.9 and 3.5."""
    x = plain().positions.copy()
    planes = [dpd.Wall("z", 0.7, "above", kind_z), dpd.Wall("z", 3.3, "below", kind_z)]
    x[:, 2] = 0.75 + (x[:, 2] % 3.8) / 3.8 * 2.5
    if kind_x:
        planes += [dpd.Wall("x", 0.4, "above", kind_x), dpd.Wall("x", 3.4, "below", kind_x)]
        x[:, 0] = 0.45 + (x[:, 0] % 3.7) / 3.7 * 2.9
    return plain(positions=x, walls=planes, **options)


def chains(*, box=SMALL, bodies=True, electric=False, formulas=False, **options) -> dpd.Scene:
    """Twelve chains of four with bonds of all kinds, angles, overlays, segments and body forces."""
    rng = np.random.default_rng(3)
    start = np.stack(np.meshgrid([0.15, 0.4, 0.65, 0.9], [0.17, 0.5, 0.83], [0.2]), axis=-1).reshape(-1, 3)
    edges = np.diag([3.6] * 3) if box is None else box
    steps = np.array([[0.0, 0.1, 0.6], [0.1, 0.0, 0.65], [0.0, -0.1, 0.6]])
    x = np.concatenate([np.cumsum(np.vstack([c @ edges, steps]), axis=0) for c in start]) + rng.normal(size=(48, 3)) * 0.03
    x = np.concatenate([x, (rng.random((12, 3)) * [1, 1, 0.15]) @ edges])
    first = 4 * np.arange(12)
    bonds = [
        dpd.HarmonicBonds(np.stack([first, first + 1], axis=1), 60.0, 0.6),
        dpd.FENEBonds(np.stack([first + 1, first + 2], axis=1), 20.0, 2.2, 0.4, 0.5),
        dpd.MorseBonds(np.stack([first + 2, first + 3], axis=1), 12.0, 2.0, 0.6),
    ]
    angles = [
        dpd.HarmonicAngles(np.stack([first, first + 1, first + 2], axis=1), 4.0, 2.4),
        dpd.CosineAngles(np.stack([first + 1, first + 2, first + 3], axis=1), 3.0),
    ]
    r = np.linspace(0.01, 1.1, 40)
    pushed, wall = dpd.LennardJones(0.2, 0.4, 1.1, shift=True), dpd.TabulatedPair(r, 3 * (1.1 - r) ** 3, forces=9 * (1.1 - r) ** 2)
    lennard_jones = {("A", "A"): pushed, ("A", "B"): dpd.NONE, ("B", "B"): dpd.NONE}
    tabulated = {("A", "B"): wall, ("A", "A"): dpd.NONE, ("B", "B"): dpd.NONE}
    tables = [dpd.PairTable(table) for table in (EXTENDED, lennard_jones, tabulated)]
    bodies = [dpd.BodyForce((0.3, -0.2, 0.1), types="A")] if bodies else []
    if formulas:
        bodies.append(dpd.PositionForce(("0.4*sin(z)", "0", "0.1*x"), types="B"))
    charged = {}
    if electric:
        q = np.zeros(N)
        q[:20] = np.tile([1.0, -1.0], 10)
        charged = {"charges": q, "electrostatics": dpd.SlaterCharges(lamda=0.25, bjerrum_length=1.0, cutoff=1.7)}
    rows = {"n": N, "positions": x, "bonds": bonds, "angles": angles, "bonded_factors": (0.0, 0.5, 1.0)}
    segments = dpd.SegmentalRepulsion(A=15, cutoff=0.7)
    return fluid(tables, box, **rows, segments=segments, body_forces=bodies, **charged, **options)


def energies(eos, **options) -> dpd.Scene:
    return plain(ENERGY, internal=dpd.InternalEnergy(eos, np.random.default_rng(5).uniform(0.7, 1.4, N)), **options)


def _warm(**options) -> dpd.Scene:
    rng = np.random.default_rng(4)
    sources = [dpd.Source(dpd.Sphere((1.0, 1.0, 0.5), 0.9), 0.4)]
    return plain(HEAT, internal=dpd.BeadTemperatures(rng.uniform(0.8, 1.2, N), rng.uniform(20, 60, N)), sources=sources, **options)


def _species(**options) -> dpd.Scene:
    rng = np.random.default_rng(4)
    sources = [dpd.Source(dpd.Block.centred((1.0, 1.0, 1.0), (1.5, 1.5, 1.5)), 0.7, species=3)]
    return plain(SPECIES, internal=dpd.Concentrations(rng.uniform(0.0, 2.0, (N, 4))), sources=sources, **options)


def _many_body(kernel: str) -> dpd.Scene:
    return plain({("*", "*"): dpd.MDPD(A=-40, B=25, gamma=4.5, cutoff=1.0, cutoff_B=0.75, kernel=kernel)})


def _patterned() -> dpd.Scene:
    bodies = [  # far from the planes where a sign changes rounding decides nothing; sines are rounded wherever a bead is
        dpd.BodyForce((0.5, 0, 0), pattern="halves", axis="z", origin=0.137),
        dpd.BodyForce((0, 0.4, 0), pattern="sine", axis="x", origin=0.3, types="A"),
    ]
    return plain(body_forces=bodies)


SOLID = np.arange(N) % 5 > 0

KINDS = {  # Name -> scene.
    "dpd": plain,
    "no box": lambda: plain(box=None),
    "tilted": lambda: plain(box=TILTED),
    "two layers": lambda: plain([dpd.PairTable(EXTENDED), dpd.PairTable(PARTIAL)]),
    "sigma": lambda: plain({("*", "*"): dpd.DPD(A=25, sigma=3.0, gamma_perp=2.0)}),
    "friction alone": lambda: plain({("*", "*"): dpd.DPD(gamma=4.5)}),
    "no friction": lambda: plain({("*", "*"): dpd.DPD(A=25)}),
    "cold": lambda: plain(PLAIN, kT=0.0),
    "energies": lambda: energies(ConstantHeatCapacity(60.0)),
    "tabulated energies": lambda: energies(TABULATED, mobile=SOLID),
    "edpd": lambda: _warm(mobile=SOLID),
    "tdpd": lambda: _species(mobile=SOLID),
    "mdpd": lambda: _many_body("quadratic"),
    "mdpd lucy": lambda: _many_body("lucy"),
    "specular": lambda: walled(None, "specular"),
    "bounce-back": lambda: walled(None, "bounce-back"),
    "mixed walls": lambda: walled("specular", "bounce-back"),
    "energies between walls": lambda: energies(
        TABULATED, walls=walled(None, "specular").walls, positions=walled(None, "specular").positions
    ),
    "immobile": lambda: plain(mobile=SOLID, velocities=np.where(SOLID[:, None], plain().velocities, 0.0)),
    "moving walls": lambda: plain(mobile=SOLID),
    "ramp": lambda: plain(kT=dpd.TemperatureRamp(1.0, 2.0, 2, 15)),
    "bonded": chains,
    "bonded, no box": lambda: chains(box=None),
    "bonded, tilted": lambda: chains(box=TILTED, mobile=np.arange(N) != 5),
    "patterns": _patterned,
    "charged": lambda: chains(electric=True),
    "formulas": lambda: chains(formulas=True),
}

BESIDE = ("charged", "formulas")  # Forces that stay OpenMM's, which rounds them in its own way.
NAMED = ("mvv", "mvv-0.65", "shardlow", "middle", "aboba", "bababo")
WORDS = ("B/2 A/2 O A/2 B/2", "O/2 B/2 A B/2 O/2", "A/4 O/2 A/4 B/3 S/2 A/2 2B/3")


def schemes_of(kind: str, words=WORDS) -> tuple[str, ...]:
    """Schemes and words that run a scene."""
    return NAMED + tuple(words)


def charges_left(plan: Plan) -> Plan:
    """A plan whose charges stay OpenMM's."""
    execution = replace(plan.execution, held=plan.execution.held - {"charges"})
    return replace(plan, options=replace(plan.options, execution=execution))


def made(kind: str, scheme: str, platform: str = "Reference", *, dt: float = 0.01, loop: bool = True, **choices) -> dpd.BuiltSystem:
    """A scene, built; "mvv-0.65" is mvv with that lambda."""
    name, _, lam = scheme.partition("-")
    conservative = "auto" if kind == "friction alone" else "kernel"
    options = {"lam": float(lam)} if lam else {}
    choices = {"seed": SEED, "conservative": conservative, **options, **choices}
    plan = make_plan(KINDS[kind](), dt=dt, scheme=name, platform=platform, loop=loop, **choices)
    return build_plan(charges_left(plan))  # these charges are there as a force that stays OpenMM's


def running(built: dpd.BuiltSystem, platform: str = "Reference"):
    """A Simulation of it."""
    simulation = built.simulation(properties=Device(platform).properties)
    simulation.built = built
    return simulation


def plain_context(built: dpd.BuiltSystem, platform: str = "Reference") -> openmm.Context:
    """A Context of the System and the integrator as they come out of XML, which is no subclass any more."""
    system, integrator = (openmm.XmlSerializer.deserialize(openmm.XmlSerializer.serialize(one)) for one in (built.system, built.integrator))
    assert type(integrator) is openmm.CustomIntegrator
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName(platform), Device(platform).properties)
    place(context, built.positions, built.velocities)
    return context


def everything(context: openmm.Context, built: dpd.BuiltSystem) -> dict[str, np.ndarray]:
    """All that a step changes, but for variables of the programs."""
    state = context.getState(positions=True, velocities=True, parameters=True)
    x, v = state_of(context)
    found = {"x": x, "v": v, "steps": state.getStepCount(), "time": state.getTime()._value}
    found |= {name: state.getParameters()[name] for name in ("dpd_counter", "dpd_kT") if name in state.getParameters()}
    if built.plan.spec.fields is not None:
        found["fields"] = raw_fields(context, built.plan.spec.fields)
    return {name: np.asarray(value) for name, value in found.items()}


def sizes(found: dict, dt: float) -> dict[str, float]:
    """What is typical: of positions, how far they go in a step."""
    found_sizes = {"fields": np.abs(found["fields"]).max()} if "fields" in found else {}
    v = max(1.0, np.abs(found["v"]).max())
    return {"x": dt * v + 1e-3 * np.abs(found["x"]).max(), "v": v} | found_sizes


def differences(found: dict, expected: dict, dt: float) -> dict[str, float]:
    """Largest deviations in units of what is typical; counts have to be the same."""
    scale = sizes(expected, dt)
    return {name: float(np.abs(found[name] - expected[name]).max() / scale.get(name, 1.0)) for name in expected}


def same(found: dict, expected: dict) -> list[str]:
    """Names of what differs by a bit."""
    return [name for name in expected if not np.array_equal(found[name], expected[name])]


def hand_over(first, second) -> None:
    """Load the state of one Simulation into another, by XML."""
    file = io.StringIO()
    first.saveState(file)
    file.seek(0)
    second.loadState(file)


__all__ = ["KINDS", "MASSES", "NAMED", "WORDS", "differences", "everything", "hand_over", "made", "plain_context", "running", "same"]
