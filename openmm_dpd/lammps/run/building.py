"""From the request of a run to its System, integrator and barostat."""

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
    """Build the scene of a run.  What cannot be built is a DeckError at the run command."""
    for kind in (kind_for(table.kind) for table in scene.tables if table.kind is not None):
        if scene.compat == "consistent" and kind.unlike_lammps is not None:
            request.state.note(kind.unlike_lammps)
    _note_reduced(request.state)
    if scene.interacting is not None and not scheme_of(request.scheme).predicts:
        raise request.state.fixes_of("setforce")[0].error(
            f"it removes all forces on mobile beads, friction included, but scheme {request.scheme} does not apply friction as a force; "
            "use the deck's own scheme, mvv"
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
    """Add a note if numbers look like reduced units although the units have dimensions: too cold, or denser than atoms."""
    at, given = state.pair.where, [style.settings for style in state.pair.styles if "start" in style.settings]
    cold = 0 < sum(settings["start"] + settings["stop"] for settings in given) < 20 * len(given)
    if state.units.name != "lj" and at is not None and (cold or len(state.atoms) > state.require_box("run").volume):
        found = "the temperature is below 10 K, or there is more than one bead per cubic Angstrom, as in reduced units (units lj)"
        state.note(f"{at.file}:{at.number}: {found}; the deck has units {state.units.name}")


#: Steps between two volume moves.
VOLUME_INTERVAL = 10


def connect_barostat(request: RunRequest, built: BuiltSystem) -> EnthalpyBarostat | None:
    """Set up the barostat of ``request.barostat``: OpenMM's is added to ``built.system`` before there is a Context; this package's is
    returned. DeckError if the pressure is not constant or differs between axes."""
    control = request.barostat
    if control is None:
        return None
    pressures = {p for p, used in zip(control.start, control.axes, strict=True) if used}
    with errors_at(request.where):
        if not control.constant or len(pressures) > 1:
            raise ParameterError("fix nph: volume moves need a constant pressure that is the same along all axes")
        choices: dict[str, Any] = {"interval": VOLUME_INTERVAL, "axes": control.axes, "coupled": control.coupled}
        if control.isothermal:
            add_barostat(built, pressures.pop(), **choices)
            return None
        return EnthalpyBarostat(built, pressures.pop(), **choices)
