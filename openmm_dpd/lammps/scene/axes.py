"""Axes of the scene of a deck: a scene is sheared along x with a gradient along y, in whatever plane ``fix deform`` shears the deck."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.geometry import AXES_OF_TENSOR
from ..state.deck_state import DeckState

#: Axes of the scene in the deck, right-handed, by the plane of the shear.
_ROWS = {"xz": [[1, 0, 0], [0, 0, 1], [0, -1, 0]], "yz": [[0, 1, 0], [0, 0, 1], [1, 0, 0]]}


@dataclass(frozen=True)
class Axes:
    """The rotation between a deck and its scene for a shear in a plane: none for xy, where all stays as it is, bit for bit."""

    plane: str = "xy"

    def of_scene(self, values: np.ndarray) -> np.ndarray:
        """Vectors (N, 3) of the deck, in the scene."""
        return values if self.plane == "xy" else values @ np.transpose(_ROWS[self.plane])

    def of_deck(self, values: np.ndarray) -> np.ndarray:
        """Vectors (N, 3) of the scene, in the deck."""
        return values if self.plane == "xy" else values @ np.array(_ROWS[self.plane], float)

    def box_of_scene(self, box: np.ndarray) -> np.ndarray:
        """Box vectors (3, 3) of the deck, in the scene."""
        return box if self.plane == "xy" else self.of_scene(self.of_scene(box).T).T + 0.0

    def box_of_deck(self, box: Any) -> Any:
        """Box vectors (3, 3) of the scene, if there are any, or a tensor, in the deck."""
        return box if self.plane == "xy" or box is None else self.of_deck(self.of_deck(box).swapaxes(-1, -2)).swapaxes(-1, -2) + 0.0

    def tensors_of_deck(self, values: np.ndarray) -> np.ndarray:
        """(..., 6) tensors of the scene, xx, yy, zz, xy, xz, yz, in the deck."""
        if self.plane == "xy":
            return values
        whole = self.box_of_deck(values[..., [[0, 3, 4], [3, 1, 5], [4, 5, 2]]])
        return np.stack([whole[..., a, b] for a, b in AXES_OF_TENSOR], axis=-1)

    def shares_of_deck(self, values: np.ndarray) -> np.ndarray:
        """(N, 7) energies and r F of the scene, or (N, 10) with forces, in the deck."""
        forces = [self.of_deck(values[:, 7:])] if values.shape[1] > 7 else []
        return np.hstack([values[:, :1], self.tensors_of_deck(values[:, 1:7]), *forces])


#: Those of most decks.
SAME = Axes()


def axes_of(state: DeckState) -> Axes:
    """The axes of a deck's scene."""
    return Axes(next((fix.parameters["plane"] for fix in state.fixes_of("deform") if "plane" in fix.parameters), "xy"))
