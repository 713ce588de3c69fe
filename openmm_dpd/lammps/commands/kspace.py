"""Commands about charges: kspace_style, kspace_modify, dielectric."""

from dataclasses import replace

from ...errors import ParameterError
from ..language import arguments as read
from ..state.deck_state import DeckState
from ..state.records import KspaceSetup
from .setup import by_name, remembered

#: Styles of kspace_style: all of them mean OpenMM's PME here.
KSPACE_STYLES = ("ewald", "pppm", "pppm/cg")

#: Keywords of kspace_modify that say how LAMMPS computes the sum, and their numbers of values.
_MANNERS = dict.fromkeys("collective diff fftbench minorder mix/disp order overlap pressure/scalar cutoff/adjust".split(), 1)
_MANNERS["kmax/ewald"] = 3


def kspace_style(state: DeckState, args: list[str]) -> None:
    """``kspace_style ewald|pppm accuracy``, or ``none``: the lattice sum is OpenMM's PME, to that accuracy."""
    read.count(args, "kspace_style style accuracy", 1, 2)
    if args[0] == "none":
        read.count(args, "kspace_style none", 1)
        state.kspace = None
        return
    read.choice(args[0], "the style of kspace_style", ("none", *KSPACE_STYLES))
    read.count(args, f"kspace_style {args[0]} accuracy", 2)
    accuracy = read.positive(args[1], "the accuracy of kspace_style")
    if not 1e-10 <= accuracy <= 0.1:
        raise ParameterError(f"the accuracy of kspace_style must be between 1e-10 and 0.1, not {args[1]}")
    old = state.kspace or KspaceSetup()
    state.kspace = replace(old, accuracy=accuracy, where=state.here)


def kspace_modify(state: DeckState, args: list[str]) -> None:
    """``kspace_modify gewald|mesh ...``; what would change the sum (``slab``, ``compute no``, ...) is an error."""
    if state.kspace is None:
        raise ParameterError("kspace_modify needs a kspace_style before it")
    sizes = {"gewald": 1, "mesh": 3, "compute": 1, "slab": 1, "force": 1, **_MANNERS}
    for keyword, values in read.options(args, sizes, "kspace_modify"):
        if keyword == "gewald":
            g = read.non_negative(values[0], "gewald")
            state.kspace = replace(state.kspace, gewald=g / state.units.length if g else None)
        elif keyword == "mesh":
            mesh = tuple(read.integer(word, "the mesh", 0) for word in values)
            if any(mesh) and min(mesh) < 6:
                raise ParameterError(f"kspace_modify mesh needs at least 6 points along each axis, not {' '.join(values)}")
            state.kspace = replace(state.kspace, mesh=mesh if any(mesh) else None)
        elif keyword == "compute":
            if not read.switch(values[0], "compute"):
                raise ParameterError("kspace_modify compute no is not supported: the real-space part alone is no physical interaction")
        elif keyword == "slab":
            raise ParameterError("kspace_modify slab is not supported: charges repeat in all three dimensions here")
        elif keyword == "force":
            raise ParameterError("kspace_modify force is not supported: the accuracy here is relative, that of kspace_style")
        else:
            state.note(f"kspace_modify {keyword} has no meaning here and is ignored: the sum is OpenMM's PME")


def dielectric(state: DeckState, args: list[str]) -> None:
    """``dielectric value``: the Coulomb constant of the unit style is divided by it."""
    read.count(args, "dielectric value", 1)
    state.dielectric = read.positive(args[0], "the dielectric constant")


COMMANDS = remembered(by_name(kspace_style, kspace_modify, dielectric))
