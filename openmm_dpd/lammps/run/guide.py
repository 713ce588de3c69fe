"""Thermostats and other fixes that act within steps, as the loop of whole steps calls them."""

import numpy as np

from ...base.errors import RunError
from ...kernels import chain
from ...kernels.layer import STRESS
from ...kernels.moment import Guide, Moment
from ...kernels.shear import RATE
from ...measure.stress_parts import Part, charge_evaluator, stress_parts
from ...plan.pair_spec import longest, renew
from ...simulation.built import BuiltSystem
from ..language.lexer import errors_at
from ..scene.axes import axes_of
from ..scene.exclusion import scene_pairs
from ..scene.flow import guided
from ..state.records import COUPLED, GUIDED, NO_SLIDE, Compute, DeckSample, Fix, Slide
from ..styles.pair_styles import pair_tables
from ..values.resolver import Resolver
from .acting import FORCES, acted_on, target
from .adapting import adapt, end
from .piston import VIRIALS, Piston
from .prescribed import moved
from .request import RunRequest


class _Scaling:
    """Velocities v of the beads of a thermostat, with the compute of its group or that of fix_modify; it scales them."""

    def __init__(self, fix: Fix, moment: Resolver, v: np.ndarray, masses: np.ndarray):
        state, name = moment.state, fix.parameters.get("temp")
        compute = state.temperature_compute(name) if name else Compute("", fix.group, "temp", settings=state.temperature())
        self.freedom, members, self._v = moment.freedom(compute), state.group(compute.group), v
        self._rows, self._part = slice(None) if members.all() else members, None
        if moment.slide.speed or compute.settings != state.temperature(extra=compute.settings.extra):
            # what is scaled is a part of the velocities, or those of the beads in the box
            self._part = axes_of(state).of_scene(moment.thermal(compute)[1] * moment.units.velocity)
        used = v[self._rows] if self._part is None else self._part
        self.twice = float(np.einsum("i,ij,ij", masses[self._rows], used, used))  #: Twice the kinetic energy

    def by(self, factor: float) -> None:
        """Scale the thermal part of the velocities."""
        self._v[self._rows] += (factor - 1.0) * (self._v[self._rows] if self._part is None else self._part)


class DeckGuide(Guide):
    """The fixes of a deck that act within steps (:class:`openmm_dpd.kernels.moment.Guide`)."""

    def __init__(self, request: RunRequest):
        self.request, self.state, state = request, request.state, request.state
        self._axes = axes_of(state)
        kept = [fix for fix in state.fixes.values() if "numbers" in fix.parameters and (fix.style != "nph" or fix in state.pistons)]
        ends = np.cumsum([0, *(len(fix.parameters["numbers"]) for fix in kept)]).tolist()
        self._places = {fix.name: slice(*ends[k : k + 2]) for k, fix in enumerate(kept)}
        self._masses, self._pushes = state.bead_masses(), bool(state.fixes_of(*FORCES))
        self.what = "fixes " + ", ".join(dict.fromkeys(fix.style for fix in (*state.fixes_of(*GUIDED), *state.pistons)))
        self.built: BuiltSystem | None = None  #: What runs it
        self._piston: Piston | None = None  #: What moves the box
        self.changed: np.ndarray | None = None  #: What was added to the velocities at the end of the last step
        moment, v = request.first_moment(), state.atoms.velocities * state.units.velocity
        for fix in state.fixes_of(*FORCES):  # what is wrong is reported for its line
            with errors_at(fix.where, f"fix {fix.name}: "):
                FORCES[fix.style](fix, moment, state.group(fix.group), np.zeros_like(v))
        for fix in kept:
            numbers = np.array(fix.parameters["numbers"])
            if "loop" in fix.parameters:
                chained, kT = numbers[: fix.parameters["chain"]].reshape(3, -1), target(fix, moment)
                masses = self._chain(fix, chained, moment, _Scaling(fix, moment, v, self._masses).freedom)
                chained[2, 1:] = chain.pushes(masses, chained[1], kT)
            elif fix.style in ("nve/limit", "langevin"):
                numbers[:] = 0.0  # each run counts anew
            if fix in state.pistons:
                if "kT" not in fix.parameters:  # LAMMPS's choice: the temperature at the start
                    beads = _Scaling(fix, moment, v, self._masses)
                    if not beads.twice > 0:
                        raise fix.error("with pair style mdpd, it takes its masses from the temperature at the start, which is 0")
                    fix.parameters["kT"] = (beads.twice / beads.freedom,) * 2
                fix.parameters.setdefault("edges", (state.require_box("fix npt").edges * state.units.length).tolist())
                self._piston = Piston(fix, self._masses, request.dt, target(fix, moment))
                self._piston.start(numbers[fix.parameters["chain"] :])
            fix.parameters["numbers"] = numbers.tolist()
        self.resizes, self.more = self._piston is not None, 0 if self._piston is None else STRESS
        self.numbers = tuple(number for fix in kept for number in fix.parameters["numbers"])
        self._parts, self._reach = list[Part](), 0.0
        self._moves = state.fixes_of("move")
        #: Positions and velocities that they prescribe, and which components have either
        self._prescribed, self._held = np.full((2, *v.shape), np.nan), np.zeros(v.shape, dtype=bool)
        for fix in self._moves:
            with errors_at(fix.where, f"fix {fix.name}: "):
                moved(fix, moment)
            self._held[state.group(fix.group)] = fix.parameters["held"]
        self._moved = np.logical_or.reduce([state.group(fix.group) for fix in self._moves])
        limits = state.fixes_of("nve/limit")
        self.limits, self._most = bool(limits), np.full((len(v), 1), np.inf)
        self._cut: np.ndarray | float = 0.0  #: What the limit has taken off velocities after the last kick
        for fix in limits:
            self._most[state.group(fix.group)] = fix.parameters["most"] / request.dt

    @classmethod
    def of(cls, request: RunRequest) -> "DeckGuide | None":
        """The guide of a run, if it needs one."""
        return cls(request) if guided(request.state) else None

    def _chain(self, fix: Fix, numbers: np.ndarray, moment: Resolver, freedom: float) -> np.ndarray:
        return chain.masses(numbers.shape[1], target(fix, moment), fix.parameters["damp"], freedom)

    def _moment(self, m: Moment, step: int, v: np.ndarray) -> Resolver:
        axes, slide = self._axes, NO_SLIDE if m.flow is None else Slide(0.0, m.flow[RATE] * m.box[1, 1], self._axes.plane)  # type: ignore[index]
        places = {"positions": axes.of_deck(m.x), "velocities": axes.of_deck(v), "box": axes.box_of_deck(m.box), "slide": slide}
        return Resolver(self.state, DeckSample(self.request.first_step + step, **places), self.request.window)

    def renew(self) -> None:
        """Give the engine of :attr:`built` the present coefficients, and forget what was made of others."""
        self._parts = []
        if self.built is not None and self.built.integrator.whole is not None:
            function, plan = self.built.integrator.whole.function, self.built.plan
            renew(plan.scene, (*plan.layers, *plan.overlays), function.spec, scene_pairs(self.state, pair_tables(self.state)).tables)
            function.thread_state().engine.renew()

    def begin(self, m: Moment) -> None:
        """Half a step of the Nose-Hoover chains; velocities that fix move prescribes, from positions before beads drift."""
        if (piston := self._piston) is not None:
            piston.chain(self._of_piston(m), target(piston.fix, self._moment(m, m.number, m.v)), m.dt)
        self._chains(m, m.number + 1)
        if piston is not None:
            piston.push(self._of_piston(m), m, self._moment(m, m.number + 1, m.v))
            piston.slow(self._of_piston(m), m)
            self._scale(piston, m)
        for fix in self._moves:
            moment, members = self._moment(m, m.number + 1, m.v), self.state.group(fix.group)
            x, v = moved(fix, moment)
            self._prescribed[:, members] = x * moment.units.length, v * moment.units.velocity
        self._place(m.v, 1)

    def _of_piston(self, m: Moment) -> np.ndarray:
        assert self._piston is not None
        return m.numbers[self._places[self._piston.fix.name]][self._piston.fix.parameters["chain"] :]

    def _scale(self, piston: Piston, m: Moment) -> None:
        piston.scale(self._of_piston(m), m, self.state.units.length, self._reach)

    def _take_virials(self, m: Moment) -> None:
        """Keep the virials of the forces that have just been summed."""
        assert self.built is not None and self.built.integrator.whole is not None
        plan, loop = self.built.plan, self.built.integrator.whole.function.thread_state().loop
        if not self._parts:
            charges = charge_evaluator(plan)
            self._parts = [*stress_parts(plan), *([] if charges is None else [lambda x, box: charges.parts(x, box)[2]])]
            self._reach = longest((*plan.layers, *plan.overlays))
        stress = loop.valid.totals.stress + sum((part(m.x, m.box) for part in self._parts), np.zeros(6))
        self._of_piston(m)[VIRIALS] = stress[:3]

    def forces(self, m: Moment, v: np.ndarray, force: np.ndarray, step: int) -> np.ndarray:
        """All forces, as the fixes have changed them."""
        if self._piston is not None:
            self._take_virials(m)
        if not self._pushes:
            return np.where(self._held, 0.0, force) if self._moves else force
        unit, moment = self.state.units.force, self._moment(m, step, v)
        found, _ = acted_on(moment, self._axes.of_deck(force / unit))
        for fix in self.state.fixes_of("langevin") if step == 0 else ():
            energy = m.numbers[self._places[fix.name]]
            energy[1] = self._given(fix, moment)
            energy[0] = 0.5 * energy[1]
        return np.where(self._held, 0.0, self._axes.of_scene(found * unit))

    def _given(self, fix: Fix, moment: Resolver) -> float:
        """Energy that fix langevin gives to the beads in a step with the present forces and velocities, if it counts."""
        if not fix.parameters["tally"]:
            return 0.0
        power = np.sum(fix.parameters["last"] * moment.velocities[self.state.group(fix.group)])
        return float(power) * self.state.timestep / moment.units.time

    def limit(self, m: Moment) -> None:
        """Velocities that would carry a bead too far in a step are shortened."""
        if not self.limits:
            return
        speeds = np.linalg.norm(m.v, axis=1, keepdims=True)
        fast, before = (speeds > self._most)[:, 0], m.v.copy()
        m.v[fast] *= (self._most / np.maximum(speeds, 1e-300))[fast]
        for fix in self.state.fixes_of("nve/limit"):
            m.numbers[self._places[fix.name]] += np.count_nonzero(fast & self.state.group(fix.group))
        self._cut = m.v - before

    def _place(self, values: np.ndarray, which: int) -> None:
        np.copyto(values, self._prescribed[which], where=~np.isnan(self._prescribed[which]))

    def place(self, m: Moment, seen: np.ndarray) -> None:
        """Beads of fix move where they are, their velocities not predicted; pair coefficients that fix adapt sets for the next forces."""
        if self._piston is not None:
            self._scale(self._piston, m)
        step = self.request.first_step + m.number + 1
        due = [fix for fix in self.state.fixes_of("adapt") if fix.parameters["every"] and step % fix.parameters["every"] == 0]
        for fix in due:
            adapt(fix, self._moment(m, m.number + 1, m.v))
        if due:
            self.renew()
        if not self._moves:
            return
        self._place(m.x, 0)
        self._place(m.v, 1)  # walls may have changed them
        seen[self._moved] = m.v[self._moved]
        box = self.state.require_box("fix move")
        if not all(box.periodic) and not (inside := box.holds(box.wrap(m.x[self._moved] / self.state.units.length)[0])).all():
            raise RunError(f"fix move: bead {self.state.atoms.ids[self._moved][np.argmin(inside)]} leaves the box")

    def end(self, m: Moment) -> None:
        """Half a step of the Nose-Hoover chains, then the other thermostats."""
        before = m.v.copy() if self.state.fixes_of(*COUPLED) else m.v
        if (piston := self._piston) is not None:
            piston.slow(self._of_piston(m), m)
            piston.push(self._of_piston(m), m, self._moment(m, m.number, m.v))
        self._chains(m, m.number)
        if piston is not None:
            piston.chain(self._of_piston(m), target(piston.fix, self._moment(m, m.number, m.v)), m.dt)
        for fix in self.state.fixes_of("temp/rescale", "temp/berendsen", "langevin"):
            moment, energy = self._moment(m, m.number, m.v), m.numbers[self._places[fix.name]]
            if fix.style == "langevin":
                energy[1] = self._given(fix, moment)
                energy[0] += energy[1]
            elif moment.step % fix.parameters.get("every", 1) == 0:
                self._rescale(fix, m, moment, energy)
        self.changed = None if before is m.v and not self.limits else m.v - before + self._cut

    def _rescale(self, fix: Fix, m: Moment, moment: Resolver, energy: np.ndarray) -> None:
        given, kT, beads = fix.parameters, target(fix, moment), _Scaling(fix, moment, m.v, self._masses)
        now = beads.twice / beads.freedom if beads.freedom > 0 else 0.0
        if not now:
            raise fix.error("it cannot scale velocities: the temperature of its group is 0")
        part = m.dt / given["damp"] if "damp" in given else given["fraction"] * (abs(now - kT) > given["window"])
        goal = now + part * (kT - now)
        energy += 0.5 * beads.freedom * (now - goal) / moment.units.energy
        beads.by(float(np.sqrt(max(goal, 0.0) / now)))

    def _chains(self, m: Moment, step: int) -> None:
        for fix in self.state.fixes_of("nvt", "npt"):
            moment, given = self._moment(m, step, m.v), fix.parameters
            beads, kT = _Scaling(fix, moment, m.v, self._masses), target(fix, moment)
            settings = given["damp"], beads.freedom, beads.twice, given["loop"], given["drag"]
            beads.by(chain.half_step(m.numbers[self._places[fix.name]][: given["chain"]], m.dt, kT, *settings))

    def keep(self, numbers: np.ndarray, done: bool = True) -> None:
        """Hand what the fixes keep back to the deck, for the next run or a restart file."""
        for name, place in self._places.items():
            self.state.fixes[name].parameters["numbers"] = numbers[place].tolist()
        if done:
            end(self.state)

    def values(self, numbers: np.ndarray, moment: Resolver) -> dict[str, list[float]]:
        """Values of the fixes that change velocities: an energy or a count, and what a chain consists of."""
        found = {name: [float(numbers[place][0])] for name, place in self._places.items()}
        for fix in self.state.fixes_of("langevin", "nvt", "npt"):
            own, units = numbers[self._places[fix.name]], moment.units
            found[fix.name] = [float(0.5 * own[-1] - own[0])]
            if fix.style != "langevin":
                eta, rate, _ = chained = own[: fix.parameters["chain"]].reshape(3, -1)
                freedom = _Scaling(fix, moment, moment.velocities, self._masses).freedom
                masses = self._chain(fix, chained, moment, freedom)
                potential, kinetic = target(fix, moment) * eta / units.energy, 0.5 * masses * rate**2 / units.energy
                potential[0] *= freedom
                found[fix.name] = [float((potential + kinetic).sum()), *eta, *(rate * units.time), *potential, *kinetic]
                if self._piston is not None:
                    found[fix.name] = [found[fix.name][0] + self._piston.energy(own[fix.parameters["chain"] :], moment) / units.energy]
        return found
