"""Fingerprints of positions, box and parameters: whether a stored acceleration is still valid."""

import numpy as np

from ...base.names import VOLATILE
from ...kernels import motion
from ...kernels.compiled import compiled, inlined


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
