"""Thermo output: columns, steps, values and their formats."""

import math
import re
from dataclasses import dataclass

from ...base.errors import ParameterError
from ..language import arguments as read
from ..language.lexer import errors_at, located
from ..language.variables import NUMBERS
from ..state.deck_state import DeckState
from ..state.moment import Window
from ..state.records import DeckSample
from ..values.compute_spec import reference
from ..values.computes import BUILT_IN, average_of, check_value, is_extensive
from ..values.resolver import Resolver
from ..values.words import WORDS

#: Columns of the styles other than ``custom``.
STYLES = {
    "one": ("step", "temp", "epair", "emol", "etotal", "press"),
    "multi": ("etotal", "ke", "temp", "pe", "ebond", "eangle", "edihed", "eimp", "evdwl", "ecoul", "elong", "press"),
    "yaml": ("step", "temp", "ke", "pe", "ebond", "eangle", "edihed", "eimp", "evdwl", "ecoul", "elong", "press"),
}

#: Formats of whole and of real numbers, by layout.
_FORMATS = {"one": ("%10d ", "% -14.8g"), "multi": ("%14d", "%14.4f"), "yaml": ("%d", "%.15g")}
#: Words that are averaged even if the deck does not print them.
ALWAYS = ("temp", "press", "press_full", "pe", "ke", "etotal", "temp_conf")
_FORMAT = re.compile(r"%[-+ #0-9.]*l{0,2}[dioxXeEfFgG]")


def check_word(state: DeckState, word: str) -> None:
    """Raise ParameterError unless ``word`` can be a column of thermo output."""
    if word.startswith("v_"):
        _, name, indices = reference(word)
        style = state.variables.get(name).style
        if style not in (("vector",) if indices else NUMBERS):
            raise ParameterError(f"{word}: variable {name} is {style}-style; only equal-style variables can be printed")
        return
    if word.startswith("c_"):
        _, name, indices = reference(word)
        check_value(state, name, *indices, word=word)
        return
    if word.startswith("f_"):
        _, name, indices = reference(word)
        average_of(state, name).check_index(*indices)
        return
    if word not in WORDS:
        raise ParameterError(
            f"thermo word '{word}' is not supported; supported are {', '.join(WORDS)}, v_name, c_id and c_id[i]{read.near(word, WORDS)}"
        )


@dataclass(frozen=True)
class Thermo:
    """Thermo output of one run."""

    state: DeckState
    window: Window  #: First step of the run, and limits of its ramps
    last: int  #: Last step of the run
    words: tuple[str, ...]
    every: int  #: Interval of output; 0 means the first and last step only

    def due(self, step: int) -> bool:
        """Whether a row is printed at this step: the first, the last, or a multiple of the interval."""
        return step in (self.window.first, self.last) or (self.every > 0 and step % self.every == 0)

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a row is printed."""
        return min((step // self.every + 1) * self.every if self.every > 0 else self.last, self.last)

    def values(self, sample: DeckSample, words: tuple[str, ...] | None = None) -> dict[str, float]:
        """Value of each column (or of each of ``words``), in the deck's units and normalised as in LAMMPS. DeckError if a formula cannot be
        evaluated."""
        moment = Resolver(self.state, sample, self.window)
        result = {}
        for word in self.words if words is None else words:
            with errors_at(self.state.here, f"thermo output {word}: "):
                result[word] = self._value(moment, word)
            if not math.isfinite(result[word]):
                raise located(self.state.here, f"thermo output {word} is {result[word]} at step {sample.step}")
        return result

    @staticmethod
    def _value(moment: Resolver, word: str) -> float:
        if not word.startswith(("c_", "f_", "v_")):
            return moment.thermo(word)
        kind, name, indices = reference(word)
        own = BUILT_IN.get(name) if kind == "c" else None
        if own is not None and not indices:
            # thermo_modify temp and press may replace the compute, also for components of the pressure
            return moment.thermo(own)
        value = moment.pressure_component(indices[0] - 1) if own == "press" else moment.number(word)
        return value / moment.norm if is_extensive(moment.state, word) else value

    # -- text ----------------------------------------------------------------------------------------------------------------
    def header(self) -> str:
        """The line of column titles."""
        titles = [self._title(k, word) for k, word in enumerate(self.words)]
        if self.state.thermo.layout == "multi":
            return ""
        if self.state.thermo.layout == "yaml":
            return f"---\nkeywords: [{''.join(f'{title!r}, ' for title in titles)}]\ndata:"
        return " ".join(f"{title:^{11 if self._is_whole(word) else 14}}" for title, word in zip(titles, self.words, strict=True))

    def footer(self) -> str:
        """The line after the last row; in yaml it separates the documents of several runs."""
        return "..." if self.state.thermo.layout == "yaml" else ""

    def row(self, values: dict[str, float], sample: DeckSample) -> str:
        """The line (or block, for style multi) with the values of one step."""
        numbers = [values[word] for word in self.words]
        if self.state.thermo.layout == "multi":
            return self._block(numbers, sample)
        if self.state.thermo.layout == "yaml":
            return f"  - [{''.join(f'{text}, ' for text in self._texts(numbers))}]"
        return " ".join(self._texts(numbers))

    def _texts(self, numbers: list[float]) -> list[str]:
        return [form % (int(number) if _whole(form) else number) for form, number in zip(self._formats(), numbers, strict=True)]

    @staticmethod
    def _is_whole(word: str) -> bool:
        return word in WORDS and WORDS[word].integer

    def _title(self, k: int, word: str) -> str:
        headers = self.state.thermo.headers
        return headers.get(k + 1, WORDS[word].header if word in WORDS else word)

    def _formats(self) -> list[str]:
        formats = self.state.thermo.formats
        whole, real = _FORMATS[self.state.thermo.layout]
        line, found = formats["line"].split() if "line" in formats else [], []
        for k, word in enumerate(self.words):
            kind, usual = ("int", whole) if self._is_whole(word) else ("float", real)
            found.append(formats.get(k + 1) or formats.get(kind) or (line[k] if line else usual))
        return [re.sub(r"(%[-+ #0-9.]*)l+(?=[dioxXeEfFgG])", r"\1", form) for form in found]

    def _block(self, numbers: list[float], sample: DeckSample) -> str:
        texts = self._texts(numbers)
        cells = [f"{self._title(k, word):<8} = {texts[k]}" for k, word in enumerate(self.words)]
        rows = " \n".join(" ".join(cells[k : k + 3]) for k in range(0, len(cells), 3))
        return f"------------ Step {sample.step:14d} ----- CPU = {sample.cpu:12.7g} (sec) -------------\n{rows}"


def _whole(form: str) -> bool:
    """Whether a format prints a whole number."""
    return _FORMAT.findall(form)[0][-1] in "dioxX"


def check_format(text: str, columns: int | None = None, *, of: str | None = None) -> None:
    """Raise ParameterError unless ``text`` holds one numeric conversion (or one per column), of the kind ``of`` (``int`` or ``float``) if
    given."""
    found = _FORMAT.findall(text)
    if found and of is not None and (found[0][-1] in "dioxX") != (of == "int"):
        raise ParameterError(f"'{text}' is not a format for {of}; expected one such as {'%8d' if of == 'int' else '%12.6f'}")
    if columns is None and len(found) != 1:
        raise ParameterError(f"expected a format such as %12.6f, not '{text}'")
    if columns is not None and len(found) != columns:
        raise ParameterError(f"the format line '{text}' has {len(found)} conversions for {columns} columns")
    if columns is not None and any(len(_FORMAT.findall(word)) != 1 for word in text.split()):
        raise ParameterError(f"the format line '{text}' must have one conversion in each word")
