"""The trajectory of a deck: DCD or XTC with a PSF topology, and the final state, in one folder."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import openmm
from openmm import app, unit

from ...base.files import writing
from ...io.dcd import DCDWriter
from ...io.trajectory import write_psf
from ...io.xtc import XTCWriter
from ...model.reactions import with_first_bonds
from ...model.scene import Scene
from ...simulation.built import BuiltSystem
from ...simulation.field_file import FieldWriter, has_fields
from ...simulation.fields import read_fields
from ..state.records import NO_SLIDE, Slide
from .request import RunRequest

#: Default number of frames per run, approximately, and the fewest steps between them: a frame takes as long as two to five.
FRAMES, APART = 100, 100
#: The final state is written after a run if all the time since it was written last is this many times what that takes, and at the end.
SELDOM = 20
#: Trajectory formats.
FORMATS: dict[str, type[DCDWriter] | type[XTCWriter]] = {"dcd": DCDWriter, "xtc": XTCWriter}


def write_topology(path: Path, scene: Scene) -> None:
    """Write the beads of a scene, and what joins them, as a PSF file."""
    scene = with_first_bonds(scene)
    joined: dict[str, Any] = {
        what: np.concatenate([group.beads for group in groups]) if groups else ()
        for what, groups in ((name, getattr(scene, name)) for name in ("bonds", "angles", "dihedrals", "impropers"))
    }
    write_psf(path, names=scene.types, masses=scene.bead_masses, charges=scene.charges, molecules=scene.molecules, **joined)


class RunTrajectory:
    """Writes ``trajectory.dcd`` (or ``.xtc``), ``topology.psf``, ``final_state.xml``, and ``fields.npz`` with bead fields into a folder.

    All runs go to one file; a new one (``trajectory-2.dcd``, ``topology-2.psf``) is started when the number of beads changes, and after
    ``clear``.  Positions are unwrapped.

    The folder is created if necessary; ``form`` is one of :data:`FORMATS`.  Frames are at multiples of ``every`` steps, each once; by
    default there are about :data:`FRAMES` per run, including the first and last step, and at most one in :data:`APART` steps.  All methods
    raise OutputError if a file cannot be written; existing frames stay readable.
    """

    def __init__(self, folder: Path, form: str = "dcd", every: int | None = None):
        with writing(folder, "the folder"):
            folder.mkdir(parents=True, exist_ok=True)
        self.folder, self._form, self._given = folder, form, every
        self._file: DCDWriter | XTCWriter | None = None
        self._fields: FieldWriter | None = None
        self._beads, self._system, self._part = 0, 0, 0
        self._offset: np.ndarray = np.zeros((0, 3))
        self._every, self._first, self._last = 1, 0, 0
        self._written: int | None = None
        self._unsaved: app.Simulation | None = None
        self._saved = self._took = 0.0

    @property
    def progress(self) -> tuple[int, int, int, int | None]:
        """The state that :meth:`resume` needs to continue the present files."""
        return self._beads, self._system, self._part, self._written

    def resume(self, progress: tuple[int, int, int, int | None]) -> None:
        """Continue existing files."""
        self._beads, self._system, self._part, self._written = progress
        if self._part:
            self._file = self._open(append=True)
            if self._named("fields.npz").exists():
                self._fields = FieldWriter(self._named("fields.npz"), append=True)

    def _open(self, append: bool) -> DCDWriter | XTCWriter:
        return FORMATS[self._form](self._named(f"trajectory.{self._form}"), self._beads, "the trajectory", append)

    def start(self, scene: Scene, request: RunRequest, built: BuiltSystem) -> None:
        """Prepare for a run."""
        self._every = self._given or max(APART, request.steps // FRAMES)
        self._first, self._last = (0, -1) if self._given else (request.first_step, request.last_step)
        self._deck = state = request.state
        self._offset = state.atoms.images @ state.require_box("a run").vectors * state.units.length
        if (scene.n_beads, state.systems) != (self._beads, self._system):
            self.close()
            self._beads, self._system, self._part = scene.n_beads, state.systems, self._part + 1
            write_topology(self._named("topology.psf"), scene)
            self._file = self._open(append=False)
        self._built = built
        if self._fields is None and has_fields(built):
            self._fields = FieldWriter(self._named("fields.npz"))

    def _named(self, name: str) -> Path:
        path = self.folder / name
        return path if self._part == 1 else path.with_stem(f"{path.stem}-{self._part}")

    def due(self, step: int) -> bool:
        """Whether a frame is due at this step."""
        if self._given and step == self._written:
            return False
        return step == self._last or (step - self._first) % self._every == 0

    def next_due(self, step: int) -> int:
        """The first step after ``step`` at which a frame is due."""
        return self._first + ((step - self._first) // self._every + 1) * self._every

    def write(self, x: np.ndarray, box: np.ndarray, context: openmm.Context, step: int, slide: Slide = NO_SLIDE) -> None:
        """Write one frame (nm) and the bead fields; ``slide`` is that of the images since the run began."""
        x = x + (self._deck.atoms.images @ box if self._deck.moving_box else self._offset)
        x += slide.shift(self._deck.atoms.images, slide.distance)
        if self._fields is not None:
            fields = read_fields(context, self._built.plan)
            fields.pop("bonds", None)  # dump local writes those; rows of beads may be longer in another run
            self._fields.write(context.getTime().value_in_unit(unit.picosecond), step, fields)
        if isinstance(self._file, XTCWriter):
            self._file.write(x, box, self._deck.time_at(step), step)
        else:
            assert self._file is not None
            # DCD files are in Angstrom
            self._file.write(10 * x, 10 * box)
        self._written = step

    def save_state(self, simulation: app.Simulation) -> None:
        """Write the state at the end of a run, from which OpenMM can continue exactly.  If that would take more than a twentieth of the
        time since the last one was written, as among many short runs, it is left to :meth:`write_state`."""
        self._unsaved = simulation
        if time.perf_counter() - self._saved >= SELDOM * self._took:
            self.write_state()

    @property
    def state_written(self) -> bool:
        """Whether the state at the end of the last run is in the file."""
        return self._unsaved is None

    def write_state(self) -> None:
        """Write the state at the end of the last run, unless it is in the file."""
        simulation, self._unsaved, begun = self._unsaved, None, time.perf_counter()
        if simulation is not None:
            simulation.saveState(self.folder / "final_state.xml")
            self._saved = time.perf_counter()
            self._took = self._saved - begun

    def close(self) -> None:
        """Close the files."""
        if self._file is not None:
            self._file.close()
            self._file = None
            self._fields = None
