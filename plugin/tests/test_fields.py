"""Heat and species on the device: forces and flows beside numpy and the host, whole steps beside the host, what is kept, bits, restarts, refusals."""

import io
from dataclasses import replace

import numpy as np
import openmm
import oracle_energy
import oracle_meso as oracle
import pytest
from conftest import available
from cuts import ends_of_all_ways
from devices import Device
from kinds import ENERGY, TABULATED
from reference_forces import matrix
from scenes import BOXES, chains, fluid, noise_of, same_bits, state_of
from test_pair_terms import COUNTER, DT, SEED, bound, close, context_of, found
from test_steps import made_on, run_on

import openmm_dpd as dpd
from openmm_dpd.base.names import FIELD, RATE, Phase
from openmm_dpd.kernels.engines import engine_kind
from openmm_dpd.kernels.layer import CONSERVATIVE, DISSIPATIVE, RANDOM
from openmm_dpd.model.sources import Block, Source, Sphere
from openmm_dpd.simulation.device_check import differences
from openmm_dpd.simulation.fields import kept_rates, per_dof

BOX, N = BOXES["ortho"], 60
PAIRS = (("A", "A"), ("A", "B"), ("B", "B"))
WARM = {
    "A": (25.0, 31.0, 18.0), "gamma": (4.5, 2.0, 9.0), "kappa": (0.7, 0.2, 1.3), "cutoff": (1.0, 1.2, 0.9), "cutoff_T": (1.2, 0.8, 0.9),
    "exponent": (2.0, 0.41, 1.2), "exponent_T": (2.0, 1.0, 3.0),
}  # fmt: skip
POLYNOMIALS = {
    "exponent_polynomial": ((0.5, -0.3, 0.8, 0.2), (-3.0, 0, 0, 0), (0, 0, 0, 0)),
    "kappa_polynomial": ((0.5, -0.3, 0.2, 0.1), (0, 0, 0, 0), (-0.2, 0.4, 0, 0.3)),
}
MIXED = {
    "A": (25.0, 31.0, 18.0),
    "gamma": (4.5, 2.0, 9.0),
    "cutoff": (1.0, 1.2, 0.9),
    "cutoff_c": (1.2, 0.8, 0.9),
    "exponent": (2.0, 0.6, 1.0),
}
SPECIES = {"kappa": (1.0, 0.5, 0.0, 2.0), "epsilon": (0.1, 0.0, 0.2, 0.3), "exponent_c": (2.0, 1.0, 3.0, 0.5)}
KINDS = ["heat", "lammps", "species", "energies"]


def carrying(kind: str, make=fluid, n=N, box=BOX, **options) -> dpd.Scene:
    """Two types; as much differs as may.  Species take two blocks."""
    rng = np.random.default_rng(8)
    if kind == "energies":
        options.pop("sources", None)  # these have none
        internal = dpd.InternalEnergy(TABULATED, rng.uniform(0.6, 1.8, n), conductive=rng.normal(size=n))
        return make(ENERGY, box=box, n=n, internal=internal, **options)
    if kind == "species":
        table = {pair: dpd.TDPD(**{name: of[k] for name, of in MIXED.items()}, **SPECIES) for k, pair in enumerate(PAIRS)}
        return make(table, box=box, n=n, internal=dpd.Concentrations(rng.random((n, 4)) * 2), **options)
    table = {pair: dpd.EDPD(**{name: of[k] for name, of in (WARM | POLYNOMIALS).items()}) for k, pair in enumerate(PAIRS)}
    internal = dpd.BeadTemperatures(rng.uniform(0.6, 1.8, n), rng.uniform(20.0, 50.0, n))
    return make(table, box=box, n=n, internal=internal, **({"compat": "lammps"} if kind == "lammps" else {}) | options)


def chained(table, box, n, **options) -> dpd.Scene:
    return replace(chains(box, n=n), pairs=table, **options)


def square(values) -> np.ndarray:
    a, ab, b = values
    return np.array([[a, ab], [ab, b]])


def rates_of(scene, x, v) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Forces without and with velocities, rates, and energy by the oracle."""
    draw, numbers = noise_of(N, SEED, COUNTER, 1.0, streams=5), np.zeros((5, N, N))
    for i in range(N):
        for j in range(i):
            for stream in range(5):
                numbers[stream, j, i] = draw(j, i, stream)
                numbers[stream, i, j] = numbers[stream, j, i] * (-1 if stream else 1)
    if isinstance(scene.internal, dpd.InternalEnergy):
        values = [matrix(scene, name) for name in ("A", "sigma", "kappa", "cutoff")]
        here = x, v, scene.internal.thetas, scene.type_ids, scene.bead_masses
        of = oracle_energy.dpde_rates(*here, *values, BOX, 1.0, DT, numbers[0], numbers[1])
        flow = np.column_stack([of.du_cond, of.du_mech])
    elif isinstance(scene.internal, dpd.Concentrations):
        values = [square(MIXED[name]) for name in ("A", "gamma", "exponent", "cutoff", "cutoff_c")]
        of = oracle.tdpd_pair(
            x, v, scene.internal.values, scene.type_ids, *values, *SPECIES.values(), 1.0, BOX, DT, numbers[0], numbers[1:]
        )
        flow = of.Q
    else:
        names, capacities = ("A", "gamma", "exponent", "cutoff", "kappa", "exponent_T", "cutoff_T"), scene.internal.heat_capacities(N)
        of = oracle.edpd_pair(
            x, v, scene.internal.values(N)[:, 0], capacities, scene.type_ids, scene.bead_masses, *(square(WARM[name]) for name in names),
            BOX, DT, numbers[0], None if scene.compat == "lammps" else numbers[1], *map(square, POLYNOMIALS.values()), compat=scene.compat,
        )  # fmt: skip
        heat = of.q_conductive + of.q_viscous_deterministic + of.q_viscous_random + of.q_random
        flow = (heat / capacities)[:, None]
    return of.terms.conservative, of.terms.dissipative + of.terms.random, flow, of.terms.energy


@pytest.mark.parametrize("kind", KINDS)
def test_forces_and_flows_are_the_oracles(kind, device):
    if kind == "lammps" and device.precision in ("mixed", "double"):
        pytest.skip("compiled for single precision and Reference alone, to save time")
    scene = carrying(kind, spread=0)
    context = context_of(scene, device, scheme="mvv")
    x, v = state_of(context)
    push, rest, flow, energy = rates_of(scene, x, v)
    found_energy, force = found(context, Phase.CONSERVE)
    close(force, push, bound(device))
    assert found_energy == pytest.approx(energy, rel=bound(device))
    close(found(context, Phase.FORCE_KEPT)[1], rest, bound(device))
    rates = kept_rates(context, context.plan.spec.fields, context.plan.options.pair_group)
    close(rates, flow, bound(device))
    assert same_bits(state_of(context), (x, v))
    if kind in ("species", "energies"):
        conserved = rates if kind == "species" else rates[:, :1]
        assert np.abs(conserved.sum(axis=0)).max() < device.choose(1e-12, 1e-10, 1e-6) * np.abs(rates).max()


def options_of(name: str) -> dict:
    given = {
        "chains": {"make": chained},
        "tilted": {"box": BOXES["tilted"]},
        "immobile": {"mobile": np.arange(N) > 7},
        "free": {"box": None},
        "sources": {
            "sources": [
                Source(Block([0.5, -np.inf, -np.inf], [2.0, np.inf, np.inf]), 0.7, corner=(-3.0, 0.0, 0.0), beads=np.arange(N) % 3 > 0),
                Source(Sphere([2.0, 2.0, 2.0], 1.5), -0.3),
            ]
        },
    }
    return given[name]


@pytest.mark.parametrize("name", ["chains", "tilted", "immobile", "free", "sources"])
@pytest.mark.parametrize("kind", KINDS)
def test_forces_and_flows_are_the_hosts(kind, name):
    scene = carrying(kind, **options_of(name))
    context = context_of(scene, available(Device("Reference")), scheme="mvv")
    x, v = state_of(context)
    v = np.where(scene.immobile[:, None], scene.velocities, v)
    spec = context.plan.spec
    engine = engine_kind("host").make(spec)
    engine.prepare(x, scene.box)
    _, expected, _ = engine.forces(CONSERVATIVE | DISSIPATIVE | RANDOM, v, 1.0, DT, SEED, COUNTER, spec.fields.initial)
    close(found(context, Phase.FORCE_SEEN)[1], expected, 1e-9)
    rates = kept_rates(context, spec.fields, context.plan.options.pair_group)
    close(rates, np.where(scene.immobile[:, None], 0.0, engine.rates), 1e-9)


def carried(simulation) -> np.ndarray:
    """Fields and rates in the variables of an integrator."""
    integrator = simulation.context.getIntegrator()
    names = [integrator.getPerDofVariableName(k) for k in range(integrator.getNumPerDofVariables())]
    return np.concatenate([per_dof(integrator, name) for name in sorted(names) if name.startswith((FIELD, RATE))], axis=1)


@pytest.mark.parametrize("lam", [0.5, 0.65])
@pytest.mark.parametrize("name", ["immobile", "sources"])
@pytest.mark.parametrize("kind", KINDS)
def test_steps_are_the_hosts(kind, name, lam):
    exact, scene = available(Device("Reference")), carrying(kind, **options_of(name))
    simulation = run_on(scene, exact, "mvv", lam=lam, dt=0.005)
    host = dpd.build(scene, dt=0.005, scheme="mvv", lam=lam, platform="Reference", seed=5, engine="host", loop=False).simulation()
    for _ in range(3):
        for each in (simulation, host):
            each.step(4)
        for ours, theirs in zip(
            (*state_of(simulation.context), carried(simulation)), (*state_of(host.context), carried(host)), strict=True
        ):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6 * np.abs(theirs).max())


def end_of(simulation) -> tuple:
    return (*state_of(simulation.context), carried(simulation))


@pytest.mark.parametrize(
    "precision, kind", [("single", "heat"), ("mixed", "species"), pytest.param("mixed", "energies", marks=pytest.mark.slow)]
)
def test_restarts_cuts_and_shared_beads_have_the_same_bits(precision, kind, tmp_path, monkeypatch):
    scene, device = carrying(kind, **options_of("sources")), available(Device("OpenCL", precision))
    energies = []
    note = lambda each: energies.extend(each.context.getState(energy=True).getPotentialEnergy()._value for _ in range(2))  # noqa: E731
    ends = ends_of_all_ways(lambda: run_on(scene, device, "mvv", lam=0.65, dt=0.005), end_of, tmp_path, note)
    if precision == "mixed":
        monkeypatch.setenv("OPENMM_DPD_DEVICE_LANES", "8")
        shared = run_on(scene, device, "mvv", lam=0.65, dt=0.005)
        shared.step(20)
        ends.append(end_of(shared))
    assert all(same_bits(ends[0], end) for end in ends[1:])
    assert len(set(energies)) == 1


def test_what_is_set_acts_at_once_and_in_full():
    """Energies follow the temperatures that a Context has now, and so do the next step and its first half kick."""
    scene, exact = carrying("heat"), available(Device("Reference"))
    built = made_on(scene, exact, "mvv", dt=0.005)
    host = dpd.build(scene, dt=0.005, scheme="mvv", platform="Reference", seed=5, engine="host")
    pair = [each.simulation() for each in (built, host)]
    for simulation, plan in zip(pair, (built.plan, host.plan), strict=True):
        simulation.step(3)
        theta = dpd.read_fields(simulation.context, plan)["theta"]
        dpd.write_fields(simulation.context, plan, theta=1.5 * theta)
    energies = [each.context.getState(energy=True).getPotentialEnergy()._value for each in pair]
    assert energies[0] == pytest.approx(energies[1], rel=1e-8)
    for simulation in pair:
        simulation.step(2)
    for ours, theirs in zip(*map(end_of, pair), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-6 * np.abs(theirs).max())
    samples = [dpd.Observer(each).sample(simulation.context) for each, simulation in zip((built, host), pair, strict=True)]
    assert samples[0].potential == pytest.approx(samples[1].potential, rel=1e-7)


def test_states_in_which_immobile_beads_were_given_others_are_refused():
    scene, exact = carrying("species", mobile=np.arange(len(carrying("species").types)) > 9), available(Device("Reference"))
    host = dpd.build(scene, dt=0.005, scheme="mvv", platform="Reference", seed=5, engine="host")
    simulation, state = host.simulation(), io.StringIO()
    dpd.write_fields(simulation.context, host.plan, concentrations=1.5 * dpd.read_fields(simulation.context, host.plan)["concentrations"])
    simulation.saveState(state)
    device = made_on(scene, exact, "mvv", dt=0.005).simulation()
    device.loadState(io.StringIO(state.getvalue()))
    for act in (lambda: device.step(1), lambda: device.context.getState(energy=True)):
        with pytest.raises(dpd.RunError, match="devices cannot take these"):
            act()


@pytest.mark.parametrize("kind", ["heat", "species", "energies"])
def test_it_goes_through_xml_and_a_plain_integrator_keeps_what_beads_carry(kind):
    scene, exact = carrying(kind, **options_of("sources")), available(Device("Reference"))
    built = made_on(scene, exact, "mvv", dt=0.005)
    simulation, texts = built.simulation(), [openmm.XmlSerializer.serialize(each) for each in (built.system, built.integrator)]
    assert f'version="{4 if kind == "energies" else 3}"' in texts[0] and "pickle" not in texts[0]
    system, integrator = map(openmm.XmlSerializer.deserialize, texts)
    assert openmm.XmlSerializer.serialize(system) == texts[0]
    for old, new, message in (
        (' carried="', ' carried="1 ', "as many values"),
        (' carrying="', ' carrying="1 ', "as many values"),
        (' takes="', ' takes="1 ', "sources") if kind != "energies" else (' states="', ' states="0 0 0 0 ', "equations of state"),
        (' cutoffCarried="', ' cutoffCarried="1 ', "as many values"),
    ):
        assert texts[0].count(old) == 1
        with pytest.raises(openmm.OpenMMException, match=message):
            openmm.XmlSerializer.deserialize(texts[0].replace(old, new))
    context = openmm.Context(system, integrator, openmm.Platform.getPlatformByName("Reference"))
    context.setPositions(built.positions)
    context.setVelocities(built.velocities)
    for _ in range(2):
        integrator.step(3)
        simulation.step(3)
        read = np.array(integrator.getPerDofVariableByName("field0"))
        np.testing.assert_allclose(read, per_dof(simulation.integrator, "field0"), rtol=0, atol=1e-12)


def test_energy_and_species_are_kept():
    """By flows, to rounding."""
    exact = available(Device("Reference"))
    simulation = run_on(carrying("species"), exact, "mvv", dt=0.005)
    before = carried(simulation)[:, [0, 1, 2, 3]].sum(axis=0)
    simulation.step(100)
    np.testing.assert_allclose(carried(simulation)[:, [0, 1, 2, 3]].sum(axis=0), before, rtol=1e-11)
    scene = carrying("heat")
    scene = replace(scene, pairs={("*", "*"): dpd.EDPD(A=25, gamma=0, kappa=1e-3)})
    simulation, capacities = run_on(scene, exact, "mvv", dt=0.005), scene.internal.capacities
    before = capacities @ carried(simulation)[:, 0]
    simulation.step(100)
    after = carried(simulation)[:, 0]
    assert np.abs(after - scene.internal.thetas).max() > 0.03
    assert capacities @ after == pytest.approx(before, rel=1e-11)


def test_a_ramp_of_the_temperature_is_the_hosts():
    scene = replace(carrying("species"), kT=dpd.TemperatureRamp(1.0, 2.0, 0, 20))
    ours = made_on(scene, available(Device("Reference")), "mvv", dt=0.005).simulation()
    host = dpd.build(scene, dt=0.005, scheme="mvv", platform="Reference", seed=5, engine="host").simulation()
    for _ in range(2):
        for each in (ours, host):
            each.step(6)
            each.context.setVelocities(0.5 * each.context.getState(velocities=True).getVelocities(asNumpy=True))
    for mine, theirs in zip(end_of(ours), end_of(host), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-6 * np.abs(theirs).max())


@pytest.mark.parametrize(
    "change, message",
    [
        ("cold", "the temperature of bead [0-9]+ is not > 0"),
        ("conduction", "the heat conduction coefficient of bead [0-9]+ and another one is neg"),
    ],
)
def test_what_cannot_go_on_is_an_error(change, message):
    scene = carrying("heat")
    if change == "conduction":
        pair = dpd.EDPD(A=0, gamma=4.5, kappa=0.1, kappa_polynomial=(-4.0, 0, 0, 0))
        scene = replace(scene, pairs={("*", "*"): pair}, internal=dpd.BeadTemperatures(1.0, scene.internal.capacities))
    else:
        scene = replace(scene, sources=[Source(Block.centred([2, 2, 2], [9, 9, 9]), -900.0)])
    built = made_on(scene, available(Device("Reference")), "mvv", dt=0.005)
    simulation = built.simulation()
    if change == "conduction":
        dpd.write_fields(simulation.context, built.plan, theta=1.5)
    before = end_of(simulation)
    with pytest.raises(openmm.OpenMMException, match=message):
        simulation.step(10)
        dpd.read_fields(simulation.context, built.plan)
    assert same_bits(end_of(simulation), before)


@pytest.mark.parametrize(
    "kind, options, scheme, message",
    [
        ("species", {}, "middle", "it has pair updates of up to 3 species"),
        ("species", {"sources": [dpd.Buoyancy([0, 0, 1.0], 1.0)]}, "mvv", "no forces that follow what beads carry"),
        ("species", {"sources": [Source(Sphere([1, 1, 1], 1), 0.1)] * 32}, "mvv", "no more than 31 sources"),
    ],
)
def test_what_it_has_not_is_refused_by_name_or_the_hosts(kind, options, scheme, message, monkeypatch):
    scene, exact = carrying(kind, **options), available(Device("Reference"))
    with pytest.raises(dpd.PlanError, match=message):
        made_on(scene, exact, scheme)
    monkeypatch.setattr("openmm_dpd.plan.device.is_gpu", lambda platform: True)
    assert "not the device: " in dpd.build(scene, dt=0.01, scheme=scheme, platform="Reference", seed=1).explain()
    assert "device (the platform is a GPU)" in made_on(carrying(kind), exact, "mvv", engine="auto").explain()


def test_it_is_compared_with_the_host_when_a_simulation_is_made():
    exact = available(Device("Reference"))
    for kind in KINDS:
        simulation = run_on(carrying(kind, **options_of("sources")), exact, "mvv", dt=0.005)
        found = differences(simulation.context, simulation._plan)
        assert set(found) == {"the conservative force", "its energy", "friction and noise", "what beads carry"}
        assert max(error for error, _ in found.values()) < 1e-9
