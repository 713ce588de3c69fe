r"""Constant pressure: with a thermostat by OpenMM's Monte Carlo barostats, with conserved energy by volume moves that trade with the beads.

**Isoenthalpic moves.**  Energy-conserving DPD at constant pressure samples

.. math:: \rho(x, p, u, V) \propto e^{\sum_i S_i(u_i)/k_B}\, \delta\Big(U(x) + K(p) + \sum_i u_i + P V - H\Big).

A move proposes ln V' = ln V + D (2 zeta - 1) with zeta uniform in (0, 1), scales all positions with the box, keeps all momenta, and lets
the beads pay for it in equal shares, u_i' = u_i + d with d = -(U' - U + P (V' - V))/N, so that H stays what it is, to rounding, accepted or
not.  The map (x, u, V) -> (x', u', V') is its own kind backwards, and its Jacobian is (V'/V)^N for the positions, 1 for the u (a shift by
something that does not depend on them), and V'/V because ln V is proposed uniformly.  So detailed balance needs

.. math:: A = \min\Big(1, (V'/V)^{N+1}\, e^{\sum_i [S_i(u_i') - S_i(u_i)]/k_B}\Big),

and a move to an energy out of range is rejected.  For large heat capacities the entropy change is -(dU + P dV)/Theta, which is the
Metropolis test of the isothermal ensemble at the beads' own (harmonic mean) temperature.
"""

from collections.abc import Callable

import numpy as np
import openmm
from openmm import unit

from ..base.errors import ParameterError, PlanError, require, require_one, what_is
from ..base.names import CONVERTED, FIELD, SEED, VOLUME_ACCEPTED, VOLUME_MOVES, VOLUME_STEP
from ..base.units import BAR_PER_MD_PRESSURE, BOLTZMANN, md_pressure, md_tension, whole_number
from ..io.snapshot import Cadence
from ..kernels.eos import entropy_change, in_range
from ..kernels.fields import ENERGY
from ..kernels.noise import call_key, uniform
from ..plan.made import BAROSTATS
from ..plan.plan import Plan
from ..runtime import compiled
from .built import BuiltSystem
from .fields import per_dof, raw_fields

#: Layer number under which volume moves draw their noise: far from those of pair terms.
_NOISE_LAYER = 1 << 20
#: Moves between two adjustments of the length of the moves.
_ADJUST = 20
#: Whether x, y and z may change.
Axes = tuple[bool, bool, bool]


def _check(built: BuiltSystem, interval: int, axes: Axes, why_not: Callable[[Plan, str], str | None]) -> None:
    wanted = "a barostat wants as built what openmm_dpd.build(), add_thermostat() or create_mixed_system() returned"
    require(built, BuiltSystem, wanted)
    whole_number(interval, "the interval between volume moves, in steps,", least=1)
    if np.shape(axes) != (3,) or np.asarray(axes).dtype != bool or not any(axes):
        raise ParameterError(f"axes must be three of True or False, at least one True, not {what_is(axes)}")
    changed = "".join(axis for axis, changes in zip("xyz", axes, strict=True) if changes)
    reason = why_not(built.plan, changed)
    if reason is not None:
        raise PlanError(reason)


def add_barostat(
    built: BuiltSystem,
    pressure=None,
    *,
    interval: int = 25,
    axes: Axes = (True, True, True),
    coupled: bool = True,
    surface_tension=None,
    xymode: str = "isotropic",
    zmode: str = "free",
) -> openmm.Force:
    r"""Add one of OpenMM's Monte Carlo barostats to an isothermal scene, before its Context is made.

    With a surface tension it is the one for membranes and other flat interfaces across z: a trial move of the box is judged by

    .. math:: \Delta U + P\,\Delta V - \gamma\,\Delta A - N k_B T \ln(V'/V),

    with A the area of the box in the plane of x and y and N the number of molecules, which move as wholes.  So the tension counts *all*
    interfaces together: a bilayer is one (``surface_tension(..., interfaces=1)`` of :mod:`openmm_dpd.analysis` measures what is set
    here), and a slab with two faces wants twice the tension of either.  0 makes a bilayer tensionless.

    OpenMM's conventions for temperature (kelvin), pressure (bar) and tension (bar*nm) are taken care of.  The steps to their
    next move and the length of their moves are not part of checkpoints, so a restart continues a correct run, but not the same one.  They
    draw from a generator that all Contexts of a process share and that a new Context seeds: with the seed of the plan a run repeats, if
    no other Context runs beside it.

    Parameters
    ----------
    built : BuiltSystem
        An isothermal scene (no internal energies) in a box, all of whose beads move.
    pressure : pressure
        Bare numbers: kJ/mol/nm^3 (the reduced pressure of a reduced scene).  With a surface tension it is the pressure along z.  Needed
        always, but for a constant volume, where it must be left out.
    interval : int, default 25
        Steps between two attempts.
    axes : three bool
        Axes that may change.
    coupled : bool, default True
        True: all axes change by one factor (MonteCarloBarostat); False: each by itself (MonteCarloAnisotropicBarostat).
    surface_tension : energy/area, optional
        gamma; bare numbers: kJ/mol/nm^2; Quantities as in bar*nm, mN/m.  Takes MonteCarloMembraneBarostat, which needs an orthorhombic
        box and has modes in the place of ``axes`` and ``coupled``.
    xymode : {"isotropic", "anisotropic"}
        Whether x and y change by one factor or each by itself.
    zmode : {"free", "fixed", "constant volume"}
        Whether z changes by itself, stays, or follows the area so that the volume stays.

    Returns
    -------
    openmm.Force
        The barostat, already in ``built.system``.

    Raises
    ------
    ParameterError, PlanError
        If the scene has internal energies (use :class:`EnthalpyBarostat`), a temperature ramp or one of 0, no box, immobile beads, a
        barostat or a Context already, a value is wrong, or an argument would have no effect.

    References
    ----------
    Y. Zhang, S. E. Feller, B. R. Brooks and R. W. Pastor, J. Chem. Phys. 103, 10252 (1995).
    """
    _check(built, interval, axes if surface_tension is None else (True, True, zmode != "fixed"), Plan.no_barostat)
    plan = built.plan
    present = next((force for force in built.system.getForces() if isinstance(force, BAROSTATS)), None)
    if present is not None:
        raise PlanError(f"the System has a {type(present).__name__} already; two barostats would make the volume follow neither")
    if built.integrator.context() is not None:
        raise PlanError("there is a Context of this scene already, which would not know the barostat; add it before the Simulation is made")
    if plan.options.kT == 0:
        raise PlanError("OpenMM's barostats sample volumes at a temperature, and that of the scene is 0")
    kelvin = plan.options.kT / BOLTZMANN
    if surface_tension is not None:
        if not all(axes) or coupled is not True:
            raise ParameterError("axes and coupled do not go with a surface_tension; say xymode and zmode instead")
        assert plan.scene.box is not None  # _check
        barostat = _membrane_barostat(plan.scene.box, pressure, surface_tension, xymode, zmode, kelvin, interval)
    else:
        if (xymode, zmode) != ("isotropic", "free"):
            raise ParameterError("xymode and zmode go with a surface_tension alone; without one say axes and coupled (0 is a tension)")
        barostat = _pressure_barostat(pressure, axes, coupled, kelvin, interval)
    barostat.setName(CONVERTED)
    barostat.setRandomNumberSeed(plan.options.openmm_seed)
    built.system.addForce(barostat)
    return barostat


def _pressure_barostat(pressure, axes: Axes, coupled: bool, kelvin: float, interval: int) -> openmm.Force:
    if pressure is None:
        raise ParameterError("a barostat needs a pressure")
    bar = md_pressure(pressure) * BAR_PER_MD_PRESSURE
    if coupled and all(axes):
        return openmm.MonteCarloBarostat(bar, kelvin, interval)
    if coupled:
        raise PlanError("axes that change by one factor while another stays are not supported; use coupled=False")
    return openmm.MonteCarloAnisotropicBarostat(openmm.Vec3(bar, bar, bar), kelvin, *map(bool, axes), interval)


_Membrane, _CONSTANT_VOLUME = openmm.MonteCarloMembraneBarostat, "constant volume"
_XY_MODES = {"isotropic": _Membrane.XYIsotropic, "anisotropic": _Membrane.XYAnisotropic}
_Z_MODES = {"free": _Membrane.ZFree, "fixed": _Membrane.ZFixed, _CONSTANT_VOLUME: _Membrane.ConstantVolume}


def _membrane_barostat(box: np.ndarray, pressure, tension, xymode: str, zmode: str, kelvin: float, interval: int) -> openmm.Force:
    for name, mode, known in (("xymode", xymode, _XY_MODES), ("zmode", zmode, _Z_MODES)):
        require_one(mode, known, name)
    if np.any(box != np.diag(np.diag(box))):
        raise PlanError("a surface tension across z needs an orthorhombic box")
    if zmode == _CONSTANT_VOLUME:
        if pressure is not None:
            raise ParameterError(f"a pressure has no effect at constant volume; leave it out, or take another zmode than {zmode!r}")
        pressure = 0.0
    elif pressure is None:
        raise ParameterError(f"zmode={zmode!r} changes the volume and needs a pressure")
    bar, bar_nm = md_pressure(pressure) * BAR_PER_MD_PRESSURE, md_tension(tension) * BAR_PER_MD_PRESSURE
    return _Membrane(bar, bar_nm, kelvin, _XY_MODES[xymode], _Z_MODES[zmode], interval)


class EnthalpyBarostat(Cadence):
    """Constant pressure and enthalpy for energy-conserving DPD: append it to ``simulation.reporters``, after all others.

    (OpenMM hands all reporters of a step one State taken before, so frames written after a move would mix two volumes.)

    Every ``interval`` steps it tries to change the volume (see the module's text for the move and why it is right); the beads' internal
    energies pay, so that U + K + sum u + P V is conserved to rounding.  The number of moves, which is the key of their noise, and the
    length of the moves are Context parameters, so checkpoints and saved states continue exactly.

    Parameters
    ----------
    built : BuiltSystem
        A scene with internal energies (EnergyDPD) in a box, all of whose beads move.
    pressure : pressure
        Bare numbers: kJ/mol/nm^3.
    interval : int, default 25
    axes : three bool
        Axes that may change.
    coupled : bool, default True
        True: all of ``axes`` change by one factor; False: each move changes one of them.
    adjust : bool, default True
        Adjust the length of the moves so that a quarter to three quarters of them are accepted.

    Raises
    ------
    ParameterError, PlanError
        If the scene has no internal energies, no box or immobile beads, or a value is wrong.
    """

    def __init__(self, built: BuiltSystem, pressure, *, interval: int = 25, axes: Axes = (True, True, True), coupled=True, adjust=True):
        _check(built, interval, axes, Plan.no_volume_moves)
        fields = built.plan.spec.fields
        if fields is None or fields.kind != ENERGY:
            raise PlanError(
                "an isoenthalpic barostat needs beads with internal energies (EnergyDPD); use add_barostat for isothermal scenes"
            )
        assert fields.eos is not None
        super().__init__(interval, "volume moves")
        self.built, self.pressure, self.adjust = built, md_pressure(pressure), adjust
        self.axes, self.coupled = np.flatnonzero(axes), coupled
        self._fields, self._eos = fields, fields.eos
        self._groups = built.integrator.getIntegrationForceGroups()

    def report(self, simulation, state):
        """Try a move."""
        self.move(simulation.context)

    def move(self, context: openmm.Context) -> bool:
        """Try one change of the volume; returns whether it was accepted."""
        number = context.getParameter(VOLUME_MOVES)
        key = call_key(int(context.getParameter(SEED)), int(number), _NOISE_LAYER)
        context.setParameter(VOLUME_MOVES, number + 1)
        lags_half_kick = self.built.plan.options.scheme.lag != 0.0
        state = context.getState(positions=True, energy=True, velocities=lags_half_kick, forces=lags_half_kick, groups=self._groups)
        valid = context.getIntegrator().getGlobalVariableByName("valid_for")
        box = state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer)
        x = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        factor = np.exp(context.getParameter(VOLUME_STEP) * (2 * uniform(key, 1) - 1))
        scale = np.ones(3)
        if self.coupled:
            scale[self.axes] = factor ** (1 / len(self.axes))
        else:
            scale[self.axes[int(uniform(key, 2) * len(self.axes))]] = factor
        new_box = box * scale
        accepted = self._fits(new_box) and self._try(context, key, state, x * scale, new_box, factor, float(np.prod(np.diag(box))))
        if not accepted:
            context.setPeriodicBoxVectors(*box)
            context.setPositions(x)
            context.getIntegrator().setGlobalVariableByName("valid_for", valid)  # what is kept is that at these positions
        context.setParameter(VOLUME_ACCEPTED, context.getParameter(VOLUME_ACCEPTED) + accepted)
        if self.adjust and (number + 1) % _ADJUST == 0:
            self._adjust(context)
        return accepted

    def _fits(self, box: np.ndarray) -> bool:
        return 0.5 * np.diag(box).min() >= max(float(table.cutoff.max()) for table in self.built.plan.spec.terms)

    def _try(self, context, key, state, x: np.ndarray, box: np.ndarray, factor: float, volume: float) -> bool:
        """Go to the new volume; pay for it if the move is accepted."""
        context.setPeriodicBoxVectors(*box)
        context.setPositions(x)
        scheme = self.built.plan.options.scheme
        lags_half_kick = scheme.lag != 0.0
        new = context.getState(energy=True, forces=lags_half_kick, groups=self._groups)
        energies = [s.getPotentialEnergy().value_in_unit(unit.kilojoule_per_mole) for s in (state, new)]
        share = -(energies[1] - energies[0] + self.pressure * volume * (factor - 1)) / len(x)
        gained = _entropy_gain(raw_fields(context, self._fields).sum(axis=1), share, self._eos.capacity, self._eos.curve, *self._eos.curves)
        if not np.log(uniform(key, 3)) < gained + (len(x) + 1) * np.log(factor):
            return False
        integrator = context.getIntegrator()
        values = per_dof(integrator, f"{FIELD}0")
        values[:, 1] += share
        integrator.setPerDofVariableByName(f"{FIELD}0", values)
        if lags_half_kick:
            # what stays in a move are velocities of the same moment as the positions
            dt = integrator.getStepSize().value_in_unit(unit.picosecond)
            before, after = (s.getForces(asNumpy=True).value_in_unit(unit.kilojoule_per_mole / unit.nanometer) for s in (state, new))
            v = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
            context.setVelocities(scheme.on_step(v, before - after, self.built.plan.spec.inv_mass, dt))
        return True

    def _adjust(self, context: openmm.Context) -> None:
        rate, step = context.getParameter(VOLUME_ACCEPTED) / _ADJUST, context.getParameter(VOLUME_STEP)
        step = step / 1.2 if rate < 0.25 else min(step * 1.2, 0.3) if rate > 0.75 else step
        context.setParameter(VOLUME_STEP, step)
        context.setParameter(VOLUME_ACCEPTED, 0.0)


@compiled
def _entropy_gain(u, share, capacity, curve, start, nodes, pieces):
    """Change of the entropy if every bead gets ``share``; -infinity if one leaves its range."""
    total = 0.0
    for i in range(len(u)):
        if not in_range(u[i] + share, capacity[i], curve[i], start, nodes):
            return -np.inf
        total += entropy_change(u[i], u[i] + share, capacity[i], curve[i], start, nodes, pieces)
    return total
