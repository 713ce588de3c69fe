"""``fix ave/correlate``: products of values at two steps, averaged by the time between them."""

from collections import deque

import numpy as np

from ...errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..values.computes import expanded
from ..values.resolver import Resolver
from .averages import AveragingFix, Every, check_words, common_parts, intervals, split_values

#: Which pairs of n values are correlated, the earlier one first, by type.
_PAIRS = {
    "auto": lambda n: [(i, i) for i in range(n)],
    "upper": lambda n: [(i, j) for i in range(n) for j in range(i + 1, n)],
    "lower": lambda n: [(i, j) for i in range(n) for j in range(i)],
    "auto/upper": lambda n: [(i, j) for i in range(n) for j in range(i, n)],
    "auto/lower": lambda n: [(i, j) for i in range(n) for j in range(i + 1)],
    "full": lambda n: [(i, j) for i in range(n) for j in range(n)],
    "first": lambda n: [(0, j) for j in range(n)],
}


class Correlation(AveragingFix):
    """``fix ave/correlate``."""

    def __init__(
        self, words: tuple[str, ...], pairs: list[tuple[int, int]], windows: int, freq: int, prefactor: float, running: bool, *parts
    ):
        super().__init__(*parts)
        self.words, self._freq, self._prefactor, self._running = words, freq, prefactor, running
        self._early, self._late = ([pair[k] for pair in pairs] for k in (0, 1))
        self._titles = [f"{words[i]}*{words[j]}" for i, j in pairs]
        self._delays = np.arange(windows) * self._schedule.every
        # delays, how many products each is a mean of, and the means
        self.values = np.column_stack([self._delays, np.zeros((windows, 1 + len(pairs)))])
        self.shape, self.what = self.values.shape, f"the fix has {windows} rows and {2 + len(pairs)} columns"
        self.forget()

    def forget(self) -> None:
        self._kept: deque[np.ndarray] = deque(maxlen=len(self._delays))
        self._counts, self._sums = np.zeros(len(self._delays), dtype=np.int64), np.zeros((len(self._delays), len(self._early)))

    def sample(self, moment: Resolver) -> None:
        self._add(np.array([moment.number(word) for word in self.words]))

    def _add(self, values: np.ndarray) -> None:
        self._kept.append(values)
        before = np.array(self._kept)[::-1]
        self._counts[: len(before)] += 1
        self._sums[: len(before)] += before[:, self._early] * values[self._late]

    def close_window(self, moment: Resolver) -> None:
        if moment.step % self._freq:
            return
        counts = self._counts[:, None]
        means = np.divide(self._prefactor * self._sums, counts, out=np.zeros_like(self._sums), where=counts > 0)
        self.values = np.column_stack([self._delays, counts, means])
        columns = dict(zip(("delay", "count", *self._titles), self.values.T.tolist(), strict=True))
        self.report = {"step": moment.step} | columns
        rows = enumerate(zip(self._delays, self._counts, means, strict=True), start=1)
        lines = [
            f"{k} {delay} {count}" + "".join(self._form % value if count else " 0.0" for value in row) for k, (delay, count, row) in rows
        ]
        self._file.write(moment.state, [f"{moment.step} {len(lines)}", *lines])
        if not self._running:
            latest = self._kept[-1]
            self.forget()
            self._add(latest)


def parse_ave_correlate(state: DeckState, name: str, group: str, args: list[str]) -> Correlation:
    """AveragingFix of ``fix ID group ave/correlate Nevery Nrepeat Nfreq value value ... keyword values ...``."""
    read.count(args, "fix ID group ave/correlate Nevery Nrepeat Nfreq value value ...", 4, None)
    every, windows, freq = intervals("ave/correlate", args[:3])
    words, options = split_values(args[3:], ("c_", "f_", "v_"), {"type": 1, "start": 1, "prefactor": 1}, "ave/correlate")
    words = check_words(state, expanded(state, words), "ave/correlate", args[3])
    pairs = _PAIRS[read.choice(options.get("type", ["auto"])[0], "type", tuple(_PAIRS))](len(words))
    if not pairs:
        raise ParameterError(f"fix ave/correlate: type {options['type'][0]} of one value leaves no pair")
    running = read.choice(options.get("ave", ["one"])[0], "ave", ("one", "running")) == "running"
    if "overwrite" in options and not running:
        raise ParameterError("fix ave/correlate: overwrite goes with 'ave running', as in LAMMPS")
    prefactor = read.number(options.get("prefactor", ["1"])[0], "prefactor")
    start = read.integer(options.get("start", ["0"])[0], "start", 0)
    header = [
        f"# Time-correlated data for fix {name}",
        "# Timestep Number-of-time-windows",
        f"# Index TimeDelta Ncount {' '.join(f'{words[i]}*{words[j]}' for i, j in pairs)}",
    ]
    parts = common_parts(state, name, Every(every, 1, every, state.step, start), options, header)
    return Correlation(words, pairs, windows, freq, prefactor, running, *parts)
