"""Data files in an order of their own, so that two programs' files can be compared line by line.

Coefficients are left out: LAMMPS writes six digits of them.  Both files are read by both programs, and the forces compared.
"""

_SORTED, _JOINED = ("Atoms", "Velocities"), ("Bonds", "Angles", "Dihedrals", "Impropers")  # Sections whose lines have no order.


def in_order(text: str) -> str:
    """The text of a data file without its title, with the lines of beads and of what joins them in the order of their numbers."""
    lines = [line.split("#")[0].split() if not line[:1].isalpha() else line.split() for line in text.splitlines()[1:]]
    blocks: list[list[list[str]]] = [[]]
    for words in lines:
        if words and words[0][:1].isalpha():
            blocks.append([words])
        elif words:
            blocks[-1].append(words)
    result: list[str] = []
    for block in blocks:
        head, body = (block[:1], block[1:]) if block and block[0][0][:1].isalpha() else ([], block)
        name = head[0][0] if head else ""
        if head and "Coeffs" in head[0]:
            continue
        if name in _JOINED:
            body = sorted(words[1:] if name == "Impropers" else _symmetric(words) for words in body)
        elif name in _SORTED:
            body = sorted(body, key=lambda words: int(words[0]))
        result += [" ".join(words) for words in [*head, *body]]
    return "\n".join(result)


def _symmetric(words: list[str]) -> list[str]:
    """A bond, angle or dihedral without its number, from the end with the lower bead on."""
    kind, *beads = words[1:]
    return [kind, *min(beads, beads[::-1], key=lambda found: [int(word) for word in found])]
