"""``fix ave/histo`` (histograms), ``fix vector`` (values of all steps so far) and ``fix store/state`` (values of beads at one step)."""

from collections import deque

import numpy as np

from ...base.errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.records import Valued
from ..values.compute_spec import reference
from ..values.computes import check_bead_word, expanded, is_of_beads, is_of_terms
from ..values.resolver import Resolver, present
from .averages import AveragingFix, Schedule, check_words, intervals, split_values
from .dumps import COLUMNS, column
from .thermo import check_word

_COORDINATES = tuple(f"{kind}{axis}" for kind in ("", "v", "f") for axis in "xyz")


class Histogram(AveragingFix):
    """``fix ID group ave/histo Nevery Nrepeat Nfreq lo hi Nbin value value ... keyword values ...``."""

    def __init__(self, state: DeckState, name: str, group: str, args: list[str]):
        read.count(args, "fix ID group ave/histo Nevery Nrepeat Nfreq lo hi Nbin value value ...", 7, None)
        own = dict.fromkeys(("mode", "kind", "start", "append", "beyond"), 1)
        words, options = split_values(args[6:], ("c_", "f_", "v_", *_COORDINATES), own, "ave/histo")
        chosen = {word: options.get(word, [default])[0] for word, default in (("mode", "scalar"), ("kind", "global"), ("beyond", "ignore"))}
        self._vector = read.choice(chosen["mode"], "mode", ("scalar", "vector")) == "vector"
        self._beyond = read.choice(chosen["beyond"], "beyond", ("ignore", "end", "extra"))
        read.choice(chosen["kind"], "kind", ("global", "peratom", "local"))
        self.words, self._group = expanded(state, words), group
        for word in self.words:
            if is_of_beads(state, word) or is_of_terms(state, word):
                check_bead_word(state, word, _COORDINATES, local=is_of_terms(state, word))
            elif not self._whole(state, word):
                check_word(state, word)
        if not words:
            check_words(state, words, "ave/histo", args[6])
        (self._low, self._high), count = (
            (read.number(word, "an end of fix ave/histo") for word in args[3:5]),
            read.integer(args[5], "Nbin", 1),
        )
        if self._high <= self._low:
            raise ParameterError(f"fix ave/histo: the upper end {args[4]} is not above the lower end {args[3]}")
        self._width = (self._high - self._low) / count
        ends = ([self._low], [self._high]) if self._beyond == "extra" else ([], [])
        self._centres = np.concatenate([ends[0], self._low + (np.arange(count) + 0.5) * self._width, ends[1]])
        titles = "# TimeStep Number-of-bins Total-counts Missing-counts Min-value Max-value", "# Bin Coord Count Count/Total"
        start, mode = read.integer(options.get("start", ["0"])[0], "start", 0), options.get("ave", ["one"])
        schedule = Schedule(*intervals("ave/histo", args[:3]), state.step, start)
        super().__init__(state, name, schedule, options, [f"# Histogrammed data for fix {name}", *titles])
        self._running, self._blocks = mode[0] == "running", deque[np.ndarray](maxlen=int(mode[1]) if mode[0] == "window" else 1)
        self._sums, self.values = np.zeros(4), np.column_stack([self._centres, np.zeros((len(self._centres), 2))])
        self.shape, self.what = self.values.shape, f"the fix has {len(self._centres)} bins with three values, and four sums"
        self.forget()

    def _whole(self, state: DeckState, word: str) -> bool:
        """Whether a word names a whole vector."""
        kind, name, indices = reference(word)
        return self._vector and (kind != "v" or (not indices and state.variables.get(name).style == "vector"))

    def forget(self) -> None:
        # counts of the bins, of what is missing, the least and the largest value
        self._open = np.concatenate([np.zeros(len(self._centres) + 1), [1e20, -1e20]])

    def _read(self, moment: Resolver, word: str) -> np.ndarray:
        if is_of_terms(moment.state, word):
            return moment.local_values(word)
        if is_of_beads(moment.state, word):
            return moment.bead_values(word)[moment.state.group(self._group)]
        return moment.vector(word) if self._whole(moment.state, word) else np.array([moment.number(word)])

    def sample(self, moment: Resolver) -> None:
        values, last, counts = np.concatenate([self._read(moment, word) for word in self.words]), len(self._centres) - 1, self._open
        below, above = values < self._low, values > self._high
        number = np.floor(np.where(below | above, 0.0, values - self._low) / self._width) + (self._beyond == "extra")
        number = np.where(below, 0, np.where(above, last, np.minimum(number, last))).astype(np.int64)
        missing = (below | above) & (self._beyond == "ignore")
        counts[:-3] += np.bincount(number[~missing], minlength=last + 1)
        counts[-3] += missing.sum()
        counts[-2:] = min(counts[-2], values.min(initial=1e20)), max(counts[-1], values.max(initial=-1e20))

    def close_window(self, moment: Resolver) -> None:
        every = np.array([*self._blocks, self._open][-self._blocks.maxlen - self._running :])  # type: ignore[operator]
        found = np.concatenate([every[:, :-2].sum(axis=0), [every[:, -2].min(), every[:, -1].max()]])
        self._blocks.append(found if self._running else self._open)
        counts, total = found[:-3], found[:-3].sum()
        self.values, self._sums = np.column_stack([self._centres, counts, counts / max(total, 1.0)]), np.array([total, *found[-3:]])
        self.report = {"step": moment.step, "coord": self._centres.tolist(), "count": counts.tolist()}
        self.forget()
        sums = " ".join(repr(float(value)).removesuffix(".0") for value in self._sums)
        rows = [f"{k} {coord:g} {count:g} {part:g}" for k, (coord, count, part) in enumerate(self.values.tolist(), start=1)]
        self._file.write(moment.state, [f"{moment.step} {len(counts)} {sums}", *rows])

    def check_index(self, *indices: int) -> None:
        if len(indices) != 1 or not 1 <= indices[0] <= 4:
            super().check_index(*indices)

    def value(self, *indices: int) -> float:
        return super().value(*indices) if len(indices) == 2 else float(self._sums[indices[0] - 1])


class Series(Valued):
    """``fix ID group vector Nevery value value ... [nmax N]``: the values of all steps that are multiples of Nevery."""

    def __init__(self, state: DeckState, name: str, group: str, args: list[str]):
        at = args.index("nmax") if "nmax" in args else len(args)
        read.count(args[:at], "fix ID group vector Nevery value value ...", 2, None)
        self.name, self.every, self.next_due, self._last = name, read.integer(args[0], "the interval of fix vector", 1), 0, -1
        self._most = read.integer(args[-1], "nmax", 1) if at < len(args) else 0
        self._words = check_words(state, expanded(state, args[1:at]), "vector", args[1])
        self.shape = (None, len(self._words)) if len(self._words) > 1 else (None,)
        self.values, self.what = (
            np.zeros([size or 0 for size in self.shape]),
            f"the fix has {len(self._words)} value(s) of each step",
        )

    def begin(self, state: DeckState, step: int) -> None:
        """Prepare for a run that starts at ``step``."""
        self.next_due = -(-max(step, self._last + 1) // self.every) * self.every

    def take(self, moment: Resolver) -> None:
        """Add the values of a step at which they are due."""
        values = np.array([moment.number(word) for word in self._words]).reshape(-1, *self.values.shape[1:])
        self.values = np.concatenate([self.values, values])[-self._most :]
        self._last, self.next_due = moment.step, self.next_due + self.every

    def value(self, *indices: int) -> float:
        """Value of ``f_name[step]`` or ``f_name[step][value]``, counted from 1."""
        self.check_index(*indices)
        if indices[0] > len(self.values):
            raise ParameterError(f"f_{self.name}[{indices[0]}]: the fix has {len(self.values)} values so far")
        return float(self.values[tuple(index - 1 for index in indices)])


class BeadStore(Valued):
    """``fix ID group store/state N value value ... [com yes|no]``: values of beads, at the definition or at multiples of N."""

    shape = ()

    def __init__(self, state: DeckState, name: str, group: str, args: list[str]):
        at = args.index("com") if "com" in args else len(args)
        read.count(args[:at], "fix ID group store/state N value value ... [com yes|no]", 2, None)
        self._com, self._words = read.single(args[at:], "fix store/state", com="no")["com"] == "yes", expanded(state, args[1:at])
        for word in self._words:
            check_bead_word(state, word, tuple(COLUMNS), "a value of fix store/state")
        self.name, self._group, self._every = name, group, read.integer(args[0], "the interval of fix store/state", 0)
        self.what, self.columns = f"the fix has {len(self._words)} value(s) of each bead", len(self._words) * (len(self._words) > 1)
        self.next_due, self._ids, self._values = 0, state.atoms.ids, np.zeros((len(state.atoms), len(self._words)))
        self._store(present(state), measured=False)
        self._complete = False  # what is measured waits for the next run

    def _store(self, moment: Resolver, measured: bool) -> None:
        """Store values: those that a run has to measure, or attributes of the beads."""
        mask = moment.state.group(self._group)
        for k, word in enumerate(self._words):
            if word.startswith(("c_", "v_", "f")) == measured:
                centre = moment.state.mass_average(moment.unwrapped, mask) if self._com and word in ("xu", "yu", "zu") else np.zeros(3)
                self._values[:, k] = np.where(mask, column(moment, word) - centre["xyz".find(word[0])], 0.0)

    def begin(self, state: DeckState, step: int) -> None:
        """Prepare for a run that starts at ``step``."""
        self.next_due = -(-step // self._every) * self._every if self._every else -1 if self._complete else step

    def take(self, moment: Resolver) -> None:
        """Store the values of a step at which they are due."""
        if self._every:
            self._ids, self._values = moment.state.atoms.ids, np.zeros((len(moment.state.atoms), len(self._words)))
            self._store(moment, measured=False)
        self._store(moment, measured=True)
        self._complete, self.next_due = True, self.next_due + self._every if self._every else -1

    def check_index(self, *indices: int) -> None:
        """Raise ParameterError: there is no single value."""
        raise ParameterError(f"f_{self.name}: {self.what}; use them in formulas and outputs of single beads")

    def of_beads(self, state: DeckState, index: int | None) -> np.ndarray:
        """(N,) values of the beads that there are now; 0 for new ones."""
        place = np.minimum(np.searchsorted(self._ids, state.atoms.ids), max(len(self._ids) - 1, 0))
        return np.where(self._ids[place] == state.atoms.ids, self._values[place, (index or 1) - 1], 0.0)
