"""The request of a ``run`` command to the simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...model.scene import Scene
from ..language.lexer import Line
from ..output.averages import AveragingFix, DynamicGroup, PrintFix
from ..output.dumps import Dump
from ..output.thermo import Thermo
from ..scene.axes import SAME, Axes, axes_of
from ..scene.integration import Integration
from ..scene.scene import build_scene
from ..state.box import Box
from ..state.deck_state import DeckState
from ..state.moment import Window
from ..state.records import NO_SLIDE, DeckSample, PressureControl, Slide, StoppingRule
from ..values.resolver import Resolver
from .adapting import begin


@dataclass(frozen=True, kw_only=True)
class RunRequest:
    """One run of a deck: how its beads are moved, and for how long.

    Whoever carries it out steps the scene and calls :meth:`finish` (:class:`~openmm_dpd.lammps.run.runner.DeckRunner`).
    """

    scheme: str  #: ``mvv`` or ``shardlow``
    lambda_: float  #: Weight of the predicted velocity in ``mvv``; 1/2 is velocity Verlet
    mobile: np.ndarray  #: (N,) mask of the mobile beads
    barostat: PressureControl | None  #: The pressure of ``fix nph``
    state: DeckState  #: The deck at this point
    steps: int  #: Number of steps
    dt: float  #: Time step in ps
    first_step: int  #: Number of the step before the first
    begin: int | None  #: Step given by ``start``; None means the first step of the run
    end: int | None  #: Step given by ``stop``; None means the last step of the run
    seed: int  #: Seed of the first thermostatting pair style; 1 without one, so that runs of a deck are the same
    where: Line | None  #: The run command
    number: int = 0  #: Number of this run in the deck, from 0
    compat: str = "consistent"  #: ``consistent``, or ``lammps`` for the heat of edpd as LAMMPS computes it
    minimization: StoppingRule | None = None  #: Stopping rule of ``minimize``; None for ``run``

    @classmethod
    def of(cls, state: DeckState, steps: int, moved: Integration, begin: int | None = None, end: int | None = None) -> RunRequest:
        """Request for ``steps`` steps from the deck's present state."""
        seeds = [style.settings["seed"] for style in state.pair.styles if style.spec.thermostat]
        return cls(
            **vars(moved),
            state=state,
            steps=steps,
            dt=state.timestep,
            first_step=state.step,
            begin=begin,
            end=end,
            seed=seeds[0] if seeds else 1,
            where=state.here,
            number=state.runs,
        )

    @property
    def last_step(self) -> int:
        """Number of the last step."""
        return self.first_step + self.steps

    @property
    def window(self) -> Window:
        """First step and limits of the ramps."""
        begin = self.first_step if self.begin is None else self.begin
        return Window(self.first_step, begin, self.last_step if self.end is None else max(self.end, self.last_step))

    @property
    def thermo(self) -> Thermo:
        """Columns, interval and formats of thermo output."""
        settings = self.state.thermo
        # as in LAMMPS, beside fixes that change the box
        more = () if settings.custom or not self.state.fixes_of("deform", "nph", "npt") else ("vol",)
        return Thermo(self.state, self.window, self.last_step, (*settings.words, *more), settings.every)

    @property
    def averages(self) -> Sequence[AveragingFix]:
        """Averaging fixes, in the order of the deck."""
        return tuple(reader for reader in self.readers if isinstance(reader, AveragingFix))

    @property
    def readers(self) -> Sequence[AveragingFix | PrintFix | DynamicGroup]:
        """What reads values at the end of steps: dynamic groups, and fixes, including averages, in the order of the deck."""
        return *self.state.dynamic.values(), *(fix.parameters["reader"] for fix in self.state.fixes.values() if "reader" in fix.parameters)

    @property
    def dumps(self) -> Sequence[Dump]:
        """Dumps active during this run."""
        return tuple(self.state.dumps.values())

    def scene(self) -> Scene:
        """The scene at the first step; see :func:`~openmm_dpd.lammps.scene.scene.build_scene`."""
        if self.minimization is None and self.state.fixes_of("adapt"):
            begin(self.state, self.first_moment(), self.number)
        return build_scene(self.state, self.window, self.compat, self.mobile, self.axes)

    @property
    def axes(self) -> Axes:
        """The axes of the scene, which is not sheared in a minimisation."""
        return SAME if self.minimization is not None else axes_of(self.state)

    def first_moment(self) -> Resolver:
        """The moment at which the run begins."""
        x, v = self.state.scene_positions, self.state.atoms.velocities * self.state.units.velocity
        return Resolver(self.state, DeckSample(self.first_step, positions=x, velocities=v), self.window)

    def override(
        self, *, steps: int | None = None, dt: float | None = None, scheme: str | None = None, compat: str | None = None
    ) -> RunRequest:
        """The request with another number of steps, time step (ps), scheme or ``compat``; ``dt`` also becomes the deck's time step."""
        if dt is not None and dt != self.state.timestep:
            self.state.set_timestep(dt)
        given = {"steps": steps, "dt": dt, "scheme": scheme, "compat": compat}
        return replace(self, **{name: value for name, value in given.items() if value is not None})  # type: ignore[arg-type]

    def finish(
        self,
        positions: np.ndarray,
        velocities: np.ndarray,
        *,
        box: np.ndarray | Box | None = None,
        sample: DeckSample | None = None,
        fields: Mapping[str, np.ndarray] | None = None,
        slide: Slide = NO_SLIDE,
    ) -> None:
        """Hand the result back to the deck: its step becomes ``last_step``.

        Parameters
        ----------
        positions, velocities, box, fields, slide
            See :meth:`~openmm_dpd.lammps.state.deck_state.DeckState.write_back`.
        sample : DeckSample, optional
            Measurement at the last step, for formulas evaluated before the next run.
        """
        self.state.write_back(positions, velocities, box, fields, slide)
        self.state.step = self.last_step
        if sample is not None:
            # without the box, which is the deck's from now on, and may change before the next run
            self.state.last_sample = replace(sample, positions=None, velocities=None, fields=None, box=None)
