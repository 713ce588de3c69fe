"""One configuration of a scene, to be written to a file; PDB files; and the base of reporters."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
import openmm
from openmm import unit

from ..base.errors import ParameterError, require, what_is
from ..base.files import write_whole
from ..base.units import whole_number
from ..model.reactions import with_first_bonds
from ..model.scene import Scene
from .psf import SEGMENT, molecule_numbers, residue_names
from .trajectory import CHAIN, SYMBOL, short_names


class Cadence:
    """Base of reporters: a report every ``interval`` steps; ``what`` names the reports in errors."""

    #: Parts of the State that OpenMM passes, and whether its positions are wrapped into the box (None: OpenMM decides).
    _INCLUDE: tuple[str, ...] = ()
    _FOLDED: bool | None = None

    def __init__(self, interval: int, what: str = "reports"):
        self.interval = whole_number(interval, f"the interval between {what}, in steps,", least=1)

    def describeNextReport(self, simulation):
        """Steps until the next report, and the parts of the State that it needs, as OpenMM asks for them."""
        steps = self.interval - simulation.currentStep % self.interval
        return {"steps": steps, "periodic": self._FOLDED, "include": list(self._INCLUDE)}


@dataclass(frozen=True, eq=False)
class Snapshot:
    """One configuration of N beads; nm, ps."""

    scene: Scene  #: Constant properties of the beads
    positions: np.ndarray  #: (N, 3)
    velocities: np.ndarray | None  #: (N, 3) or None
    box: np.ndarray | None  #: (3, 3) or None
    step: int = 0
    time: float = 0.0

    @classmethod
    def of(cls, source, state: openmm.State | openmm.Context | None = None, context: openmm.Context | None = None) -> Snapshot:
        """Snapshot of a Scene or of a result of :func:`openmm_dpd.build`, at its start or in the state of a run.  Bonds and types that
        reactions change are those of the Context of a built system.  ParameterError if they are not known, the state has no positions or
        another number of particles, or the source is anything else."""
        scene = with_first_bonds(scene_of(source))
        if state is not None and scene.reactions:
            context = state if isinstance(state, openmm.Context) else context
            if context is None or not hasattr(source, "scene_in"):
                raise ParameterError(
                    "bonds form and break here, and an openmm.State has none: take the result of build(), and state=simulation.context"
                )
            scene = source.scene_in(context)
        if state is None:
            if source is scene_of(source):
                return cls(scene, scene.positions, scene.velocities, scene.box)
            velocities = source.velocities.value_in_unit(unit.nanometer / unit.picosecond)
            return cls(scene, source.positions.value_in_unit(unit.nanometer), velocities, scene.box)
        if isinstance(state, openmm.Context):
            state = state.getState(positions=True, velocities=True)
        require(state, openmm.State, "state must be an openmm.State, from context.getState(positions=True)")
        try:
            positions = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        except openmm.OpenMMException:
            raise ParameterError("the state has no positions; ask for them: context.getState(positions=True, velocities=True)") from None
        if len(positions) != scene.n_beads:
            raise ParameterError(f"the state has {len(positions)} particles, but the scene has {scene.n_beads} beads")
        try:
            velocities = state.getVelocities(asNumpy=True).value_in_unit(unit.nanometer / unit.picosecond)
        except openmm.OpenMMException:
            velocities = None
        box = None if scene.box is None else np.array(state.getPeriodicBoxVectors(asNumpy=True).value_in_unit(unit.nanometer))
        bad = np.argwhere(~np.isfinite(positions))
        if len(bad):
            raise ParameterError(f"bead {bad[0, 0]} is at {positions[bad[0, 0]].tolist()}; every coordinate must be finite")
        return cls(scene, positions, velocities, box, state.getStepCount(), state.getTime().value_in_unit(unit.picosecond))


def scene_of(source) -> Scene:
    """The scene itself, or that of a result of :func:`openmm_dpd.build`; ParameterError for anything else."""
    scene = source if isinstance(source, Scene) else getattr(getattr(source, "plan", None), "scene", None)
    if not isinstance(scene, Scene):
        raise ParameterError(f"expected a Scene or the result of openmm_dpd.build(), not {what_is(source)}")
    if scene is not source and source.plan.host is not None:
        raise ParameterError("a System made elsewhere has particles that are not beads; use OpenMM's reporters to write it")
    return scene


class FrameReporter(Cadence):
    """Base of reporters that write unwrapped positions and velocities."""

    _INCLUDE, _FOLDED = ("positions", "velocities"), False


#: Serial numbers have five digits.
_MOST_BEADS = 99_999


def write_pdb(path: str | os.PathLike, source, *, state=None) -> None:
    """Write one frame as a PDB file: names, molecules as residues, the box, and CONECT records of all bonds.

    Every bead is a HETATM record with the element ``VS`` (mdtraj's virtual site), so that no reader takes a bead ``B`` for boron (OpenMM:
    ``app.PDBFile(path, extraParticleIdentifier="VS")``).  Bead names are shortened to four characters and molecule names to three
    (:func:`openmm_dpd.io.trajectory.short_names`); REMARK records list them.  Molecule numbers are modulo 10,000.  mdtraj reads
    everything back; OpenMM's own reader drops beads of equal names within a molecule.  The format has no angles or dihedrals.

    Parameters
    ----------
    path : path-like
        File to write; overwritten.
    source : Scene, or the result of :func:`openmm_dpd.build`
    state : openmm.State or openmm.Context, optional
        Positions and box of a run; by default those of the start.  Where reactions change bonds and types, a Context has those.

    Raises
    ------
    ParameterError
        If there are more than 99,999 beads, or coordinates do not fit into the columns (-99.9999 to 999.9999 nm).
    OutputError
        If the file cannot be written; an existing file is kept.
    """
    write_whole(path, pdb_text(Snapshot.of(source, state)), "the PDB file")


def pdb_text(now: Snapshot) -> str:
    """Text of a PDB file, as :func:`write_pdb` writes it."""
    scene = now.scene
    if scene.n_beads > _MOST_BEADS:
        raise ParameterError(f"a PDB file holds at most {_MOST_BEADS} beads, and there are {scene.n_beads}; write PSF and DCD, or GSD")
    x = np.round(now.positions * 10, 3) + 0.0
    outside = np.argwhere((x < -999.9994) | (x > 9999.9994))
    if len(outside):
        bead, axis = outside[0].tolist()
        raise ParameterError(f"bead {bead} is at {'xyz'[axis]} = {now.positions[bead, axis]:g} nm, which does not fit into a PDB file")
    names, residues = short_names(scene.types, 4), short_names(residue_names(scene.residues, scene.n_beads), 3)
    lines = ["REMARK   1 BEADS OF A DPD SIMULATION"]
    for what, short in (("BEAD", names), ("MOLECULE", residues)):
        lines += [f"REMARK   2 {what} {name} IS CALLED {called}" for name, called in short.items() if name != called]
    if now.box is not None:
        lines.append(_cell(now.box))
    numbers = (molecule_numbers(scene.molecules, scene.bond_pairs, scene.n_beads) % 10_000).tolist()
    beads = zip(scene.types, residue_names(scene.residues, scene.n_beads), numbers, x.tolist(), strict=True)
    for serial, (kind, residue, number, (a, b, c)) in enumerate(beads, start=1):
        name = names[kind] if len(names[kind]) == 4 else f" {names[kind]}"
        lines.append(
            f"HETATM{serial:5d} {name:<4s} {residues[residue]:>3s} {CHAIN}{number:4d}    {a:8.3f}{b:8.3f}{c:8.3f}"
            f"{1:6.2f}{0:6.2f}      {SEGMENT:<4s}{SYMBOL:>2s}"
        )
    return "\n".join([*lines, *_bonds(scene.bond_pairs), "END", ""])


def _bonds(pairs: np.ndarray) -> list[str]:
    """CONECT records: each bond under both of its beads, up to four per line."""
    neighbours: dict[int, list[int]] = {}
    for i, j in (pairs + 1).tolist():
        neighbours.setdefault(i, []).append(j)
        neighbours.setdefault(j, []).append(i)
    return [
        f"CONECT{bead:5d}" + "".join(f"{other:5d}" for other in around[start : start + 4])
        for bead, around in sorted(neighbours.items())
        for start in range(0, len(around), 4)
    ]


def _cell(box: np.ndarray) -> str:
    a, b, c = np.linalg.norm(box, axis=1)
    alpha, beta, gamma = (
        np.degrees(np.arccos(box[i] @ box[j] / (np.linalg.norm(box[i]) * np.linalg.norm(box[j])))) for i, j in ((1, 2), (0, 2), (0, 1))
    )
    return f"CRYST1{10 * a:9.3f}{10 * b:9.3f}{10 * c:9.3f}{alpha:7.2f}{beta:7.2f}{gamma:7.2f} P 1           1 "
