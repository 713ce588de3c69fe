"""What an engine is to everything that uses one: loops over steps, the pair force, fields and measurements."""

from typing import Protocol

import numpy as np

from .columns import Totals
from .layer import PairSpec


class Engine(Protocol):
    """Evaluates the pair terms of a :class:`.layer.PairSpec`, and its ``extras``.

    It belongs to one thread at a time, and holds nothing that could not be recomputed.  Arrays are numpy's, (N, 3) float64 where nothing
    else is said.  Engines inherit from it, and write the methods down to :meth:`tensors`.
    """

    spec: PairSpec
    number: int  #: Of the positions that were placed last: what was computed there is valid while it stays
    body_scale: float  #: Factor of forces on single beads
    rates: np.ndarray  #: (N, K) what the last call of :meth:`sums` gave for the fields of the spec, per time
    increments: np.ndarray  #: (N, K) what the last call of :meth:`swept` gave for them, in all

    def holds(self, x: np.ndarray, box: np.ndarray | None) -> bool:
        """Whether x are the positions that are kept."""
        ...

    def place(self, x: np.ndarray, box: np.ndarray | None) -> None:
        """Take the positions x without a look at those before; x and the box stay the caller's, who says when they change by another
        call."""
        ...

    def keep(self) -> None:
        """Remember the positions that were placed last, and have not changed since."""
        ...

    def resume(self, x: np.ndarray, box: np.ndarray | None) -> None:
        """Take x, which are the positions that are kept, and their box as if they had just been placed."""
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

    def another(self) -> "Engine":
        """A new engine for the same pair terms; only where it repeats."""
        raise NotImplementedError

    @property
    def repeats(self) -> bool:
        """Whether all that a step asks for is done by kernels on arrays that stay, so that it can be played again (:mod:`.tape`)."""
        return False

    def tables(self, layer: int, heats: np.ndarray) -> np.ndarray | None:
        """Coefficients (S, ...) of a layer at S thermal energies, None if more than noise depends on these; only where it repeats."""
        raise NotImplementedError

    def sorted_beads(self) -> np.ndarray:
        """(N,) numbers of all beads, cell by cell, at the positions that were placed last; only where it repeats."""
        raise NotImplementedError

    def seat(self, names: np.ndarray, places: np.ndarray) -> None:
        """Take all arrays of beads from now on in another order: ``names`` (N,) has the number of the bead in each row, ``places`` (N,) the
        row of each; only where it repeats."""
        raise NotImplementedError

    @property
    def parts_forces(self) -> bool:
        """Whether :meth:`sums` can write conservative forces apart."""
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
        """Take velocities from now on relative to the flow of a Lees-Edwards shear, along x and growing with y; its rate is the first
        number, whatever that is when it is needed."""
        raise NotImplementedError

    def passed(self) -> np.ndarray:
        """(6,) sum of r J over the pairs of the last sweep in a shear, J the impulse that friction along their line has given them."""
        raise NotImplementedError

    def densities(self, layer: int) -> np.ndarray:
        """(N,) local densities of a layer that has them at the placed positions."""
        raise NotImplementedError

    @property
    def repels_by_pairs(self) -> bool:
        """Whether :meth:`tensors` has all of the conservative terms."""
        return False

    def tensors(self, v: np.ndarray, kT: float) -> tuple[np.ndarray, np.ndarray, float]:
        """(6,) sums of r F at the prepared positions: of A w, and of friction along the lines between beads at velocities (N, 3).

        And the sum of f gamma w^(2s) r^2, of which a fifteenth is the mean stress of an affine shear at rate 1.
        """
        raise NotImplementedError

    def prepare(self, x: np.ndarray, box: np.ndarray | None) -> bool:
        """Place and keep the positions x; does nothing and returns False if they are kept already."""
        if self.holds(x, box):
            return False
        self.place(x, box)
        self.keep()
        return True

    def forces(self, which, v, kT, dt, seed, counter, field_values=None, out: np.ndarray | None = None) -> tuple[float, np.ndarray, float]:
        """Energy, forces (N, 3) and virial; all arguments are those of :meth:`sums`."""
        force = np.empty((len(self.spec.types), 3)) if out is None else out
        found = self.sums(which, v, kT, dt, seed, counter, field_values, force)
        return found.energy, force, found.virial

    def sweep(self, v: np.ndarray, *conditions) -> np.ndarray:
        """Change of the velocities (N, 3) by a sweep; all arguments are those of :meth:`swept`."""
        swept = self.swept(v, *conditions)
        swept -= self.seen(v)
        return swept

    def seen(self, v: np.ndarray) -> np.ndarray:
        """Velocities with those of immobile beads replaced by their prescribed ones."""
        return v if self.spec.wall_velocity is None else np.where(self.spec.inv_mass[:, None] > 0, v, self.spec.wall_velocity)
