"""``fix ave/chunk``: averages over steps of values of beads, in bins of the box."""

import numpy as np

from ...analysis.profiles import sums_in_slices
from ...base.errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..values.chunks import Bins, chunk_numbers
from ..values.computes import check_bead_word, expanded
from ..values.per_bead import BEAD_WORDS
from ..values.resolver import Resolver
from .averages import AveragingFix, Schedule, intervals, split_values

#: Values of ``fix ave/chunk`` that are more than a mean over beads.
_OWN = ("density/number", "density/mass", "temp")
_COMPONENTS = ("vx", "vy", "vz", "fx", "fy", "fz", "mass")


class ChunkAverage(AveragingFix):
    """``fix ID group ave/chunk Nevery Nrepeat Nfreq chunkID value value ... keyword values ...``.  ``profile`` has the last block that was
    complete: ``coord`` (``coord1``, ``coord2`` and so on where several axes are cut), ``ncount`` and the values by name."""

    def __init__(self, state: DeckState, name: str, group: str, args: list[str]):
        read.count(args, "fix ID group ave/chunk Nevery Nrepeat Nfreq chunkID value value ...", 5, None)
        compute = state.computes.get(args[3])
        if compute is None or compute.style != "chunk/atom":
            known = ", ".join(other.name for other in state.computes.values() if other.style == "chunk/atom") or "none"
            raise ParameterError(f"fix ave/chunk: '{args[3]}' is not the id of a compute chunk/atom; defined are {known}")
        own = {"norm": 1, "adof": 1, "cdof": 1, "append": 1, "format": 1}
        words, options = split_values(args[4:], ("c_", "v_", *_COMPONENTS, *_OWN), own, "ave/chunk")
        if not words:
            raise ParameterError(
                f"fix ave/chunk: expected {', '.join((*_COMPONENTS, *_OWN))}, c_id, c_id[column] or v_name, not '{args[4]}'"
            )
        words = expanded(state, words)
        for word in words:
            if word not in _OWN:
                check_bead_word(state, word, _COMPONENTS)
        norm = read.choice(options.get("norm", ["all"])[0], "norm", ("all", "sample", "none"))
        self._adof, self._cdof = (read.number(options.get(word, [default])[0], word) for word, default in (("adof", "3"), ("cdof", "0")))
        places = " ".join(f"Coord{k}" for k in range(1, len(compute.settings.axes) + 1))
        header = [
            f"# Chunk-averaged data for fix {name} and group {group}",
            "# Timestep Number-of-chunks Total-count",
            f"# Chunk {places} Ncount {' '.join(words)}",
        ]
        super().__init__(state, name, Schedule(*intervals("ave/chunk", args[:3]), state.step), options, header)
        self._group, self._compute, self._values, self._norm = group, compute, words, norm
        own_words = {"temp": ("vx", "mass"), "density/number": (), "density/mass": ("mass",)}
        self.words = (*(part for word in words for part in own_words.get(word, (word,))), "x")
        self.profile: dict[str, list[float]] | None = None
        columns = len(compute.settings.axes) + 1 + len(words)
        self.shape, self.what, self.values = (None, columns), f"the fix has {columns} columns", np.zeros((0, columns))
        self.forget()

    def forget(self) -> None:
        self._bins: Bins | None = None
        self._counts, self._sums, self._samples = np.zeros(0), np.zeros((0, 0)), 0

    def sample(self, moment: Resolver) -> None:
        if self._bins is None:
            self._bins = self._compute.settings.bins(moment.box)
            self._counts = np.zeros(self._bins.count)
            self._sums = np.zeros((len(self._values), self._bins.count))
        bins = self._bins
        number = chunk_numbers(moment, self._compute, bins)
        kept = (number >= 0) & moment.state.group(self._group)
        number = number[kept]
        counts = sums_in_slices(number, None, bins.count)
        for k, word in enumerate(self._values):
            sums = self._of_beads(moment, word, number, kept, bins.count)
            self._sums[k] += sums if self._norm == "all" else self._normalised(moment, word, sums, counts, 1)
        self._counts += counts
        self._samples += 1

    @staticmethod
    def _of_beads(moment: Resolver, word: str, number: np.ndarray, kept: np.ndarray, count: int) -> np.ndarray:
        """Sum over the beads of each bin; for ``temp`` that of m v^2."""
        if word == "density/number":
            values = np.ones(len(number))
        elif word == "density/mass":
            values = BEAD_WORDS["mass"](moment)[kept]
        elif word == "temp":
            velocities = moment.velocities[kept] * moment.units.velocity
            values = moment.state.bead_masses()[kept] * np.sum(velocities**2, axis=1) / moment.units.thermal_energy
        else:
            values = moment.bead_values(word)[kept]
        return sums_in_slices(number, values, count)

    def _normalised(self, moment: Resolver, word: str, sums: np.ndarray, counts: np.ndarray, samples: int) -> np.ndarray:
        """Sums over the beads of ``samples`` samples, divided by what belongs to the value; 0 for bins without beads."""
        assert self._bins is not None
        if word.startswith("density/"):
            unit = moment.units.density if word == "density/mass" else 1.0
            return unit * sums / (self._bins.volume * samples)
        by = counts
        if word == "temp":
            by = np.where(counts > 0, samples * self._cdof + self._adof * counts, 0.0)
        elif self._norm == "none":
            return sums
        return np.divide(sums, by, out=np.zeros_like(sums), where=by != 0)

    def close_window(self, moment: Resolver) -> None:
        bins, samples = self._bins, self._samples
        assert bins is not None
        values = self._sums / samples
        if self._norm == "all":
            pairs = zip(self._values, self._sums, strict=True)
            values = np.array([self._normalised(moment, word, sums, self._counts, samples) for word, sums in pairs])
        table = self._window.add(np.vstack([self._counts / samples, values]))
        self.forget()
        centres = bins.centres
        self._write(moment, centres, table)
        self.values = np.vstack([centres.T, table]).T
        names = ["coord"] if centres.shape[1] == 1 else [f"coord{k}" for k in range(1, centres.shape[1] + 1)]
        self.profile = {name: column.tolist() for name, column in zip(names, centres.T, strict=True)} | {"ncount": table[0].tolist()}
        self.profile |= {word: row.tolist() for word, row in zip(self._values, table[1:], strict=True)}

    def _write(self, moment: Resolver, centres: np.ndarray, table: np.ndarray) -> None:
        # LAMMPS divides everything but this number by the number of windows
        lines = [f"{moment.step} {table.shape[1]} {table[0].sum() * self._window.count:.15g}"]
        for k, (centre, column) in enumerate(zip(centres, table.T, strict=True), start=1):
            place = " ".join(f"{coordinate:g}" for coordinate in centre)
            lines.append(f"  {k} {place} {column[0]:g}" + "".join(self._form % value for value in column[1:]))
        self._file.write(moment.state, lines)
