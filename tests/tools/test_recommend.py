"""recommend and the table of steps: interpolation of a made-up table, bounds, the sentence of explain, and the shipped table."""

import numpy as np
import pytest
from cases import cases, refused
from openmm import unit

import openmm_dpd as dpd
from openmm_dpd.advice.recommend import AIM, advice, predicted_error, recommend
from openmm_dpd.advice.scene_groups import charge_frequency, groups, liquid_density
from openmm_dpd.advice.stability_table import LEVELS, Groups, StabilityTable, TransportTable, shipped_table
from openmm_dpd.model.schemes import SCHEMES

BASE = {"gamma": 4.5, "a": 25.0, "rho": 3.0, "mass": 1.0, "s": 1.0, "cv": None}

#: Made-up steps at 1 %: power laws, which bilinear interpolation in logarithms gives back exactly.
SLOPES = {"mvv": (0.02, -0.5), "middle": (0.06, 0.0)}


def made_up(step, frictions=(0.5, 4.5, 40.5, 450.0), repulsions=(1.0, 4.0, 25.0)) -> dict:
    """A table where ``step(scheme, point)`` is the step at 1 %, with errors going as its square."""
    points = [BASE | {"gamma": g, "a": a} for g in frictions for a in repulsions]
    points += [BASE | {"gamma": g, "rho": rho} for g in (4.5, 40.5) for rho in (1.0, 8.0)]
    points += [BASE | {"gamma": g, "mass": mass} for g in (4.5, 40.5) for mass in (10.0, 100.0)]
    points += [BASE | {"cv": cv} for cv in (1.0, 100.0)]
    for p in points:
        p["schemes"] = {}
        for scheme in SLOPES:
            dt = step(scheme, p)
            levels = {f"{100 * level:g}": [dt * (level / 0.01) ** 0.5, 0.001, ""] for level in LEVELS}
            p["schemes"][scheme] = {"conf": levels, "kin": {k: [2 * v[0], *v[1:]] for k, v in levels.items()}, "blow": [8 * dt, 0.0, ""], "sign": {"conf": 1, "kin": -1}}  # fmt: skip
    return {"base": BASE, "cost": {"mvv": 1.0, "middle": 1.2}, "points": points}


def power(scheme: str, p: dict) -> float:
    """Depends on the friction in surroundings alone."""
    at = Groups(p["gamma"], p["a"], p["rho"], p["mass"], p["s"], p["cv"])
    front, slope = SLOPES[scheme]
    return front * (at.friction / 4.5) ** slope


@pytest.fixture(scope="module")
def table() -> StabilityTable:
    return StabilityTable(made_up(power))


def scene(gamma=4.5, A=25.0, rho=3.0, *, kT=1.0, cutoff=1.0, mass=1.0, n=81, **more) -> dpd.Scene:
    """A fluid of one type."""
    edge = (n / rho) ** (1 / 3) * cutoff
    pairs = more.pop("pairs", {("W", "W"): dpd.DPD(A=A, gamma=gamma, cutoff=cutoff)})
    x = np.random.default_rng(1).random((n, 3)) * edge * more.pop("squeezed", 1.0)
    return dpd.Scene({"W": mass}, ["W"] * n, x, pairs, kT=kT, box=[edge] * 3, **more)


# -- interpolation ---------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("gamma", [0.5, 1.0, 4.5, 11.0, 40.5])
@pytest.mark.parametrize("a", [1.0, 3.0, 10.0, 25.0])
def test_power_laws_are_interpolated_exactly(table, gamma, a):
    at = Groups(gamma, a)
    for scheme, (front, slope) in SLOPES.items():
        assert table.step(scheme, at, 0.01, "conf") == pytest.approx(front * (gamma / 4.5) ** slope, rel=1e-9)


@pytest.mark.parametrize("error", [0.0004, 0.0025, 0.01, 0.02, 0.05, 0.07, 0.1])
def test_step_and_error_are_inverse_and_quadratic(table, error):
    at = Groups(4.5, 25.0)
    dt = table.step("mvv", at, error, "conf")
    assert dt == pytest.approx(0.02 * (error / 0.01) ** 0.5, rel=1e-6)
    assert table.error("mvv", at, dt, "conf") == pytest.approx(error, rel=1e-6)


def test_values_beyond_the_table(table):
    """Errors over 10 % are not guessed; a large heat capacity is a thermostat."""
    assert table.error("mvv", Groups(4.5, 25.0), 0.065, "conf") == np.inf
    at = Groups(4.5, 25.0, cv=1e7)
    assert table.outside(at) == []
    assert table.step("mvv", at, 0.01, "conf") == pytest.approx(0.02)


def test_corrections_of_lines_are_interpolated():
    """Steps half as long at mass ratio 100, at both frictions: 0.5^(1/2) at 10, and that between the frictions as well; longer ones by a tenth
    at most."""
    table, longer = (
        StabilityTable(made_up(lambda scheme, p, of=of: power(scheme, p) * of ** (np.log10(p["mass"]) / 2))) for of in (0.5, 2.0)
    )
    for gamma in (4.5, 12.0, 40.5):
        for mass, power_ in ((1.0, 0.0), (10.0, 0.5), (30.0, np.log10(30) / 2), (100.0, 1.0)):
            at = Groups(gamma, 25.0, mass=mass)
            assert table.step("middle", at, 0.01, "conf") == pytest.approx(0.06 * 0.5**power_, rel=1e-9)
            assert longer.step("middle", at, 0.01, "conf") == pytest.approx(0.06 * min(2.0**power_, 1.1), rel=1e-9)


def test_friction_counts_the_weight_function():
    """The integral of w^(2s) r^2, by quadrature."""
    r = (np.arange(200000) + 0.5) / 200000
    for s in (0.25, 1.0, 2.0):
        ratio = np.sum((1 - r) ** (2 * s) * r**2) / np.sum((1 - r) ** 2 * r**2)
        assert Groups(4.5, 25.0, rho=6.0, s=s).friction == pytest.approx(4.5 * 2 * ratio, rel=1e-6)


def test_missing_points_take_their_neighbours_in_friction():
    data = made_up(power)
    data["points"] = [p for p in data["points"] if not (p["gamma"] == 4.5 and p["a"] == 4.0 and p["rho"] == 3.0)]
    table = StabilityTable(data)
    assert table.step("mvv", Groups(4.5, 4.0), 0.01, "conf") == pytest.approx(0.02, rel=1e-9)  # half way in the logarithm


@pytest.mark.parametrize("change", [{"gamma": 500.0}, {"a": 26.0}, {"a": 0.5}, {"rho": 9.0}, {"mass": 200.0}, {"s": 2.0}, {"cv": 0.5}])
def test_beyond_the_table_is_said(table, change):
    (text,) = table.outside(Groups(**({"gamma": 4.5, "a": 25.0} | change)))
    assert text.startswith("no steps were measured at a ")


# -- recommend -------------------------------------------------------------------------------------------------------------------
def test_the_cheapest_scheme_is_recommended(table):
    found = recommend(scene(), table=table)
    assert (found.scheme, [c.scheme for c in found.choices]) == ("middle", ["middle", "mvv"])
    assert found.dt == pytest.approx(0.06 * AIM)
    assert found.relative_cost == pytest.approx(1.2 / 0.06 * 0.02)
    assert found.choices[0].limit == "configurational temperature"
    assert "within 1 % (95 of 100 times): middle at dt = 0.052" in str(found)


def test_units_do_not_matter(table):
    """The same fluid with lengths 0.6 nm, masses 54 Da and kT = 2.5 kJ/mol: steps in units of rc (m/kT)^(1/2)."""
    kT, cutoff, mass = 2.5, 0.6, 54.0
    time = cutoff * (mass / kT) ** 0.5
    other = scene(gamma=4.5 * (mass * kT) ** 0.5 / cutoff, A=25 * kT / cutoff, kT=kT, cutoff=cutoff, mass=mass)
    assert recommend(other, table=table).dt == pytest.approx(0.06 * AIM * time)


def test_safety_distance_from_the_blow_up():
    data = made_up(power)
    for p in data["points"]:
        p["schemes"]["middle"]["blow"] = [0.05, 0.001, ""]
    middle = next(c for c in recommend(scene(), 0.01, table=StabilityTable(data)).choices if c.scheme == "middle")
    assert (middle.dt, middle.limit) == (pytest.approx(0.035), "stability")


def test_dips_limit_the_step():
    """Before 0.2 (a rho/3)^(-1/2), which is 0.04 at a = 25; not for 5 %; in mixtures that of the softest species, here (2 + 10)/2."""
    dips, plain = StabilityTable(made_up(power) | {"dips": {"middle": 0.2}}), StabilityTable(made_up(power))
    mixed = mixture(dpd.DPD(A=2, gamma=4.5), dpd.DPD(A=10, gamma=4.5), dpd.DPD(A=25, gamma=4.5))
    for of, error, limit in ((scene(), 0.01, 0.04), (scene(), 0.05, np.inf), (mixed, 0.01, 0.2 / (6 * 80 / 81) ** 0.5)):
        steps = [next(c.dt for c in recommend(of, error, table=table).choices if c.scheme == "middle") for table in (dips, plain)]
        assert steps[0] == pytest.approx(min(AIM * limit, steps[1]))


def test_stiff_bonds_limit_the_step_by_what_each_scheme_does_to_them(table):
    """U = k (r - r0)^2: omega^2 = 2 k (1/m + 1/m).  Velocity Verlet: (omega dt)^2/4 = 0.01/(1 + 0.01); middle is exact, and stops at 2."""
    bonded = scene(bonds=[dpd.HarmonicBonds([[0, 1]], 1e4, 0.5)])
    found = {c.scheme: c for c in recommend(bonded, table=table).choices}
    assert found["mvv"].dt == pytest.approx(AIM * 2 * (0.01 / 1.01) ** 0.5 / 200, rel=0.02)
    assert found["middle"].dt == pytest.approx(AIM * 0.7 * 2 / 200, rel=0.01)
    assert {c.limit for c in found.values()} == {"bonds"}


def test_charges_limit_the_step_by_their_frequency(table):
    """Slater clouds at r = 0: -U'' = 4/3 l_B kT/lamda^3, and omega^2 = U''(1/m + 1/m), taken for a bond: velocity Verlet is 1 % off at 0.2."""
    slater = [dpd.SlaterCharges(lamda=lamda, bjerrum_length=0.5, cutoff=1.4) for lamda in (0.05, 0.3)]
    sharp, wide = (scene(charges=[1.0, -1.0] + 79 * [0.0], electrostatics=cloud) for cloud in slater)
    omega = (4 / 3 * 0.5 / 0.05**3 * 2) ** 0.5
    assert charge_frequency(sharp) == pytest.approx(omega, rel=1e-3)
    found = next(c for c in recommend(sharp, table=table).choices if c.scheme == "mvv")
    assert (found.dt, found.limit) == (pytest.approx(AIM * 2 * (0.01 / 1.01) ** 0.5 / omega, rel=0.02), "charges")
    assert "(charge temperature)" in advice(sharp, "mvv", 0.01, table=table)
    assert recommend(wide, table=table).dt == recommend(scene(), table=table).dt
    assert charge_frequency(scene()) == 0.0


def test_angles_limit_the_step(table):
    bonds = [dpd.HarmonicBonds([[0, 1], [1, 2]], 1.0, 0.5)]
    bent = scene(bonds=bonds, angles=[dpd.HarmonicAngles([[0, 1, 2]], 5000.0, 2.0)])
    assert {c.limit for c in recommend(bent, table=table).choices} == {"angles"}


@cases(
    "more, what",
    ({"bonds": [dpd.HarmonicBonds([[0, 1], [1, 2]], 1.0, 0.5)], "segments": dpd.SegmentalRepulsion(100.0, 0.8)}, "segmental repulsion"),
    ({"walls": [dpd.Wall("z", 0.0, "above"), dpd.Wall("z", 2.0, "below")], "squeezed": 0.6}, "walls"),
    ({"pairs": [{("W", "W"): dpd.MDPD(A=-40, B=25, gamma=18)}, {("W", "W"): dpd.DPD(A=1, gamma=0)}]}, "MDPD"),
)
def test_what_was_not_measured_has_no_step(table, more, what):
    found = recommend(scene(**more), table=table)
    assert found.dt is None and what in found.notes[0] and "benchmarks/recommended_steps.py" in found.notes[0]


# -- many-body liquids ------------------------------------------------------------------------------------------------------------
def liquid(a=-40.0, b=25.0, gamma=18.0, kT=1.0, **more) -> dpd.Scene:
    """Warren's, or another in units of kT, with vacuum beside it."""
    pairs = {("W", "W"): dpd.MDPD(A=a * kT, B=b * kT, gamma=gamma, **more.pop("coefficient", {}))}
    return scene(pairs=pairs, kT=kT, squeezed=0.5, **more)


def test_density_of_a_many_body_liquid():
    """Where Warren's equation of state has no pressure; his figure 1 has 6.1 at A = -40, B = 25."""
    rho = liquid_density(-40, 25)
    many = 0.202 * 25 * 0.75**4
    assert rho - 0.101 * 40 * rho**2 + many * (rho**3 - 4.16 * rho**2 + 18) == pytest.approx(0, abs=1e-9)
    assert rho == pytest.approx(6.1, abs=0.05) and liquid_density(0, 25) == 0.0


def test_many_body_liquids_have_steps_of_their_own():
    found = recommend(liquid())
    assert found.dt is not None and found.scheme in {c.scheme for c in found.choices} and 0.01 < found.dt < 0.1
    assert {c.scheme for c in found.choices} == set(SCHEMES) - {"native"}
    soft, stiff = recommend(liquid(-20, 12.5)), recommend(liquid(-80, 50))
    assert soft.dt > found.dt > stiff.dt
    # the same groups: a step goes with (m/kT)^(1/2)
    assert recommend(liquid(kT=4.0, gamma=36.0)).dt == pytest.approx(found.dt / 2)
    assert advice(liquid(), "middle", 0.03).startswith("middle at dt")
    assert "many-body" in recommend(liquid(), quantity="diffusion").notes[-1]


@cases(
    "other, words",
    (liquid(-100, 60), "stiffness"),
    (liquid(gamma=500.0), "friction"),
    (liquid(gamma=0.0), "no friction"),
    (liquid(coefficient={"kernel": "lucy"}), "quadratic kernel"),
    (liquid(coefficient={"cutoff_B": 0.6}), "cutoff_B = 0.75"),
    (liquid(bonds=[dpd.HarmonicBonds([[0, 1]], 1.0, 0.5)]), "bonds"),
)
def test_many_body_liquids_outside_of_their_table(other, words):
    found = recommend(other)
    assert found.dt is None and any(words in note for note in found.notes)


def test_stiff_bonds_are_in_the_sentence(table):
    """1/(1 - (omega dt)^2/4) - 1 at omega = 200 and dt = 0.002 (the fluid adds 0.003 to omega^2); three times that step is over 10 %."""
    bonded = scene(bonds=[dpd.HarmonicBonds([[0, 1]], 1e4, 0.5)])
    assert predicted_error(bonded, "mvv", 0.002, table=table) == (pytest.approx(1 / 0.96 - 1, rel=5e-3), "bond")
    assert "4 % hot (bond temperature)" in advice(bonded, "mvv", 0.002, table=table)
    assert "more than 10 % off (bond temperature)" in advice(bonded, "mvv", 0.006, table=table)
    assert predicted_error(scene(), "mvv", 0.002, table=table)[1] == "configurational"


@cases(
    "other, words",
    (scene(gamma=4000), "friction"),
    (scene(A=100), "repulsion"),
    (scene(pairs={("W", "W"): dpd.LennardJones(epsilon=1, sigma=0.3, cutoff=1)}), "LennardJones"),
    (scene(pairs={("W", "W"): dpd.DPD(A=-3, gamma=4.5)}), "attraction"),
    (scene(kT=0.0), "temperature"),
)
def test_no_recommendation_outside_of_the_table(table, other, words):
    found = recommend(other, table=table)
    assert found.scheme is None and found.dt is None and any(words in note for note in found.notes)
    assert "no recommendation" in str(found)
    assert advice(other, "mvv", 0.01, table=table).startswith("no advice")


# -- layers and mixtures: the sum ------------------------------------------------------------------------------------------------
def one(**values) -> dict:
    return {("W", "W"): dpd.DPD(**values)}


def mixture(aa, ab, bb, types=("A", "B"), **more) -> dpd.Scene:
    """A fluid of 80 beads, its types by turns."""
    pairs = {("A", "A"): aa, ("A", "B"): ab, ("B", "B"): bb}
    x = np.random.default_rng(1).random((80, 3)) * 3
    return dpd.Scene({"A": 1.0, "B": 1.0}, list(types) * (80 // len(types)), x, pairs, kT=1.0, box=[3.0] * 3, **more)


@cases(
    "layers",
    [one(A=20), one(gamma=9)],
    [one(gamma=9), one(A=20)],
    [one(A=10, gamma=4.5)] * 2,
    [one(A=20, gamma=3), one(sigma=12**0.5)],
    [one(A=25, gamma=4.5), one(A=-5, gamma=4.5)],
)
def test_layers_are_one_entry_with_the_sum(table, layers):
    """Groups, recommendation and prediction are those of A = 20, gamma = 9, however these are spread."""
    whole = scene(pairs=one(A=20, gamma=9))
    split = scene(pairs=layers)
    (at,), notes = groups(split)
    assert (at.gamma, at.a, notes) == (pytest.approx(9), pytest.approx(20), [])
    assert recommend(split, table=table).dt == pytest.approx(recommend(whole, table=table).dt)
    assert predicted_error(split, "mvv", 0.01, table=table)[0] == pytest.approx(predicted_error(whole, "mvv", 0.01, table=table)[0])
    assert advice(split, "mvv", 0.02, table=table) == advice(whole, "mvv", 0.02, table=table)


def test_friction_of_another_cutoff_counts_by_its_drag():
    """Drag on a bead: the integral of gamma w^(2s) r^2 over the range of each layer, here in units of the repulsion's cutoff."""
    r = 2.0 * (np.arange(200000) + 0.5) / 200000
    weight = np.sum(3 * np.clip(1 - r / 2, 0, 1) ** 2 * r**2) + np.sum(1.5 * np.clip(1 - r, 0, 1) ** 1 * r**2)
    unit = np.sum(np.clip(1 - r, 0, 1) ** 2 * r**2)
    found, _ = groups(scene(n=300, pairs=[one(A=25), one(gamma=3, cutoff=2), one(gamma=1.5, exponent=0.5)]))
    assert {(at.a, at.s) for at in found} == {(25.0, 1.0), (25.0, 0.5)}
    assert [at.friction for at in found] == pytest.approx([weight / unit] * 2, rel=1e-5)


def test_repulsion_of_two_cutoffs_adds_up_in_curvature():
    """U'' = 25 + 10/1.3 at overlap, seen from either cutoff; never weaker than either layer alone."""
    found, _ = groups(scene(n=300, pairs=[one(A=25, gamma=4.5), one(A=10, cutoff=1.3)]))
    curvature = 25 + 10 / 1.3
    expected = {1.0: curvature, 1.3: curvature * 1.3**2}
    assert {at.unit_time: at.a for at in found} == pytest.approx(expected)
    assert {at.unit_time: at.rho for at in found} == pytest.approx({1.0: 3.0, 1.3: 3.0 * 1.3**3})
    # one friction, 4.5 of cutoff 1, in units of sqrt(m kT)/cutoff
    assert {at.unit_time: at.friction for at in found} == pytest.approx({1.0: 4.5, 1.3: 4.5 * 1.3})


def test_a_species_has_the_mean_of_its_surroundings(table):
    """Two thirds A and a third B, masses 1 and 4: repulsion and friction are means over neighbours; B moves by its own mass."""
    pairs = {("A", "A"): dpd.DPD(A=5, gamma=3), ("A", "B"): dpd.DPD(A=10), ("B", "B"): dpd.DPD(A=20, gamma=9)}
    x = np.random.default_rng(1).random((81, 3)) * 3
    mixed = dpd.Scene({"A": 1.0, "B": 4.0}, ["A", "A", "B"] * 27, x, pairs, kT=1.0, box=[3.0] * 3)
    found, notes = groups(mixed)
    expected = [(2.0, 20 / 3, 1.0), (3.0, 40 / 3, 4.0)]
    assert [(at.gamma, at.a, at.own) for at in found] == [pytest.approx(one) for one in expected] and notes == []
    heavy = found[1].moving
    assert (heavy.friction, heavy.unit_time) == (pytest.approx(1.5), pytest.approx(2.0))
    steps = StabilityTable(made_up(lambda scheme, p: 0.1 / (1 + p["a"])))
    assert recommend(mixed, table=steps).dt < 0.5 * recommend(scene(pairs=one(A=5, gamma=3)), table=steps).dt
    # B without any friction has the mean of all
    stiff = mixture(dpd.DPD(A=5, gamma=4), dpd.DPD(A=10), dpd.DPD(A=20))
    assert {round(at.gamma, 9) for at in groups(stiff)[0]} == {2.0, 1.0}
    assert "type B have no friction" in groups(stiff)[1][0] and groups(stiff)[1][0] in advice(stiff, "mvv", 0.01, table=table)


def test_energy_is_kept_over_the_run():
    """The drift goes with a power of the step of four or more, and ten times as long a run may have a tenth of it; a thermostat has none."""
    conserving = scene(
        pairs={("W", "W"): dpd.EnergyDPD(A=25, sigma=3, kappa=1)}, internal=dpd.InternalEnergy(dpd.ConstantHeatCapacity(10.0), 1.0)
    )
    for of, heat in ((conserving, 11.5), (scene(gamma=0.0), 1.5)):
        plain, long, longer = (recommend(of, duration=duration) for duration in (None, 1e3, 1e4))
        assert plain.dt > long.dt > longer.dt > 0.4 * long.dt and long.choices[0].limit == "energy"
        assert "total energy grows by some" in plain.notes[-1] and "and the energy over 1000 ps," in str(long)
        at = groups(of)[0][0]
        assert shipped_table("drift").error(long.scheme, at, long.dt, "drift") < 0.01 * heat / 1e3
    # 0.05 with bababo drifts by 3e-4 per bead and unit of time, of 11.5 kT
    assert 0.03 < next(c.dt for c in recommend(conserving, duration=1e3 * unit.picosecond).choices if c.scheme == "bababo") < 0.045
    assert recommend(scene(), duration=1e9) == recommend(scene())
    bonded = scene(gamma=0.0, bonds=[dpd.HarmonicBonds([[0, 1]], 10.0, 0.5)])
    assert recommend(bonded).dt and "without bonds" in recommend(bonded, duration=10.0).notes[-1]
    assert "without bonds" in recommend(bonded).notes[-1] and "% per" not in recommend(bonded).notes[-1]


def test_species_have_the_steps_of_their_fluid_up_to_their_exchange():
    """TDPD's exponent is that of the drag, twice that of the noise; kappa dt is 2.5 at most, 4.5 for 2 %, 0.8 with rates; with many
    neighbours in range the sum of their weights (1 - r/2)^2 counts, beyond 3.2 of them."""

    def steps(error=0.01, **more):
        pairs = {("W", "W"): dpd.TDPD(A=25, gamma=20, exponent=1.4, **more)}
        inside = dpd.Concentrations(np.ones((81, np.size(more["kappa"]))))
        return {c.scheme: (c.dt, c.limit) for c in recommend(scene(pairs=pairs, internal=inside), error).choices}

    plain = recommend(scene(pairs={("W", "W"): dpd.DPD(A=25, gamma=20, exponent=0.7)})).choices
    assert steps(kappa=1.0) == {c.scheme: (c.dt, c.limit) for c in plain if c.scheme != "native"}
    fast = steps(kappa=[1.0, 1000.0])
    assert set(fast.values()) == {(2.5 / 1000, "exchange"), (0.8 / 1000, "exchange")} and fast["mvv"][0] == 0.8 / 1000
    assert steps(0.02, kappa=200.0)["bab3"][0] == 4.5 / 200
    many = 8 * np.pi * 3 * 2**3 / 60 / 3.2
    assert steps(kappa=200.0, cutoff_c=2.0)["bab3"][0] == pytest.approx(2.5 / 200 / many)


def test_heat_of_edpd_needs_a_large_capacity():
    """Otherwise its repulsion heats it at any step; LAMMPS's heat has no sweeps."""
    for capacity, more, known in ((1e4, {}, True), (100.0, {}, False), (1e4, {"compat": "lammps"}, False)):
        pairs = {("W", "W"): dpd.EDPD(A=18.75, gamma=4.5, kappa=1e-3)}
        found = recommend(scene(pairs=pairs, internal=dpd.BeadTemperatures(1.0, capacity), **more), duration=100.0)
        assert (found.dt is not None) == known and (known or "EDPD" in found.notes[0] or "eDPD" in found.notes[0])


_COMMON, _OTHER, _WARM = dpd.DPD(A=5, gamma=2), dpd.DPD(A=20, gamma=8), dpd.InternalEnergy(dpd.ConstantHeatCapacity(60.0), 1.0)


@cases(
    "of, gamma, a, cv",
    (mixture(_COMMON, _OTHER, _OTHER, types=("A",)), 2, 5, None),
    (mixture(_COMMON, _COMMON, _OTHER, mobile=np.arange(80) % 2 == 0), 2, 5, None),
    (scene(pairs=[one(gamma=3), one(gamma=1.5)]), 4.5, 0, None),
    (scene(pairs=one(A=25, gamma=4.5, gamma_perp=3)), 10.5, 25, None),
    (scene(pairs={("W", "W"): dpd.EnergyDPD(A=25, sigma=3, kappa=1)}, internal=_WARM), 4.5, 25, 60.0),
    ids=["beads that are there", "beads that move", "friction alone", "transverse friction counts twice", "heat capacity"],
)
def test_fluids_that_are_one(of, gamma, a, cv):
    (at,), _ = groups(of)
    assert (at.gamma, at.a, at.cv) == (pytest.approx(gamma), a, cv if cv is None else pytest.approx(cv))


test_what_is_refused = refused(
    dpd.ParameterError,
    *((lambda error=error: recommend(scene(), error), "error") for error in (0.0, -0.01, 0.2, "much", None)),
    (lambda: recommend("fluid"), "Scene"),
    (lambda: recommend(scene(), quantity="colour"), "the quantity must be one of .*'colour'"),
    (lambda: recommend(scene(), duration=0.0), "duration"),
    (lambda: recommend(dpd.MixedSystem(*[None] * 7)), "step and scheme of the atoms"),
    (lambda: StabilityTable(made_up(power, repulsions=(25.0,))), "two repulsions"),
)


# -- what has to be right ----------------------------------------------------------------------------------------------------------
def test_structure_leaves_out_what_is_read_from_velocities():
    """aboba's velocities are too hot at whole steps, its positions are right; so with bonds, of which velocities are off at (omega dt)^2/4."""
    fluid, bonded = scene(), scene(A=6, bonds=[dpd.HarmonicBonds([[0, 1]], 1000.0, 0.5)])

    def step(of: dpd.Scene, **more) -> float:
        return next(c.dt for c in recommend(of, **more).choices if c.scheme == "aboba")

    assert step(fluid, quantity="structure") > 1.3 * step(fluid)
    assert step(bonded) == pytest.approx(AIM * 2 * (0.01 / 1.01) ** 0.5 / 4000**0.5, rel=0.03)
    assert step(bonded, quantity="structure") > 3 * step(bonded)


def test_motion_limits_the_step_too():
    """The errors of the made-up table grow with the square of the step: diffusion is 1 % off at 0.05 and 0.02 of the ends, viscosity never."""

    def made(parts: tuple[float, ...], limit: float = 0.0) -> TransportTable:
        points = [{"gamma": gamma, "D": [1.0, limit], "eta": [1.0, 0.0]} for gamma in (4.5, 450.0)]
        for point, dt in zip(points, (0.05, 0.02), strict=True):
            point["schemes"] = {"basa": [[k * dt, [0.01 * k * k, 0.002], [-0.002, 0.001]] for k in parts]}
        return TransportTable({"points": points})

    motion = made((0.5, 2.0))
    assert motion.step("basa", Groups(4.5, 25.0), 0.01, "diffusion").dt == pytest.approx(0.05, rel=0.01)
    assert motion.step("basa", Groups(45.0, 25.0), 0.01, "diffusion").dt == pytest.approx((0.05 * 0.02) ** 0.5, rel=0.01)
    assert motion.step("basa", Groups(4.5, 25.0), 0.0025, "diffusion").dt == pytest.approx(0.025, rel=0.01)
    assert motion.step("basa", Groups(4.5, 25.0), 0.01, "viscosity").dt == pytest.approx(0.1)
    # 0.25 +- 0.2 % at half the step and 4 +- 0.2 % at twice it
    assert 0.002 < motion.step("basa", Groups(4.5, 25.0), 0.01, "diffusion").error < 0.02
    # an error of the limit shifts all errors, and does not get smaller with their number
    own, common = (made((0.5, 0.8, 1.2, 2.0), limit).step("basa", Groups(4.5, 25.0), 0.01, "diffusion") for limit in (0.0, 0.002))
    assert common.dt == own.dt and common.error > 1.4 * own.error
    # a step's error is the one it was chosen for, and in a fluid with vibrations twice as fast steps are half as long
    for stiff, fluid in ((1.0, Groups(4.5, 25.0)), (2.0, Groups(4.5, 100.0))):
        assert motion.step("basa", fluid, 0.01, "diffusion").dt == pytest.approx(0.05 / stiff, rel=0.01)
        assert motion.error("basa", fluid, 0.05 / stiff, "diffusion") == (pytest.approx(0.01, rel=0.01), False)
        assert motion.error("basa", fluid, 0.11 / stiff, "diffusion") == (pytest.approx(0.04, rel=0.01), True)
    assert not motion.covers(Groups(500.0, 25.0))


def test_shipped_motion_is_slower_under_strong_friction():
    """Shardlow's updates diffuse right at steps at which exact ones do not, and no step is longer than that of the temperatures."""
    for quantity in ("diffusion", "viscosity"):
        found = {c.scheme: c for c in recommend(scene(gamma=40.5), quantity=quantity).choices}
        plain = {c.scheme: c for c in recommend(scene(gamma=40.5)).choices}
        assert all(c.dt <= plain[name].dt for name, c in found.items())
        assert quantity in str(recommend(scene(gamma=40.5), quantity=quantity))
    found = {c.scheme: c for c in recommend(scene(gamma=40.5), quantity="diffusion").choices}
    assert found["basa"].dt > 1.2 * found["middle"].dt and found["bababs"].dt > 1.2 * found["bababo"].dt
    assert "measured only at frictions" in recommend(scene(gamma=1), quantity="diffusion").notes[-1]


def test_what_else_is_wrong_is_told():
    """bab3 takes the longest steps under strong friction, and beads diffuse too fast there; a measured step has an error."""
    found = recommend(scene(gamma=40.5))
    assert found.scheme == "bab3" and any("diffusion is more than +14 %" in note and "quantity='diffusion'" in note for note in found.notes)
    assert not recommend(scene(gamma=40.5), quantity="diffusion").notes
    best = recommend(scene()).choices[0]
    assert 0 < best.dt_error < 0.3 * best.dt and "±" in str(best)


# -- the sentence ----------------------------------------------------------------------------------------------------------------
def test_the_sentence_compares_at_the_same_error(table):
    """mvv at 0.02: 1 % hot; middle keeps within that at 0.87 of 0.06, for 1.2/0.0522 : 1/0.02 = 0.46 of the time."""
    text = advice(scene(), "mvv", 0.02, table=table)
    assert text == "mvv at dt = 0.02 ps: 1 % hot (configurational temperature); middle at 0.052 ps keeps within that for half of the time"
    assert "more than 10 % off" in advice(scene(), "mvv", 0.08, table=table)
    assert "blows up near 0.16" in advice(scene(), "mvv", 0.15, table=table)


def test_predicted_error_has_a_sign():
    data = made_up(power)
    for p in data["points"]:
        p["schemes"]["mvv"]["sign"]["conf"] = -1
    size, kind = predicted_error(scene(), "mvv", 0.02, table=StabilityTable(data))
    assert (size, kind) == (pytest.approx(-0.01), "configurational")


# -- the shipped table -----------------------------------------------------------------------------------------------------------
def test_shipped_table_is_complete_and_in_order():
    """Steps of all schemes at every point of the plane; a larger error takes a longer step, and a blow-up the longest."""
    table = shipped_table()
    assert set(table.schemes) == set(SCHEMES) == set(table.cost)
    for p in table.data["points"]:
        for scheme, entry in p["schemes"].items():
            for kind in ("conf", "kin"):
                if entry[kind]["1"] is None:
                    # no repulsion, or a scheme that runs at no step (small heat capacities)
                    assert (p["a"] == 0 and kind == "conf") or entry["blow"][2] == "<"
                    continue
                steps = [entry[kind][f"{100 * level:g}"][0] for level in LEVELS]
                assert steps == sorted(steps), (p, scheme, kind)
                assert steps[-1] <= 1.3 * entry["blow"][0], (p, scheme, kind)


def test_shipped_table_knows_the_standard_fluid():
    """What every measurement of this fluid says: velocity Verlet is 1 % off near 0.02, middle takes more than twice its step."""
    table, at = shipped_table(), Groups(4.5, 25.0)
    assert 0.008 < table.step("mvv", at, 0.01, "conf") < 0.03
    assert table.step("middle", at, 0.01, "conf") > 1.4 * table.step("mvv", at, 0.01, "conf")
    assert 0.08 < table.blow("mvv", at) < 0.15


def test_frozen_beads_alone_need_no_step():
    frozen = scene(mobile=np.zeros(81, bool))
    assert groups(frozen) == ([], ["no bead moves"]) and "no bead moves" in advice(frozen, "middle", 0.01)


def test_native_is_left_out_where_it_cannot_run():
    """Transverse friction and other exponents are beyond OpenMM's integrator."""
    for more, without in (({}, set()), ({"gamma_perp": 4.5}, {"native"}), ({"exponent": 0.5}, {"native"})):
        of = scene(n=375, pairs=one(A=25, gamma=4.5, **more))
        assert {choice.scheme for choice in recommend(of).choices} == set(SCHEMES) - without
