"""The reference suite as it is shipped: decks with start states in ``scenes/``, reference values in ``suite.json``.

``suite.schema.json`` describes the file.  Its values are those of two programs, this package and LAMMPS, as the step goes to 0.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import ParameterError
from ..lammps import deck_scene
from ..model.scene import Scene

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class SuiteScene:
    """A scene of the suite.

    Attributes
    ----------
    name : its deck is ``scenes/in.NAME``
    about : what it is
    step : about the step at which velocity Verlet is 1 % off
    quantities : names in :data:`.QUANTITIES`
    reference, scale : (Q,) values as the step goes to 0, and what errors are relative to: the value itself, kT for temperatures, the
        temperature that would change a potential energy so
    covariance : (Q, Q) of ``reference``
    scores : by method, what was found when the suite was made
    """

    name: str
    about: str
    step: float
    quantities: tuple[str, ...]
    reference: np.ndarray
    scale: np.ndarray
    covariance: np.ndarray
    scores: dict[str, Any]

    @cached_property
    def deck(self) -> Path:
        """The deck, which LAMMPS runs as it is."""
        return FOLDER / "scenes" / f"in.{self.name}"

    @cached_property
    def scene(self) -> Scene:
        """The scene that the deck describes, in its start state."""
        return deck_scene(self.deck)


def load_suite(path: str | Path = FOLDER / "suite.json") -> dict[str, SuiteScene]:
    """All scenes of the suite by name.

    Raises
    ------
    ParameterError
        If the file is not one of a suite.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
        return {
            name: SuiteScene(
                name=name,
                about=entry["about"],
                step=entry["step"],
                quantities=tuple(entry["quantities"]),
                reference=np.array([its["value"] for its in entry["quantities"].values()]),
                scale=np.array([its["scale"] for its in entry["quantities"].values()]),
                covariance=np.array(entry["covariance"]),
                scores=entry["scores"],
            )
            for name, entry in data["scenes"].items()
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ParameterError(f"{path} is no file of a reference suite: {error!r}") from None
