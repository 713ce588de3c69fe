"""Pair styles of the DPD family: conservative force, friction and noise, and heat conduction between beads with internal energies."""

from collections.abc import Callable

import numpy as np

from ...base.errors import ParameterError
from ...base.units import UnitSystem
from ...model.energy_dpd import EnergyDPD
from ...model.pairs import DPD
from ..state.pair_setup import Coefficient, PairStyle, Spec, Term
from .words import Columns, Exports, Pair, PairExport, StyleUse, exact, plain_use, settings


def _dpd(name: str, words: str, columns: Columns) -> Spec:
    """A style of the DPD family."""

    def build(style: PairStyle, found: Coefficient, units: UnitSystem) -> Term:
        term, _ = columns.builder(DPD)(style, found, units)
        for temperature in (style.settings["start"], style.settings["stop"]):
            term.check_temperature(temperature * units.thermal_energy)
        return term, None

    return Spec(settings(name, words), columns.coefficient, build, thermostat=True)


_FORCE, _FRICTION, _NOISE = {"A": "force"}, {"gamma": "friction"}, {"sigma": "noise"}
_TRANSVERSE = {**_FRICTION, "gamma_perp": "friction", "exponent": "1", "exponent_perp": "1"}
_ENERGY = Columns({**_FORCE, **_NOISE, "kappa": "energy*kT/time"})

STYLES = {
    "dpd": _dpd("dpd", "T cutoff seed", Columns({**_FORCE, **_FRICTION})),
    "dpd/tstat": _dpd("dpd/tstat", "Tstart Tstop cutoff seed", Columns(_FRICTION)),
    "dpd/ext": _dpd("dpd/ext", "T cutoff seed", Columns({**_FORCE, **_TRANSVERSE})),
    "dpd/ext/tstat": _dpd("dpd/ext/tstat", "Tstart Tstop cutoff seed", Columns(_TRANSVERSE)),
    "dpd/fdt": _dpd("dpd/fdt", "T cutoff seed", Columns({**_FORCE, **_NOISE})),
    "dpd/fdt/energy": Spec(
        settings("dpd/fdt/energy", "cutoff seed"), _ENERGY.coefficient, _ENERGY.builder(EnergyDPD), thermostat=True, atom_style="dpd"
    ),
}


# -- from a scene -------------------------------------------------------------------------------------------------------------
def _friction(c: DPD, kT: float) -> float:
    return c.gamma if c.gamma is not None else c.sigma**2 / (2 * kT) if c.sigma else 0.0


def _export(export: PairExport, entries: dict[Pair, DPD]) -> list[StyleUse]:
    units, kT = export.units, export.scene.initial_kT
    longest = max(c.cutoff for c in entries.values())
    reach = exact(longest / units.length)
    gammas = {pair: _friction(c, kT) / units.friction for pair, c in entries.items()}
    A = {pair: c.A / units.force for pair, c in entries.items()}
    cutoffs = {pair: exact(c.cutoff / units.length) for pair, c in entries.items()}
    general = any(c.gamma_perp or c.exponent != 1 or (c.exponent_perp != 1 and c.gamma_perp) for c in entries.values())
    fixed = {pair: c for pair, c in entries.items() if c.sigma and c.gamma is None}

    def use(name: str, settings: str, words: Callable[[Pair], str], constant: bool = False) -> StyleUse:
        coefficients = {pair: f"{words(pair)} {cutoffs[pair]}" for pair in entries}
        return StyleUse(name, settings, coefficients, longest, constant=constant)

    def transverse(pair: Pair) -> str:
        c = entries[pair]
        return f"{exact(gammas[pair])} {exact(c.gamma_perp / units.friction)} {exact(c.exponent)} {exact(c.exponent_perp)}"

    if export.ramps:
        if fixed:
            raise ParameterError(
                f"types {next(iter(fixed))} have a fixed sigma while the temperature changes; LAMMPS's pair styles with a temperature "
                "ramp (dpd/tstat) hold gamma fixed. Give gamma instead, or a constant kT"
            )
        thermostat = use(
            "dpd/ext/tstat" if general else "dpd/tstat",
            f"{{start}} {{stop}} {reach} {{seed}}",
            transverse if general else lambda pair: exact(gammas[pair]),
        )
        if not any(A.values()):
            return [thermostat]
        # dpd has no ramp: the repulsion becomes a separate style without friction and noise
        return [use("dpd", f"{{start}} {reach} {{seed}}", lambda pair: f"{exact(A[pair])} 0.0", True), thermostat]
    # whether pair terms of bonded neighbours are scaled
    scaled = bool(len(export.scene.bond_pairs)) and any(0 < factor < 1 for factor in export.scene.bonded_factors)
    if export.shardlow or (len(fixed) == len(entries) and not general and not scaled):

        def noise(pair: Pair) -> str:
            c = entries[pair]
            sigma = c.sigma if c.sigma is not None and c.gamma is None else np.sqrt(2 * kT * _friction(c, kT))
            return f"{exact(A[pair])} {exact(sigma / units.noise)}"

        return [use("dpd/fdt", f"{{start}} {reach} {{seed}}", noise)]
    bare = not any(A.values())
    if general and bare:
        return [use("dpd/ext/tstat", f"{{start}} {{stop}} {reach} {{seed}}", transverse)]
    if general:
        return [use("dpd/ext", f"{{start}} {reach} {{seed}}", lambda pair: f"{exact(A[pair])} {transverse(pair)}")]
    if bare:
        return [use("dpd/tstat", f"{{start}} {{stop}} {reach} {{seed}}", lambda pair: exact(gammas[pair]))]
    return [use("dpd", f"{{start}} {reach} {{seed}}", lambda pair: f"{exact(A[pair])} {exact(gammas[pair])}")]


EXPORTS: Exports = {
    DPD: _export,
    EnergyDPD: lambda export, entries: [plain_use("dpd/fdt/energy", "{cutoff} {seed}", _ENERGY, export, entries)],
}
