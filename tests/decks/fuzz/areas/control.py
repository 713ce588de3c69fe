"""Loops, conditions, jumps, runs in pieces with commands in between."""

from ..deck import Deck
from ..draw import Draw
from .interactions import interactions
from .scene import beads, conservative, draw_box, groups, head, movers, thermo, timestep

_TEXTS = ("a", "b", "north", "x_1", "d/e")


def _value(deck: Deck, depth: int) -> str:
    draw = deck.draw
    kind = draw.whole(0, 7 if depth else 5)
    if kind == 6:
        return f"({condition(deck, depth - 1)})"
    if kind == 7:
        return f"!{_value(deck, depth - 1)}"
    return str(draw.pick([draw.whole(-1, 3), draw.real(0, 2), "1e0", ".5", *(f"${{{name}}}" for name in deck.numbers)]))


def condition(deck: Deck, depth: int = 2) -> str:
    """A condition with some operators; now and then it compares strings, or is none."""
    draw = deck.draw
    if draw.chance(0.15):
        return f"{draw.pick(_TEXTS)} {draw.pick(['==', '!='])} {draw.pick([*_TEXTS, *(f'${{{name}}}' for name in deck.texts_of)])}"
    if draw.chance(0.03):
        return draw.pick(["a < b", "1 == a", "a", "", "1 1", "1 = 1", "1 + 1", "!a", "1 &&", "(1", "a.b == a"])
    text = _value(deck, depth)
    for _ in range(draw.whole(0, 2)):
        blank = draw.pick([" ", " ", ""])
        # a minus right behind an operator belongs to the number
        text += f"{blank}{draw.pick(['==', '!=', '<', '<=', '>', '>=', '&&', '||', '|^'])}{blank}{_value(deck, depth)}"
    return text


class _Script(Deck):
    """A deck that knows its variables."""

    numbers: list[str]
    texts_of: list[str]

    def say(self, text: str) -> str:
        return f"print '{text}' append values.txt screen no"

    def command(self, depth: int) -> str:
        """A command for the inside of another one, without double quotes."""
        shown = [f"${{{name}}}" for name in [*self.numbers, *self.texts_of]]
        name = self.draw.pick(["q1", "q2"])
        if self.draw.chance(0.3):
            return f"variable {name} equal {self.draw.whole(0, 9)}"
        return self.say(" ".join(self.draw.some([*shown, "said", "$(step)"], 1, 3)))

    def branch(self) -> None:
        """An if command."""
        draw, words = self.draw, [f'if "{condition(self)}" then']
        words += [f'"{self.command(1)}"' for _ in range(draw.whole(1, 2))]
        for _ in range(draw.choices([0, 1, 2], [6, 2, 1])[0]):
            words += [f'elif "{condition(self)}"', *(f'"{self.command(1)}"' for _ in range(draw.whole(1, 2)))]
        if draw.chance(0.5):
            words += ["else", f'"{self.command(1)}"']
        self.lines.append(" ".join(words))

    def loop(self, depth: int) -> None:
        """A loop over one variable or two, perhaps left early, perhaps with another one inside."""
        draw, names = self.draw, [self.name("i")]
        style = draw.pick(["loop", "loop", "index"])
        if draw.chance(0.2):
            names.append(self.name("i"))
        for name in names:
            if style == "index":
                self.add("variable", name, "index", *draw.some([*_TEXTS, "1", "2.5"], 1, 4))
                self.texts_of.append(name)
            else:
                ends = draw.pick([[draw.whole(1, 4)], [draw.whole(0, 2), draw.whole(2, 4)], [draw.whole(8, 9), draw.whole(9, 11)]])
                self.add("variable", name, "loop", *ends, *draw.pick([[], [], ["pad"]]))
                self.numbers.append(name)
        label = self.name("here")
        self.add("label", label)
        for _ in range(draw.whole(1, 3)):
            self.act(depth)
        if draw.chance(0.3):
            self.lines.append(f'if "{condition(self)}" then "jump SELF {label}_out"')
        self.add("next", *names)
        self.add("jump", "SELF", label)
        self.add("label", f"{label}_out")
        for name in names:  # those that have come to an end are gone
            (self.texts_of if name in self.texts_of else self.numbers).remove(name)
            self.add("variable", name, "delete")

    def act(self, depth: int) -> None:
        """One thing."""
        draw = self.draw
        kind = draw.whole(0, 5)
        if kind == 0 and depth:
            self.loop(depth - 1)
        elif kind in (1, 2):
            self.branch()
        elif kind == 3 and depth == 2:
            steps, every = draw.whole(0, 5), draw.whole(1, 3)
            commands = ["NULL"] if draw.chance(0.3) else [f'"{self.command(1)}"' for _ in range(draw.whole(1, 2))]
            self.run(steps, *draw.pick([[], [], ["start", 0, "stop", 99]]), "every", every, *commands)
        elif kind == 4 and depth:
            name = self.name("f")
            self.add("variable", f"{name}v", "equal", f"{draw.real(0, 9)}/7")
            self.add("variable", name, "format", f"{name}v", draw.pick(["%.3f", "%08.2f", "%.4g", "%-10.2e"]))
            self.lines.append(self.say(f"[${{{name}}}]"))
        else:
            self.lines.append(self.command(depth))


def control(draw: Draw) -> Deck:
    """A deck whose lines are not carried out one after the other."""
    deck = _Script(draw)
    deck.numbers, deck.texts_of = [], []
    head(deck, "atomic", ("lj",))
    draw_box(deck)
    beads(deck, draw.whole(2, 8), 0.4)
    interactions(deck, ["dpd"])
    groups(deck)
    movers(deck)
    timestep(deck)
    deck.add("variable", "q1", "equal", 1)
    deck.add("variable", "q2", "equal", 2)
    deck.numbers += ["q1", "q2"]
    thermo(deck, every=draw.pick([1, 2]), most=4)
    conservative(deck)
    for _ in range(draw.whole(2, 6)):
        deck.act(2)
    return deck.run(draw.whole(0, 2))
