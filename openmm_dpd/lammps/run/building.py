"""From the request of a run to what carries it out: System, integrator and barostat."""

from typing import Any

from ...base.errors import ParameterError, read_by
from ...model.scene import Scene
from ...model.schemes import scheme_of
from ...plan.kinds import kind_for
from ...simulation.barostat import EnthalpyBarostat, add_barostat
from ...simulation.build import BuiltSystem, build
from ..language.lexer import errors_at
from ..state.deck_state import DeckState
from .options import RunOptions
from .request import RunRequest


def build_request(request: RunRequest, scene: Scene, options: RunOptions) -> BuiltSystem:
    """Build the scene of a run; what cannot be built is an error at the deck's run command."""
    for kind in (kind_for(table.kind) for table in scene.tables if table.kind is not None):
        if scene.compat == "consistent" and kind.unlike_lammps is not None:
            request.state.note(kind.unlike_lammps)
    _note_reduced(request.state)
    if scene.interacting is not None and not scheme_of(request.scheme).predicts:
        raise request.state.fixes_of("setforce")[0].error(
            f"it takes forces from beads that move, friction included, but scheme {request.scheme} changes velocities without forces; "
            "run the deck with its own scheme, mvv"
        )
    with errors_at(request.where), read_by(request.state):
        return build(
            scene,
            dt=request.dt,
            scheme=request.scheme,
            lam=request.lambda_ if scheme_of(request.scheme).predicts else 0.5,
            conservative=options.conservative,
            engine=options.engine,
            platform=options.platform,
            seed=options.seed if options.seed is not None else request.seed,
        )


def _note_reduced(state: DeckState) -> None:
    """Say so where numbers look like reduced ones, though the units have dimensions: colder than such liquids, or denser than atoms."""
    at, given = state.pair.where, [style.settings for style in state.pair.styles if "start" in style.settings]
    cold = 0 < sum(settings["start"] + settings["stop"] for settings in given) < 20 * len(given)
    if state.units.name != "lj" and at is not None and (cold or len(state.atoms) > state.require_box("run").volume):
        found = "below 10 K, or more than one bead in a cubic Angstrom: such numbers are reduced and need units lj"
        state.note(f"{at.file}:{at.number}: {found}; the deck has units {state.units.name}")


#: Steps between two attempts to change the volume.
VOLUME_INTERVAL = 10


def connect_barostat(request: RunRequest, built: BuiltSystem) -> EnthalpyBarostat | None:
    """The barostat of ``request.barostat``: OpenMM's goes into ``built.system``, before there is a Context; ours is returned.  DeckError if
    the pressure changes during the run, or is not the same along all axes."""
    control = request.barostat
    if control is None:
        return None
    pressures = {p for p, used in zip(control.start, control.axes, strict=True) if used}
    with errors_at(request.where):
        if not control.constant or len(pressures) > 1:
            raise ParameterError("fix nph: volume moves have one pressure, the same along all axes and during the whole run")
        choices: dict[str, Any] = {"interval": VOLUME_INTERVAL, "axes": control.axes, "coupled": control.coupled}
        if control.isothermal:
            add_barostat(built, pressures.pop(), **choices)
            return None
        return EnthalpyBarostat(built, pressures.pop(), **choices)
