"""Parameters: units of a model, equations of state, Flory-Huggins parameters, transport; no runs."""

import json
import math
from importlib.resources import files

import numpy as np
import pytest
from cases import raises
from openmm import unit
from scipy.integrate import quad

from openmm_dpd import ParameterError
from openmm_dpd.molecules import Spring
from openmm_dpd.parameters import (
    BeadMapping,
    chi_from_composition,
    chi_from_repulsion,
    chi_from_solubility,
    composition_from_chi,
    friction_for,
    inverse_compressibility,
    pressure,
    repulsion_from_chi,
    repulsion_from_compressibility,
    transport,
    water_mapping,
)
from openmm_dpd.parameters.state import overlap_energy


def table(name: str) -> dict:
    return json.loads(files("openmm_dpd.parameters").joinpath(f"{name}.json").read_text(encoding="utf-8"))


# -- units ------------------------------------------------------------------------------------------------------------------------
def test_water_has_the_units_of_the_manual_of_dl_poly():
    """Its page of DPD units: three waters in a bead, at a mass density of 996.95 kg/m^3."""
    compressibility, diffusion = 4.525e-10 / unit.pascal, 2.299e-9 * unit.meter**2 / unit.second
    density = 996.95 * unit.kilogram / unit.meter**3
    water = water_mapping(3, mass_density=density, compressibility=compressibility, diffusion=diffusion)
    assert water.mass == pytest.approx(54.04584)
    assert water.cutoff == pytest.approx(0.646378, rel=1e-5)
    assert water.thermal_energy == pytest.approx(2.478957, rel=1e-6)
    assert water.time == pytest.approx(3.01810, rel=1e-5)
    assert water.diffusion_time(0.1707).value_in_unit(unit.picosecond) == pytest.approx(93.1, abs=0.05)


def test_compressibility_of_water_as_groot_and_warren_have_it():
    """1/(n kT kappa_T) of water is 16; with N_m molecules in a bead it is N_m times that, and so, nearly, is A."""
    one, three = water_mapping(1), water_mapping(3)
    assert one.inverse_compressibility == pytest.approx(16.0, rel=0.01)
    assert three.inverse_compressibility == pytest.approx(3 * one.inverse_compressibility, rel=1e-12)
    assert one.repulsion().value == pytest.approx(25.0, rel=0.02)
    assert three.repulsion().value == pytest.approx(78.0, rel=0.02)


def test_quantities_and_back():
    water = water_mapping(3)
    for dimension in ("length", "mass", "time", "energy", "force", "friction", "noise", "pressure", "viscosity", "diffusion"):
        assert water.reduced(water.quantity(2.5, dimension), dimension) == pytest.approx(2.5, rel=1e-12), dimension
    assert water.quantity(1.0, "energy") / unit.kilojoule_per_mole == pytest.approx(water.thermal_energy, rel=1e-12)
    assert water.reduced(1.0 * unit.bar, "pressure") == pytest.approx(0.0060221408 * 10 * water.cutoff**3 / water.thermal_energy, rel=1e-6)
    # m/(rc tau) = 54.05 Da/(0.6464 nm 3.018 ps) = 4.600e-5 Pa s
    assert water.reduced(4.600e-5 * unit.pascal * unit.second, "viscosity") == pytest.approx(1.0, rel=1e-3)
    assert np.allclose(water.quantity([1.0, 2.0], "time").value_in_unit(unit.picosecond), [water.time, 2 * water.time])


def test_a_coefficient_in_openmm_units_is_the_reduced_one():
    """Force, friction and noise between two beads, in units of the mapping."""
    water = water_mapping(3)
    pair = water.coefficient(78.0, 4.5, gamma_perp=1.5, exponent=0.5)
    assert pair.A == pytest.approx(78.0 * water.thermal_energy / water.cutoff)
    assert pair.gamma == pytest.approx(4.5 * math.sqrt(water.mass * water.thermal_energy) / water.cutoff)
    assert pair.gamma_perp == pytest.approx(pair.gamma / 3)
    assert (pair.exponent, pair.exponent_perp, pair.cutoff) == (0.5, 0.5, water.cutoff)


def test_other_liquids_and_temperatures():
    room = water_mapping(3)
    assert BeadMapping(3, room.molecule_mass, room.mass_density, room.temperature, room.compressibility, room.diffusion) == room
    with pytest.raises(ParameterError, match="known at 298.15 K only; at 320 K, give mass_density, compressibility, diffusion"):
        water_mapping(3, temperature=320)
    raises(ParameterError, "molecules must be a whole number", lambda: water_mapping(2.5))
    raises(ParameterError, "mass_density has the unit", lambda: water_mapping(3, mass_density=1.0 * unit.meter))
    bare = BeadMapping(3, room.molecule_mass, room.mass_density, room.temperature, room.compressibility)
    raises(ParameterError, "no diffusion coefficient", lambda: bare.diffusion_time(0.15))
    raises(ParameterError, "dimension must be one of", lambda: room.quantity(1.0, "charge"))


# -- equations of state -----------------------------------------------------------------------------------------------------------
def test_pressures_of_others():
    """Allen and Tildesley's runs (Shardlow) and a Monte Carlo run of pyHNC, errors in units of the last digit."""
    for density, A, expected, error in ((2, 37.5, 14.316, 0.01), (3, 25, 23.635, 0.002), (4, 18.75, 32.622, 0.01), (5, 15, 41.533, 0.007)):
        found = pressure(A, density)
        assert abs(found.value - expected) < 4 * math.hypot(found.error, error), (density, A)
    assert pressure(25, 3).value == pytest.approx(23.65, abs=4 * 0.02)


def test_liyana_arachchi():
    """The second virial coefficient of its polynomial is the exact one as far as its bounds go, and not beyond."""

    def exact(A: float) -> float:
        return 2 * math.pi * quad(lambda r: (1 - math.exp(-0.5 * A * (1 - r) ** 2)) * r * r, 0, 1)[0] / A

    for A in (5.0, 15.0, 25.0, 40.0):
        # alpha at density 0 is B2/A
        assert pressure(A, 1e-6, equation="liyana-arachchi", extrapolate=True).value - 1e-6 == pytest.approx(exact(A) * A * 1e-12, rel=0.01)
    raises(ParameterError, r"A = 60 is outside of 5 to 40, the range of Liyana-Arachchi", pressure, 60, 3, equation="liyana-arachchi")
    for density, A, *_ in table("pressures")["rows"]:
        if A <= 40:
            assert pressure(A, density, equation="liyana-arachchi").value == pytest.approx(pressure(A, density).value, rel=0.02)


def test_the_table_is_hit_and_slopes_are_slopes():
    for density, A, p, error, *_ in table("pressures")["rows"]:
        assert pressure(A, density).value == pytest.approx(p, rel=1e-9)
        assert error < 2e-3 * p
    for equation in ("measured", "groot-warren", "liyana-arachchi"):
        for A, density in ((25.0, 3.0), (12.0, 4.4), (38.0, 2.3)):
            h = 1e-4
            above, below = (pressure(A, density + side * h, equation=equation).value for side in (1, -1))
            assert inverse_compressibility(A, density, equation=equation).value == pytest.approx((above - below) / (2 * h), rel=1e-6)
            wanted = inverse_compressibility(A, density, equation=equation).value
            assert repulsion_from_compressibility(wanted, density, equation=equation).value == pytest.approx(A, rel=1e-9)


def test_bounds():
    raises(ParameterError, r"density = 1.5 is outside of 2 to 8.*extrapolate=True", lambda: pressure(25, 1.5))
    beyond = pressure(25, 1.9, extrapolate=True)
    assert beyond.extrapolated and beyond.error is None and not pressure(25, 3).extrapolated
    raises(ParameterError, "needs an A outside of 5 to 110", lambda: repulsion_from_compressibility(500.0, 3.0))
    for equation in ("ideal", ["measured"], 3, {}):
        raises(ParameterError, "must be one of measured", pressure, 25, 3, equation=equation)
    for relation in ("ideal", np.array(["a", "b"])):
        raises(ParameterError, "must be one of measured", chi_from_repulsion, 10.0, relation=relation)
    raises(ParameterError, "A must be > 0", lambda: pressure(0, 3))


# -- Flory-Huggins ----------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("chi", [2.001, 2.1, 3.0, 6.0, 40.0])
def test_composition_is_where_both_phases_have_the_same_potential(chi):
    phi = composition_from_chi(chi)
    assert 0 < phi < 0.5
    assert math.log(phi / (1 - phi)) + chi * (1 - 2 * phi) == pytest.approx(0.0, abs=1e-9 * chi)
    assert chi_from_composition(phi) == pytest.approx(chi, rel=1e-9)


def test_chi_from_solubility_parameters():
    root = unit.megapascal**0.5
    molar = chi_from_solubility(90 * unit.centimeter**3 / unit.mole, 20 * root, 17 * root, 300)
    bead = chi_from_solubility(90e21 / 6.02214076e23, 20 * root, 17 * root, 300 * unit.kelvin)
    assert molar == pytest.approx(90e-6 * 9e6 / (8.31446 * 300), rel=1e-5) == pytest.approx(bead)
    raises(ParameterError, "the pressure has the unit", lambda: chi_from_solubility(0.1, 20 * unit.bar, 17.0, 300))
    raises(ParameterError, "delta1 must be >= 0", lambda: chi_from_solubility(0.1, -20 * root, 17 * root, 300))
    raises(ParameterError, "delta2 must be a single number", lambda: chi_from_solubility(0.1, 20 * root, [17, 18] * root, 300))
    for delta in (1e300, 1e300 * root):
        raises(ParameterError, "inf", chi_from_solubility, 0.1, delta, 16.0, 300)
    raises(ParameterError, "chi above 2", lambda: composition_from_chi(1.9))
    raises(ParameterError, "between 0 and 1/2", lambda: chi_from_composition(0.5))


def test_chi_of_groot_and_warren():
    """At density 4: what docs/measure/demixing.py finds, one by the free energy of mixing, three by demixed slabs; and back."""
    assert repulsion_from_chi(2.86, 3, relation="groot-warren").value == pytest.approx(10.0)
    assert chi_from_repulsion(10.0, 5, relation="groot-warren").value == pytest.approx(6.89)
    raises(ParameterError, "densities 3 and 5", lambda: repulsion_from_chi(2.0, 4, relation="groot-warren"))
    raises(ParameterError, "leave beads and bond out", lambda: repulsion_from_chi(2.0, 3, relation="groot-warren", bond=Spring(4.0, 0.0)))
    for density, chi in ((3.0, 3.0), (3.0, 4.5), (5.0, 3.0), (5.0, 4.5)):
        theirs = repulsion_from_chi(chi, density, relation="groot-warren").value
        assert repulsion_from_chi(chi, density).value == pytest.approx(theirs, rel=0.1)
    for dA, chi, error in ((2.0, 1.07265, 0.001), (6.75, 3.350, 0.024), (8.25, 4.100, 0.079), (10.5, 5.235, 0.099)):
        found = chi_from_repulsion(dA, 4.0)
        assert abs(found.value - chi) < 2 * math.hypot(found.error, error), dA
    for density, A in ((3.0, None), (4.4, None), (3.3, 60.0)):
        for chi in (0.5, 2.2, 4.0):
            assert chi_from_repulsion(repulsion_from_chi(chi, density, A=A), density, A=A).value == pytest.approx(chi, rel=1e-9)
        dA = 1e-6
        like = 75 / density if A is None else A
        assert chi_from_repulsion(dA, density, A=A).value / dA == pytest.approx(overlap_energy(like, density), rel=1e-4)
    raises(ParameterError, "chi = 9 is outside", lambda: repulsion_from_chi(9.0, 3.0))


# -- transport --------------------------------------------------------------------------------------------------------------------
def test_transport_hits_its_table_and_friction_inverts_it():
    for row in table("transport")["rows"]:
        total = row["drag"] * (2 * row["exponent"] + 1) * (2 * row["exponent"] + 2) * (2 * row["exponent"] + 3) / 60
        gamma, gamma_perp = total * (1 - row["transverse"]), total * row["transverse"] / 2
        found = transport(gamma, gamma_perp=gamma_perp, exponent=row["exponent"], A=row["A"])
        assert found.diffusion.value == pytest.approx(row["D"], rel=1e-9)
        assert found.viscosity.value == pytest.approx(row["eta"], rel=1e-9)
        assert found.schmidt.value == pytest.approx(row["eta"] / 3 / row["D"], rel=1e-9)
        back = friction_for(schmidt=found.schmidt, exponent=row["exponent"], transverse=row["transverse"], A=row["A"])
        assert (back.gamma, back.gamma_perp) == pytest.approx((gamma, gamma_perp), rel=1e-6)


def test_transport_of_others():
    """The fluid of Groot and Warren at gamma = 6.75: D 0.306, eta 0.92, at a step that heats by some per cent."""
    found = transport(6.75)
    assert found.diffusion.value == pytest.approx(0.306, rel=0.06)
    assert found.viscosity.value == pytest.approx(0.92, rel=0.06)
    raises(ParameterError, r"drag = 500 is outside of 2 to 120", lambda: transport(500.0))
    assert transport(130.0, extrapolate=True).viscosity.extrapolated
    raises(ParameterError, "A = 50 and exponent = 0.5 were not varied together", lambda: transport(4.5, A=50, exponent=0.5))
    raises(ParameterError, "schmidt = 1e[+]06 is outside of", lambda: friction_for(schmidt=1e6))
    raises(ParameterError, "one of schmidt, viscosity and diffusion, not 2", lambda: friction_for(schmidt=3, viscosity=1))
    raises(ParameterError, "both 0", lambda: transport(0.0))


def test_errors_offer_what_can_be_done():
    with pytest.raises(ParameterError) as found:
        repulsion_from_chi(3.0, 7.0)
    assert "density = 7 is outside of 3 to 5" in str(found.value) and "extrapolate" not in str(found.value)
    with pytest.raises(ParameterError) as found:
        friction_for(schmidt=2.0, exponent=3.0)
    assert "exponent = 3 is outside of 0.25 to 1" in str(found.value) and "extrapolate" not in str(found.value)
    expected = 1 + 2 * (pressure(25, 1.0, extrapolate=True).value - 1)
    assert inverse_compressibility(25, 1.0, extrapolate=True).value == pytest.approx(expected)
