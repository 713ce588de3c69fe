"""Whether two programs wrote the same: text word by word, numbers to an accuracy."""

import re

#: Both sides compute in double precision and sum in different orders; conversions of units cost a few digits, and steps multiply what is
#: lost by the stiffness of the forces.
DOUBLE = 1e-9

#: What is 0 up to rounding, beside a thousandth of the accuracy: sums of numbers of order 1 (all sizes in the decks are, in the natural units of their unit style) that cancel.
FLOOR = 1e-11

#: LAMMPS interpolates tables; its lattice sums approach those here as the accuracy of kspace_style goes down to 1e-8, at 1e-7 to this.
TABULATED, LATTICE_SUM = 2e-3, 6e-3

#: Formulas of fix addforce see positions that are rounded to 2^-20 nm, some 1e-6 of a natural length: what follows from them, and, in
#: natural units of force, the forces themselves, which may be the small difference of a push and of something else.
ROUNDED_POSITIONS, ROUNDED_FORCES = 1e-5, 1e-5

_FORCES = re.compile(r"f[xyz]|Fmax|Fnorm|f_(push|put|hold)\d*\[\d\]")

_TIME = re.compile(r"CPU =\s*\S+")


def _number(word: str) -> float | None:
    try:
        return float(word)
    except ValueError:
        return None


def _words(text: str) -> list[list[str]]:
    """Words of the lines that are not empty; brackets and commas of yaml are no part of them."""
    found = []
    for line in text.splitlines():
        words = _TIME.sub("CPU", line)
        if words.lstrip().startswith(("- [", "keywords: [")):
            words = re.sub(r"[\[\],]", " ", words)
        if words.strip():
            found.append(words.split())
    return found


def _scales(rows: list[list[str]]) -> list[list[float]]:
    """Largest number of each column, for each row: over the block of rows with as many words, all of them numbers."""
    scales: list[list[float]] = []
    block: list[list[float]] = []

    def close() -> None:
        most = [max(column) for column in zip(*block, strict=True)]
        scales.extend(most for _ in block)
        block.clear()

    for row in rows:
        values = [abs(value) if (value := _number(word)) is not None and value == value else 0.0 for word in row]
        if block and len(block[0]) != len(values):
            close()
        block.append(values)
    if block:
        close()
    return scales


def differences(lammps: str, ours: str, accuracy: float = 0.0, most: int = 4, *, of_forces: float = 0.0) -> list[str]:
    """Where two texts differ, in words: the first of each column, and no more than ``most``; empty if they agree.

    Numbers agree to ``accuracy``, those in columns of forces also if they differ by no more than ``of_forces``.
    """
    left, right = _words(lammps), _words(ours)
    accuracy = max(accuracy, DOUBLE)
    _settle_faces(left, right)
    found: dict[object, str] = {}
    for number, (a, b, scales) in enumerate(zip(left, right, _scales(left), strict=False), start=1):
        if len(a) != len(b):
            found[number] = f"line {number}: {' '.join(a)!r} (LAMMPS) has {len(a)} words, {' '.join(b)!r} (ours) {len(b)}"
            break
        for k, (one, other, scale) in enumerate(zip(a, b, scales, strict=True)):
            if not _agree(one, other, scale, accuracy):
                title = _title(left, number - 1, k)
                if _FORCES.fullmatch(title[2:-1]) and abs(float(one) - float(other)) <= of_forces:
                    continue
                found.setdefault((len(a), k), f"line {number}, word {k + 1}{title}: {one} (LAMMPS) {other} (ours)")
    if len(left) != len(right):
        rest = (left if len(left) > len(right) else right)[min(len(left), len(right))]
        found[0] = f"{len(left)} lines (LAMMPS) and {len(right)} lines (ours); the first too many is {' '.join(rest)!r}"
    return list(found.values())[:most]


def _agree(one: str, other: str, scale: float, accuracy: float) -> bool:
    """Whether two words are the same text, or the same number."""
    x, y = _number(one), _number(other)
    if one == other or x is None or y is None:
        return one == other
    return abs(x - y) <= accuracy * (scale + 1e-3) + FLOOR or x == y or (x != x and y != y)


def _title(rows: list[list[str]], row: int, column: int) -> str:
    for above in reversed(rows[:row]):
        words = above[2:] if above[0] == "ITEM:" else above[1:] if above[0] == "#" else above
        if len(words) == len(rows[row]) and column < len(words) and any(_number(word) is None for word in words):
            return f" ({words[column]})"
    return ""


_FACES = ("x", "y", "z", "xs", "ys", "zs", "ix", "iy", "iz")


def _settle_faces(left: list[list[str]], right: list[list[str]]) -> None:
    """Beads a rounding error off a face of the box may be at either end of it: take LAMMPS's end for both, where the rest agrees."""
    titles: list[str] = []
    for a, b in zip(left, right, strict=False):
        if a[:2] == ["ITEM:", "ATOMS"]:
            titles = a[2:]
        elif len(a) == len(b) == len(titles) and a != b and {"ix", "iy", "iz", "xs", "ys", "zs", "xu", "yu", "zu"} <= set(titles):
            at = {title: k for k, title in enumerate(titles)}
            moved = [axis for axis in "xyz" if a[at[f"i{axis}"]] != b[at[f"i{axis}"]]]
            if moved and all(_at_face(a[at[f"{axis}s"]]) and _at_face(b[at[f"{axis}s"]]) for axis in moved):
                for title in set(_FACES) & set(titles):
                    b[at[title]] = a[at[title]]


def _at_face(word: str) -> bool:
    value = _number(word)
    return value is not None and min(abs(value), abs(1 - value)) < 1e-9
