"""Random choices of which a deck is made."""

import random
from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")

SPELLED = 0.02  # One number in so many is spelled in another way than the shortest.


class Draw(random.Random):
    """A random generator with the choices that grammars need."""

    def chance(self, probability: float) -> bool:
        """True with this probability."""
        return self.random() < probability

    def pick(self, values: Sequence[T]) -> T:
        """One of the values."""
        return self.choice(list(values))

    def some(self, values: Sequence[T], low: int = 0, high: int | None = None) -> list[T]:
        """Between ``low`` and ``high`` of the values (all by default), in random order."""
        values = list(values)
        most = len(values) if high is None else min(high, len(values))
        return self.sample(values, self.randint(min(low, most), most))

    def whole(self, low: int, high: int) -> int:
        """A whole number, both ends included."""
        return self.randint(low, high)

    def real(self, low: float, high: float, nice: float = 0.5) -> float:
        """A number: with probability ``nice`` one with two digits, which falls on faces and lattice points, otherwise one with many."""
        value = self.uniform(low, high)
        if not self.chance(nice):
            return float(f"{value:.9g}")
        quarter = round(value * 4) / 4
        rounded = quarter if low <= quarter <= high and self.chance(0.7) else float(f"{value:.2g}")
        return rounded if low <= rounded <= high else value

    def seed_word(self) -> int:
        """A seed for a generator of the deck."""
        return self.randint(1, 900_000)

    def word(self, value: object) -> str:
        """Text of a word of a deck; now and then a number has another spelling, or one that is no number."""
        if not isinstance(value, float):
            return str(value)
        text = f"{value:.15g}"
        if not self.chance(SPELLED):
            return text
        short, full = text[text.startswith("0.") :], text + "." * ("." not in text and "e" not in text)
        return self.pick([f"{value:.15e}", f"{value:+.15g}", f"{value:.17f}", short, full])


_SPOILED = "{}_0 1_{} {}e {}d0 0x{} ٣ １ {}f --{} {}.{}.{} inf nan -{} 1e400 {}.5 0 {}L"
#: What becomes of a number in the area of mistakes: none of these is one, or it is a number that is out of bounds.
SPOILED = (*_SPOILED.split(" "), "{} {}", "")
