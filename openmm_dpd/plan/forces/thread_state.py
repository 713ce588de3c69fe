"""What the pair force keeps between two calls, for each thread by itself, and whether it is still valid: fingerprints of positions, box and
parameters."""

from dataclasses import dataclass, field
from weakref import WeakValueDictionary

import numpy as np

from ...base.names import VOLATILE
from ...kernels import motion
from ...kernels.fields import ENERGY, FieldSpec
from ...kernels.interface import Engine
from ...kernels.layer import CONSERVATIVE, PairSpec
from ...kernels.moment import Stepper
from ...runtime import compiled, inlined


@inlined
def _stir(total, bits):
    total = (total ^ bits) * np.uint64(0xBF58476D1CE4E5B9)
    return total ^ (total >> np.uint64(29))


@compiled
def _of_words(x, parameters):
    # four sums side by side: each multiplication waits for the one before it
    a, b, c, d = np.uint64(0x9E3779B97F4A7C15), np.uint64(1), np.uint64(2), np.uint64(3)
    for bits in (x, parameters):
        whole = len(bits) - len(bits) % 4
        for k in range(0, whole, 4):
            a, b, c, d = _stir(a, bits[k]), _stir(b, bits[k + 1]), _stir(c, bits[k + 2]), _stir(d, bits[k + 3])
        for k in range(whole, len(bits)):
            a = _stir(a, bits[k])
    for other in (b, c, d):
        a = _stir(a, other)
    return np.float64(a >> np.uint64(11)) * 2.0**-960


def fingerprint(x: np.ndarray, parameters: np.ndarray) -> float:
    """A number that depends on every bit of the positions and parameters, too small to matter where it is taken for an energy."""
    return _of_words(x.ravel().view(np.uint64), parameters.view(np.uint64))


@dataclass(eq=False)
class Shown:
    """What forces depend on and OpenMM does not hand to them: a table of bonds (:mod:`openmm_dpd.kernels.reactions`), and values of fields.
    Its number is a context parameter (:data:`openmm_dpd.base.names.SHOWN`), by which the pair force of any copy of the System finds it as
    long as an integrator keeps it."""

    bonds: np.ndarray | None
    values: np.ndarray | None
    number: float = 0.0

    @classmethod
    def of(cls, spec: PairSpec, bonds: np.ndarray | None, values: np.ndarray | None) -> "Shown":
        """The bonds, and the values if forces depend on them; or an equal one that somebody keeps already."""
        made = cls(bonds, values if spec.fields is not None and spec.fields.acts else None)
        bonds, values = (np.zeros(0) if its is None else np.ascontiguousarray(its) for its in (made.bonds, made.values))
        made.number = fingerprint(values, bonds.ravel())
        return SHOWN_NOW.setdefault(made.number, made)


#: What integrators keep, by its number.
SHOWN_NOW: WeakValueDictionary[float, Shown] = WeakValueDictionary()


def only_folded(x: np.ndarray, before: np.ndarray, box: np.ndarray) -> bool:
    """Whether x differs from the positions before by box vectors only, to float32 rounding: GPU platforms wrap beads now and then."""
    if not motion.jumped(x, before, 0.5 * np.diag(box).min()):
        return False
    d = x - before
    for axis in (2, 1, 0):
        d -= np.round(d[:, axis] / box[axis, axis])[:, None] * box[axis]
    return bool(np.abs(d).max() < 4e-7 * (np.abs(before).max() + np.diag(box).max()))


class Fingerprints:
    """Those of one thread, with what the last one was of."""

    def __init__(self) -> None:
        self._last: tuple[float, np.ndarray, np.ndarray] | None = None

    def of(self, x: np.ndarray, box: np.ndarray | None, parameters: dict) -> float:
        """Fingerprint of positions, parameters and box; that of the last call if beads were only wrapped into the box since."""
        stable = np.array(
            [value for name, value in sorted(parameters.items()) if name not in VOLATILE] + ([] if box is None else box.ravel().tolist())
        )
        value = None
        if self._last is not None:
            last, last_x, last_stable = self._last
            if stable.tobytes() == last_stable.tobytes() and (motion.same(x, last_x) or (box is not None and only_folded(x, last_x, box))):
                value = last
        if value is None:
            value = fingerprint(x, stable)
        self._last = (value, x, stable)
        return value

    def forget(self) -> None:
        """The positions are new: what is asked next was not just wrapped into the box."""
        self._last = None


class Fields:
    """Per-bead fields, as the pair force reads them and returns their changes: blocks of three values per bead.  Programs skip immobile
    beads, so these have the values of the start, but in loops of steps.  Internal energies come as (conductive, mechanical, what rounding
    lost of the sum); everything else as one value after the other."""

    def __init__(self, spec: FieldSpec):
        self.spec = spec
        self.values = spec.initial.copy()
        self.last = np.zeros_like(self.values)
        self._low: np.ndarray | None = None

    def read(self, block: int, shown: np.ndarray) -> None:
        """Take over the values of one block, (N, 3), of the beads that move."""
        if self.spec.kind == ENERGY:
            shown = np.column_stack([shown[:, 0], shown[:, 1] + shown[:, 2]])
        columns = slice(3 * block, 3 * block + 3)
        part, still = self.values[:, columns], self.spec.immobile
        part[...] = shown[:, : part.shape[1]]
        part[still] = self.spec.initial[still, columns]

    def changes(self, block: int) -> np.ndarray:
        """(N, 3) changes of one block."""
        part = self.last[:, 3 * block : 3 * block + 3]
        result = np.zeros((len(part), 3))
        result[:, : part.shape[1]] = part
        if self._low is not None:
            result[:, 2], self._low = self._low, None
        return result

    def balance(self, v: np.ndarray, change: np.ndarray, inv_mass: np.ndarray) -> None:
        """Count what the motion of each bead got with the mechanical energy, in two float32 parts."""
        with np.errstate(divide="ignore", invalid="ignore"):
            motion = np.where(inv_mass > 0, 0.5 * np.sum(change * (2 * v + change), axis=1) / inv_mass, 0.0)
        whole = self.last[:, 1] + motion
        rounded = self.last[:, 0].astype(np.float32).astype(np.float64), whole.astype(np.float32).astype(np.float64)
        self._low = (self.last[:, 0] - rounded[0]) + (whole - rounded[1])
        self.last = np.column_stack(rounded)


class ConservativeForce:
    """The conservative force at the prepared positions of an engine."""

    def __init__(self, engine: Engine):
        self._engine = engine
        self._force, self._energy, self._at = np.zeros((len(engine.spec.types), 3)), 0.0, -1

    def now(self, fields: Fields | None) -> tuple[float, np.ndarray]:
        """Energy and force, computed unless they are there already."""
        engine = self._engine
        # a repulsion may depend on the temperatures of the beads
        warm = fields is not None and fields.spec.acts
        if self._at != engine.number or warm:
            self._energy = engine.forces(CONSERVATIVE, None, 0.0, 1.0, 0, 0, None if fields is None else fields.values, self._force)[0]
            self._at = engine.number
        return self._energy, self._force


@dataclass(eq=False)
class ThreadState:
    """All of it; nothing that could not be computed again."""

    engine: Engine
    loop: Stepper | None  #: Whole steps with that engine
    fields: Fields | None  #: Internal energies, temperatures or concentrations as programs have shown them, or a loop has left them
    conservative: ConservativeForce = field(init=False)
    fingerprints: Fingerprints = field(default_factory=Fingerprints)
    kept: np.ndarray | None = None  #: (N, 3) positions that were stored last
    failed: tuple[int, float] | None = None  #: Phase and noise counter of an evaluation that failed
    v: np.ndarray = field(init=False)  # v, result: (N, 3) velocities that were shown, and what an evaluation returns:
    result: np.ndarray = field(init=False)  # written again and again, since OpenMM copies what it is given

    def __post_init__(self):
        self.conservative = ConservativeForce(self.engine)
        self.v, self.result = np.zeros((2, len(self.engine.spec.types), 3))
