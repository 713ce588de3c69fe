"""The pair engine: positions, velocities and parameters in; forces, impulses and sums out.

:class:`.layer.PairSpec` is the immutable description of the pair terms (it is what travels inside a serialized System);
:class:`PairEngine` holds scratch arrays and the pair lists of the last positions it saw, nothing that could not be recomputed.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.errors import RunError
from ..runtime import announced
from . import motion
from .bodies import Bodies
from .columns import Totals
from .dpd import SweptLayer
from .eos import CONSTANT
from .exceptions import Exceptions
from .fields import Sources
from .interface import Engine
from .layer import CONSERVATIVE, DISSIPATIVE, LAPLACIAN, RANDOM, STRESS, Call, Layer, PairSpec
from .pairs import MANY


class PairEngine(Engine):
    """Evaluates the pair terms of one :class:`PairSpec` by compiled kernels.

    All results are the same, bit for bit, for any number of threads.
    """

    def __init__(self, spec: PairSpec):
        self.spec = spec
        self.layers: list[Layer] = [table.layer(spec, number) for number, table in enumerate(spec.terms)]
        self.lists = [layer.pairs for layer in self.layers]
        #: Whether the first layer gives every bead a force.
        self._covered = bool(self.lists) and len(self.lists[0].order) == len(spec.types)
        columns = 0 if spec.fields is None else spec.fields.n_values
        self.rates, self.increments = np.zeros((len(spec.types), columns)), np.zeros((len(spec.types), columns))
        self._sources, self._given = Sources(spec.fields), np.zeros_like(self.increments)  # rates of the sources, in a sweep
        self.number = 0
        self.extras, self.body_scale = [extra.evaluator() for extra in spec.extras], 1.0
        self._bonds: tuple[list[np.ndarray], Exceptions | None, np.ndarray | None] | None = None  #: Those that form and break
        if spec.sheared:
            self.set_flow(np.zeros(1))
            for pairs in [*self.lists, *(each.list for each in self.extras if hasattr(each, "list"))]:
                pairs.slides = True
        if spec.bodies is not None:
            self.bodies = Bodies(spec.bodies, len(spec.types))
            for layer in self.layers:
                layer.bodies = self.bodies  # type: ignore[attr-defined]  # of all that know them
        self._inv_mass = self._prescribed = None
        if spec.wall_velocity is not None:
            self._inv_mass, self._prescribed = spec.inv_mass.copy(), spec.wall_velocity.copy()
        self._x, self._seen = np.zeros((len(spec.types), 3)), np.zeros((0 if spec.wall_velocity is None else len(spec.types), 3))
        self._box: np.ndarray | None = None
        #: Whether the lists are those of these arrays, which nobody else can change.
        self._kept = False

    def holds(self, x: np.ndarray, box: np.ndarray | None) -> bool:
        same_box = self._box is None if box is None else self._box is not None and box.tobytes() == self._box.tobytes()
        return self._kept and same_box and motion.same(x, self._x)

    def prepare(self, x: np.ndarray, box: np.ndarray | None) -> bool:
        # numba would compile another version for a scene's read-only positions, or box
        given = (each if each is None or each.flags.writeable else each.copy() for each in (x, box))
        return super().prepare(*given)  # type: ignore[arg-type]

    def place(self, x: np.ndarray, box: np.ndarray | None) -> None:
        self._kept = False  # until the lists are complete
        for pairs in self.lists:
            pairs.build(x, box)
        if self.spec.carried is not None:
            self.spec.carried.see(x, self._prescribed)
        self.number += 1
        self._x, self._box = x, box

    def keep(self) -> None:
        self._x, self._box, self._kept = self._x.copy(), None if self._box is None else self._box.copy(), True

    def resume(self, x: np.ndarray, box: np.ndarray | None) -> None:
        self._x, self._box, self._kept = x, box, False

    def sums(self, which: int, v, kT, dt, seed, counter, field_values=None, out=None, held=None) -> Totals:
        force = np.empty((len(self.spec.types), 3)) if out is None else out
        for written in () if self._covered else (force, held):
            if written is not None:
                written[...] = 0.0
        energy = virial = drag = 0.0
        stress, laplacian = np.zeros(6) if which & STRESS else None, 0.0 if which & LAPLACIAN else None
        conservative = None if held is None else 0.0
        if which & RANDOM and kT == 0.0 and self.spec.fields is None:
            which &= ~RANDOM
        call = Call(which, None if v is None else self.seen(v), kT, dt, seed, counter, field_values, held=held, rates=self.rates)
        if self.spec.fields is not None:
            motion.clear_values(self.rates)
        for number, layer in enumerate(self.layers):
            result = layer.forces(call, force, number > 0)
            if stress is not None:
                if result.stress is None:
                    raise RunError(f"{type(layer).__name__} has no stress tensor")
                stress += result.stress
            if laplacian is not None:
                laplacian += layer.laplacian() if result.laplacian is None else result.laplacian
            if conservative is not None and result.conservative is not None:
                conservative += result.conservative
            energy += result.energy
            virial += result.virial
            drag += result.drag
        if which & CONSERVATIVE:
            for extra in self.extras:
                energy += extra.add_to(self._x, self._box, force, self.body_scale)
                if held is not None:  # once more, so that both have the bits that they have alone
                    extra.add_to(self._x, self._box, held, self.body_scale)
            for source in () if field_values is None else self._sources.all:
                source.push(force, field_values)
                if held is not None:
                    source.push(held, field_values)
        if which & DISSIPATIVE:
            self._sources.add_to(self.rates, self._x, self._box)
        return Totals(energy, virial, drag, stress, laplacian, conservative)

    def swept(self, v: np.ndarray, kT, dt, seed, counter, field_values=None, out=None, update: int | None = None) -> np.ndarray:
        out = np.empty_like(v) if out is None else out
        if self._prescribed is not None:
            motion.see(v, self._inv_mass, self._prescribed, out)
        elif out is not v:
            out[...] = v
        given = self._given if self._sources.all else None
        if self.spec.fields is not None:
            motion.clear_values(self.increments)
        if given is not None:
            motion.clear_values(given)
            self._sources.add_to(given, self._x, self._box, moving=True)
            motion.advance(self.increments, given, 0.5 * dt)
        call = Call(DISSIPATIVE | RANDOM, None, kT, dt, seed, counter, field_values, self.spec.update if update is None else update)
        if self.bodies is not None:
            self.bodies.look(self._x, out)
        for layer in self.layers:
            layer.sweep(call, out, self.increments)
        if self.bodies is not None:
            self.bodies.write(out)
        if given is not None:
            motion.advance(self.increments, given, 0.5 * dt)
        return out

    def renew(self) -> None:
        self.number += 1  # what was computed before is not valid any more
        for layer in self.layers:
            if isinstance(layer, SweptLayer):  # others keep none
                layer.renew()

    def laplacian(self) -> float:
        """Sum over mobile beads of the Laplacian of the conservative energy at the prepared positions."""
        return sum(layer.laplacian() for layer in self.layers)

    def set_flow(self, flow: np.ndarray) -> None:
        for pairs in self.lists:
            pairs.flow = flow

    def passed(self) -> np.ndarray:
        return sum((layer.passed for layer in self.layers if getattr(layer, "passed", None) is not None), np.zeros(6))  # type: ignore[attr-defined]

    def densities(self, layer: int) -> np.ndarray:
        return self.layers[layer].densities  # type: ignore[attr-defined]

    def set_bonds(self, beads: list[np.ndarray], exceptions: Exceptions | None = None, types: np.ndarray | None = None) -> None:
        made = [terms.between(pairs).evaluator() for terms, pairs in zip(self.spec.sorts, beads, strict=True) if len(pairs)]
        self.number += 1  # first: what was computed before is not valid any more
        for segments in (each for each in made if hasattr(each, "list")):
            segments.list.slides = self.spec.sheared
        self.extras, self._bonds = [*self.extras[: len(self.spec.extras)], *made], (beads, exceptions, types)
        self._kept = self._kept and exceptions is None and types is None
        for pairs in [*self.lists, *(each.list for each in self.extras[: len(self.spec.extras)] if hasattr(each, "list"))]:
            if exceptions is not None:
                pairs.leave_out(exceptions)
            if types is not None:
                pairs.set_types(types)

    def another(self) -> "PairEngine":
        made = type(self)(self.spec)
        if self._bonds is not None:
            made.set_bonds(*self._bonds)
        return made

    @property
    def repeats(self) -> bool:
        # pairs of many beads that somebody has had stored are not there in the next step; and one thread alone gains nothing with them, but
        # would have to keep a state
        unlike = any(pairs.many and (pairs.stored or pairs.threads == 1) for pairs in self.lists)
        steady = self._covered and not unlike and self._sources.steady
        return steady and all(getattr(each, "repeats", False) for each in [*self.layers, *self.extras])

    def tables(self, layer: int, heats: np.ndarray) -> dict[str, np.ndarray] | None:
        its: Any = self.layers[layer]
        if not heats.min() > 0.0:
            return None
        if hasattr(its, "coefficients_at"):
            table = its.coefficients_at(heats)
        else:
            table = np.repeat(its.coefficients[None], len(heats), axis=0)  # they are the same at all
        return None if table is None else {"coefficients": table, "kT": heats}

    def sorted_beads(self) -> np.ndarray:
        return self.lists[0].order.copy()

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        for each in (*self.lists, *self.extras, *([self.bodies] if self.bodies is not None else ())):
            each.seat(names, places)  # type: ignore[attr-defined]  # all that repeats can
        self._sources.seat(names)
        if self._prescribed is not None:
            np.take(self.spec.inv_mass, names, out=self._inv_mass)
            np.take(self.spec.wall_velocity, names, axis=0, out=self._prescribed)  # type: ignore[arg-type]  # there is one
        self._kept = False

    def seen(self, v: np.ndarray) -> np.ndarray:
        """See :meth:`.interface.Engine.seen`; valid until the next call."""
        if self._prescribed is None:
            return v
        motion.see(v, self._inv_mass, self._prescribed, self._seen)
        return self._seen

    @property
    def parts_forces(self) -> bool:
        return all(getattr(layer, "parts_forces", False) for layer in self.layers)

    @property
    def repels_by_pairs(self) -> bool:
        return all(getattr(layer, "repels_by_pairs", False) for layer in self.layers)

    def tensors(self, v: np.ndarray, kT: float) -> tuple[np.ndarray, np.ndarray, float]:
        found = [layer.tensors(v, kT) for layer in self.layers]  # type: ignore[attr-defined]
        return found[0] if len(found) == 1 else tuple(map(sum, zip(*found, strict=True)))  # type: ignore[return-value]


def host_engine(spec: PairSpec) -> PairEngine:
    """A new engine of compiled kernels."""
    return PairEngine(spec)


#: The model that each class of tables belongs to, for messages.
_MODELS = {
    **{"TermTable": "DPD", "ManyBodyTable": "many-body DPD", "EnergyTable": "DPD with internal energies"},
    **{"ThermalTable": "eDPD", "SpeciesTable": "tDPD"},
}


def warm_up(spec: PairSpec, log: Callable[[str], None]) -> None:
    """Compile the kernels that steps of ``spec`` need (or load them from the cache), with a notice for each variant."""
    if not spec.terms:
        return
    models = " and ".join(dict.fromkeys(_MODELS.get(type(table).__name__, "pair terms") for table in spec.terms))
    how = f"{'pair updates' if spec.sweeps else 'friction as a force'}{' in a shear' if spec.sheared else ''}"
    for many in sorted({False, bool(np.count_nonzero(spec.types >= 0) >= MANY)}):
        with announced(f"{models} ({how}{', many beads' if many else ''})", 10, log):
            _use_all(spec, many)


def _use_all(spec: PairSpec, many: bool) -> None:
    """Call every kernel that steps need once; measurements need others, which are compiled when they are first used."""
    # few enough beads to be quick, in a box with three cells along each edge
    few = np.arange(30) % len(spec.types)
    if spec.fields is not None and spec.fields.eos is not None:
        few[0] = np.argmax(spec.fields.eos.curve != CONSTANT)  # other kernels are for beads that are all constant
    fields = None if spec.fields is None else spec.fields.of(few)
    small = PairSpec(np.maximum(spec.types[few], 0), np.ones(len(few)), spec.terms, spec.update, fields=fields, sheared=spec.sheared)
    edge = 4.0 * max(float(table.cutoff.max()) for table in spec.terms)
    engine = host_engine(small)
    for pairs in engine.lists:
        pairs.many = many and pairs.passes
    engine.prepare(np.random.default_rng(0).random((len(few), 3)) * edge, np.diag([edge] * 3))
    # all beads have the same values, so that no pair is stranger than those of the scene; but energies have ranges of their own
    field_values = None if fields is None else fields.initial if fields.eos else np.tile(fields.initial[:1], (len(few), 1))
    which = CONSERVATIVE if spec.sweeps else CONSERVATIVE | DISSIPATIVE | RANDOM
    engine.forces(which, np.zeros((len(few), 3)), 1.0, 1e-6, 0, 0, field_values)
    if spec.sweeps:
        engine.sweep(np.zeros((len(few), 3)), 1.0, 1e-6, 0, 0, field_values)
