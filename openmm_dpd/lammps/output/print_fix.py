"""``fix print``: a line of text every so many steps."""

from ..language import arguments as read
from ..state.deck_state import DeckState
from ..values.resolver import Resolver
from .averages import AverageFile
from .thermo import fields_of_text


class PrintFix:
    """``fix print``: prints its text with the values of the step, also at the first step of a run."""

    def __init__(self, every: int, text: str, show: bool, file: AverageFile):
        self.every, self.text, self._show, self._file = every, text, show, file
        self.next_due = 0

    def needs(self, state: DeckState) -> frozenset[str]:
        """Fields of DeckSample that the text reads."""
        return fields_of_text(state, self.text)

    def begin(self, state: DeckState, step: int) -> None:
        """Prepare for a run from ``step`` on."""
        self.next_due = -(-step // self.every) * self.every

    def take(self, moment: Resolver) -> None:
        """Print; the moment is that of a step at which it is due."""
        text = moment.substituted(self.text)
        if self._show:
            moment.state.log(text)
        self._file.write(moment.state, [text])
        self.next_due += self.every


def parse_print(state: DeckState, group: str, args: list[str]) -> PrintFix:
    """PrintFix of ``fix ID group print N text [file|append name] [screen yes|no] [title text]``."""
    read.count(args, "fix ID group print N text ...", 2, None)
    every = read.integer(args[0], "the interval of fix print", 1)
    options = dict(read.options(args[2:], {"file": 1, "append": 1, "screen": 1, "title": 1}, "fix print"))
    assert state.here is not None
    title = options.get("title", [f"# Fix print output for fix {state.here.text.split()[1]}"])
    return PrintFix(every, args[1], read.switch(options.get("screen", ["yes"])[0], "screen"), AverageFile(state, options, title))
