"""Thermo output: which columns, when, their values and how they are printed."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from ...base.errors import ParameterError
from ..language import arguments as read
from ..language.lexer import errors_at, located, substitute
from ..language.variables import FORMULAS
from ..state.deck_state import DeckState
from ..state.moment import Window
from ..state.records import VECTOR_FIXES, DeckSample
from ..values.compute_spec import reference
from ..values.computes import BUILT_IN, COMPUTES, average_of, check_value, is_extensive
from ..values.per_bead import PROPERTIES
from ..values.resolver import Resolver
from ..values.words import WORDS

#: Columns of the styles that are not ``custom``.
STYLES = {
    "one": ("step", "temp", "epair", "emol", "etotal", "press"),
    "multi": ("etotal", "ke", "temp", "pe", "ebond", "eangle", "edihed", "eimp", "evdwl", "ecoul", "elong", "press"),
    "yaml": ("step", "temp", "ke", "pe", "ebond", "eangle", "edihed", "eimp", "evdwl", "ecoul", "elong", "press"),
}

#: Formats of whole numbers and of others, by layout.
_FORMATS = {"one": ("%10d", "%-14.8g"), "multi": ("%14d", "%14.4f"), "yaml": ("%d", "%.15g")}
#: Averages that are wanted whether or not the deck prints them.
ALWAYS = ("temp", "press", "press_full", "pe", "ke", "etotal", "temp_conf")
_REFERENCE = re.compile(r"[cfv]_\w+(?:\[\d+\])?|[A-Za-z_]\w*", re.ASCII)
_FORMAT = re.compile(r"%[-+ #0-9.]*l{0,2}[dioxXeEfFgG]")


def check_word(state: DeckState, word: str) -> None:
    """Raise ParameterError unless ``word`` can be a column of thermo output."""
    if word.startswith("v_"):
        variable = state.variables.get(word[2:])
        if variable.style != "equal":
            raise ParameterError(f"{word}: variable {word[2:]} is {variable.style}-style; only equal-style ones can be printed")
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


def _needs(state: DeckState, word: str, seen: set[str]) -> set[str]:
    """Fields of DeckSample that a word reads, through variables and computes."""
    if word in seen:
        return set()
    seen.add(word)
    if word.startswith("v_"):
        if word[2:] not in state.variables:
            return set()
        variable = state.variables.get(word[2:])
        return _formula_needs(state, variable.text, seen) if variable.style in FORMULAS else set()
    if word.startswith("c_"):
        name = reference(word).name
        indexed = bool(reference(word).indices)
        if name in BUILT_IN:
            # the six values of both come with the pressure tensor
            return _needs(state, "pxx" if indexed else BUILT_IN[name], seen)
        if name not in state.computes:
            return set()
        compute = state.computes[name]
        spec = COMPUTES[compute.style]
        own = spec.vector_needs if indexed and spec.vector_needs is not None else spec.needs
        return set(own).union(*(_needs(state, other, seen) for other in spec.inputs(compute)))
    if word.startswith("f_"):
        fix = state.fixes.get(reference(word).name)
        return {"before"} if fix is not None and fix.style in VECTOR_FIXES else set()
    if word in PROPERTIES and word not in WORDS:
        return set(PROPERTIES[word].needs)
    found = set(WORDS[word].needs) if word in WORDS else set()
    # a temperature taken from a compute on a group needs the velocities of its beads
    if found & {"kinetic", "virial_tensor"} and (state.thermo.temp != "thermo_temp" or state.pressure_temps):
        found.add("velocities")
    if state.thermo.press != "thermo_press":
        if "virial" in found:
            found |= _needs(state, "c_" + state.thermo.press, seen)
        if "virial_tensor" in found:
            found |= _needs(state, f"c_{state.thermo.press}[1]", seen)
    return found


def _formula_needs(state: DeckState, text: str, seen: set[str]) -> set[str]:
    """The same of a formula."""
    found: set[str] = set()
    if re.search(r"\b(xcm|bound|count\([^)]*,)", text):
        found.add("positions")
    if re.search(r"\b(vcm|ke\()", text):
        found.add("velocities")
    return found.union(*(_needs(state, name, seen) for name in _REFERENCE.findall(text)))


def fields_of_text(state: DeckState, text: str) -> frozenset[str]:
    """Fields of :class:`DeckSample` that the substitutions in a text read."""
    formulas: list[str] = []
    substitute(text, lambda name: formulas.append(f"v_{name}") or "", lambda formula: formulas.append(formula) or 0.0)  # type: ignore[func-returns-value]
    seen: set[str] = set()
    return frozenset().union(*(_formula_needs(state, formula, seen) for formula in formulas))


def fields_read(state: DeckState, words: Iterable[str]) -> frozenset[str]:
    """Fields of :class:`DeckSample` that words read: thermo words, ``c_``, ``v_``, and values of single beads."""
    seen: set[str] = set()
    return frozenset().union(*(_needs(state, word, seen) for word in words))


@dataclass(frozen=True)
class Thermo:
    """Thermo output of one run."""

    state: DeckState
    window: Window  #: First step and limits of the ramps of the run
    last: int  #: Last step of the run
    words: tuple[str, ...]
    every: int  #: Interval of output; 0 means the first and last step only

    @property
    def needs(self) -> frozenset[str]:
        """Fields of :class:`DeckSample` that the columns read."""
        return fields_read(self.state, self.words)

    def due(self, step: int) -> bool:
        """Whether a row is printed at this step: first, last, and every multiple of the interval."""
        return step in (self.window.first, self.last) or (self.every > 0 and step % self.every == 0)

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a row is printed."""
        return min((step // self.every + 1) * self.every if self.every > 0 else self.last, self.last)

    def values(self, sample: DeckSample, words: tuple[str, ...] | None = None) -> dict[str, float]:
        """Value of each column (or of each of ``words``), in the deck's units and normalised as LAMMPS prints it.  DeckError if a formula
        cannot be evaluated."""
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
            # it may stand for another compute (thermo_modify temp and press); so do components of the pressure
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
            return f"---\nkeywords: [{', '.join(repr(title) for title in titles)}]\ndata:"
        return " ".join(title.center(width) for title, width in zip(titles, self._widths(), strict=True)).rstrip()

    def footer(self) -> str:
        """The line behind the last row: yaml needs one to separate the documents of several runs."""
        return "..." if self.state.thermo.layout == "yaml" else ""

    def row(self, values: dict[str, float], sample: DeckSample) -> str:
        """The line (or block, for style multi) with the values of one step."""
        numbers = [values[word] for word in self.words]
        if self.state.thermo.layout == "multi":
            return self._block(numbers, sample)
        if self.state.thermo.layout == "yaml":
            return f"  - [{', '.join(self._texts(numbers))}]"
        cells = []
        for form, text, width in zip(self._formats(), self._texts(numbers), self._widths(), strict=True):
            cells.append(text.ljust(width) if "-" in form else text.rjust(width))
        return " ".join(cells).rstrip()

    def _texts(self, numbers: list[float]) -> list[str]:
        return [form % (int(number) if _whole(form) else number) for form, number in zip(self._formats(), numbers, strict=True)]

    def _widths(self) -> list[int]:
        return [max(len(form % 0), len(self._title(k, self.words[k]))) for k, form in enumerate(self._formats())]

    def _title(self, k: int, word: str) -> str:
        headers = self.state.thermo.headers
        return headers.get(k + 1, headers.get(word, WORDS[word].header if word in WORDS else word))

    def _formats(self) -> list[str]:
        formats = self.state.thermo.formats
        whole, real = _FORMATS[self.state.thermo.layout]
        line, found = formats["line"].split() if "line" in formats else [], []
        for k, word in enumerate(self.words):
            kind, usual = ("int", whole) if word in WORDS and WORDS[word].integer else ("float", real)
            found.append(formats.get(k + 1) or formats.get(word) or formats.get(kind) or (line[k] if line else usual))
        return [re.sub(r"(%[-+ #0-9.]*)l+(?=[dioxXeEfFgG])", r"\1", form) for form in found]

    def _block(self, numbers: list[float], sample: DeckSample) -> str:
        texts = self._texts(numbers)
        cells = [f"{self._title(k, word):<8} = {texts[k]}" for k, word in enumerate(self.words)]
        rows = [" ".join(cells[k : k + 3]) for k in range(0, len(cells), 3)]
        return "\n".join([f"------------ Step {sample.step:14d} ----- CPU = {sample.cpu:12.7g} (sec) -------------", *rows])


def _whole(form: str) -> bool:
    """Whether a format is one of whole numbers."""
    return _FORMAT.findall(form)[0][-1] in "dioxX"


def check_format(text: str, columns: int | None = None, *, of: str | None = None) -> None:
    """Raise ParameterError unless ``text`` holds one numeric conversion (or one per column), ``of`` an int or a float if it says so."""
    found = _FORMAT.findall(text)
    if found and of is not None and (found[0][-1] in "dioxX") != (of == "int"):
        raise ParameterError(f"'{text}' prints no {of}; expected one such as {'%8d' if of == 'int' else '%12.6f'}")
    if columns is None and len(found) != 1:
        raise ParameterError(f"expected a format such as %12.6f, not '{text}'")
    if columns is not None and len(found) != columns:
        raise ParameterError(f"the format line '{text}' has {len(found)} conversions for {columns} columns")
    if columns is not None and any(len(_FORMAT.findall(word)) != 1 for word in text.split()):
        raise ParameterError(f"the format line '{text}' must have one conversion in each word")
