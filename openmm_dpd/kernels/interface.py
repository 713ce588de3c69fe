"""The interface of engines, which loops over steps, the pair force, fields and measurements use."""

from typing import Any, Protocol

import numpy as np

from .columns import Totals
from .layer import PairSpec


class Engine(Protocol):
    """Evaluates the pair terms of a :class:`.layer.PairSpec`, and its ``extras``.

    An engine belongs to one thread at a time, and holds nothing that could not be recomputed.  Arrays are numpy arrays, (N, 3) float64
    unless another shape is given.  Engines inherit from this class and implement the methods from :meth:`holds` to :meth:`tensors`.
    """

    spec: PairSpec
    number: int  #: Counts placed positions: what was computed is valid while this number stays the same
    body_scale: float  #: Factor of forces on single beads
    rates: np.ndarray  #: (N, K) rates of change of the fields from the last call of :meth:`sums`
    increments: np.ndarray  #: (N, K) changes of the fields from the last call of :meth:`swept`
    bodies: Any = None  #: What moves rigid bodies, a :class:`.bodies.Bodies`, if there are any

    def holds(self, x: np.ndarray, box: np.ndarray | None) -> bool:
        """Whether x and the box are those that are kept."""
        ...

    def place(self, x: np.ndarray, box: np.ndarray | None) -> None:
        """Place the positions x: list their pairs.  The arrays stay the caller's, who places them again after changing them."""
        ...

    def keep(self) -> None:
        """Remember the positions that were placed last, and have not changed since."""
        ...

    def resume(self, x: np.ndarray, box: np.ndarray | None) -> None:
        """Go on with the arrays x and box, which equal those that are kept, as if they had just been placed."""
        ...

    def sums(
        self,
        which: int,
        v: np.ndarray | None,
        kT: float,
        dt: float,
        seed: int,
        counter: int,
        field_values: np.ndarray | None = None,
        out: np.ndarray | None = None,
        held: np.ndarray | None = None,
    ) -> Totals:
        """Forces (N, 3) of the chosen terms at the placed positions, written to ``out`` if that is given, and sums over these terms.

        The other arguments are those of :class:`.layer.Call`; v is what the friction sees.  The energy is that of all conservative forces;
        virials are those of pair terms alone, with the tensor if ``which`` has STRESS, and so is the Laplacian.  Engines that
        :attr:`parts_forces`, and no others, are given ``held``: where conservative forces go too, and which are summed apart then.
        """
        ...

    def renew(self) -> None:
        """Notice that coefficients in the tables of the spec have changed."""
        raise NotImplementedError

    def another(self) -> "Engine":
        """A new engine for the same pair terms; only where it repeats."""
        raise NotImplementedError

    @property
    def repeats(self) -> bool:
        """Whether compiled kernels do all the work of a step on arrays that stay in place, so that it can be played again."""
        return False

    def tables(self, layer: int, heats: np.ndarray) -> dict[str, np.ndarray] | None:
        """What kernels of a layer get at S thermal energies, by name: ``coefficients`` (S, ...) and ``kT`` (S,).  None if more depends on
        these than noise and coefficients; only where it repeats."""
        raise NotImplementedError

    def sorted_beads(self) -> np.ndarray:
        """(N,) numbers of all beads, cell by cell, at the positions that were placed last; only where it repeats."""
        raise NotImplementedError

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        """Expect the rows of all arrays in another order from now on; only where it repeats.  ``names`` (N,) has the number of the bead in
        each row, ``places`` (N,) the row of each bead."""
        raise NotImplementedError

    @property
    def parts_forces(self) -> bool:
        """Whether :meth:`sums` can write conservative forces to an array of their own."""
        return False

    def swept(
        self,
        v: np.ndarray,
        kT: float,
        dt: float,
        seed: int,
        counter: int,
        field_values: np.ndarray | None = None,
        out: np.ndarray | None = None,
        update: int | None = None,
    ) -> np.ndarray:
        """Velocities (N, 3) after one sweep of pair updates at the placed positions, written to ``out`` (v, say) if that is given.

        ``update`` is EXACT or SHARDLOW, None for that of the spec.
        """
        ...

    def set_flow(self, flow: np.ndarray) -> None:
        """Expect velocities relative to the flow of a Lees-Edwards shear, along x and growing with y.  The first number of the array is the
        rate; it is read when it is needed."""
        raise NotImplementedError

    def passed(self) -> np.ndarray:
        """(6,) sum of r J over the pairs of the last sweep in a shear, J the impulse that friction along their line has given them."""
        raise NotImplementedError

    def set_bonds(self, beads: list[np.ndarray], exceptions: Any = None, types: np.ndarray | None = None) -> None:
        """Have these bonds (B, 2) act, of each of the ``sorts`` that form and break; there are none at first.  Exceptions, and types (N,),
        if given, take the place of those of the spec."""
        raise NotImplementedError

    def densities(self, layer: int) -> np.ndarray:
        """(N,) local densities at the placed positions, of a layer that has them."""
        raise NotImplementedError

    @property
    def repels_by_pairs(self) -> bool:
        """Whether the first sum of :meth:`tensors` has all conservative pair terms."""
        return False

    def tensors(self, v: np.ndarray, kT: float) -> tuple[np.ndarray, np.ndarray, float]:
        """Sums over pairs at the prepared positions: (6,) of r F of the repulsion A w; (6,) of r F of the friction along the lines between
        beads, at velocities (N, 3); and of f gamma w^(2s) r^2, a fifteenth of which is the mean stress of an affine shear at rate 1."""
        raise NotImplementedError

    def prepare(self, x: np.ndarray, box: np.ndarray | None) -> bool:
        """Place and keep the positions x; False, and nothing is done, if they are kept already."""
        if self.holds(x, box):
            return False
        self.place(x, box)
        self.keep()
        return True

    def forces(self, which, v, kT, dt, seed, counter, field_values=None, out: np.ndarray | None = None) -> tuple[float, np.ndarray, float]:
        """Energy, forces (N, 3) and virial of the chosen terms; the arguments are those of :meth:`sums`."""
        force = np.empty((len(self.spec.types), 3)) if out is None else out
        found = self.sums(which, v, kT, dt, seed, counter, field_values, force)
        return found.energy, force, found.virial

    def sweep(self, v: np.ndarray, *conditions) -> np.ndarray:
        """Change of the velocities (N, 3) by one sweep of pair updates; the arguments are those of :meth:`swept`."""
        swept = self.swept(v, *conditions)
        swept -= self.seen(v)
        return swept

    def seen(self, v: np.ndarray) -> np.ndarray:
        """Velocities as friction sees them: immobile beads have their prescribed ones."""
        return v if self.spec.wall_velocity is None else np.where(self.spec.inv_mass[:, None] > 0, v, self.spec.wall_velocity)
