"""What decks are made of: one file per area of commands, each with a function from a Draw to a Deck."""

from collections.abc import Callable

from ..deck import Deck
from ..draw import Draw
from .averages import averages
from .bodies import bodies
from .bonded import bonded
from .charges import charges
from .control import control
from .data import data
from .flow import flow
from .formulas import formulas
from .meso import meso
from .minimizing import minimizing
from .mistakes import mistakes
from .moving import moving
from .output import output
from .pairs import pairs
from .published import published
from .reacting import reacting
from .restarts import restarts
from .runs import runs
from .setup import setup
from .shear import shear
from .streaming import streaming
from .thermostats import thermostats

AREAS: dict[str, tuple[float, Callable[[Draw], Deck]]] = {  # Areas by name: weight, grammar.
    "setup": (4.0, setup),
    "formulas": (1.5, formulas),
    "averages": (2.5, averages),
    "pairs": (2.0, pairs),
    "bonded": (1.5, bonded),
    "bodies": (0.5, bodies),
    "reacting": (0.5, reacting),
    "meso": (1.0, meso),
    "charges": (0.5, charges),
    "flow": (1.0, flow),
    "thermostats": (0.5, thermostats),
    "runs": (2.0, runs),
    "control": (1.5, control),
    "moving": (1.5, moving),
    "data": (1.0, data),
    "output": (1.0, output),
    "minimizing": (0.5, minimizing),
    "restarts": (0.5, restarts),
    "shear": (0.1, shear),
    "streaming": (1.0, streaming),
    "published": (1.0, published),
    "mistakes": (2.0, mistakes),
}
