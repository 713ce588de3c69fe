"""What the pair force keeps between two calls, for each thread by itself."""

from dataclasses import dataclass, field

import numpy as np

from ...kernels.fields import ENERGY, FieldSpec
from ...kernels.interface import Engine
from ...kernels.layer import CONSERVATIVE
from ...kernels.moment import Stepper
from .fingerprint import Fingerprints


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
