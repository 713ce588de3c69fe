"""From the request of a run to what carries it out: System, integrator and barostat."""

from typing import Any

from ...base.errors import ParameterError
from ...base.wording import read_by
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
    """Say so where numbers look like reduced ones, though the units have dimensions: colder than any such liquid, or denser than atoms."""
    set_at = [max(style.settings["start"], style.settings["stop"]) for style in state.pair.styles if "start" in style.settings]
    density = len(state.atoms) / state.require_box("run").volume
    if state.units.name != "lj" and (0 < max(set_at, default=0) < 10 or density > 1) and state.pair.where is not None:
        cold = f"a temperature of {max(set_at):g} K and " if set_at else ""
        state.note(
            f"{state.pair.where.file}:{state.pair.where.number}: {cold}{density:.3g} beads in a cubic Angstrom look like reduced numbers, "
            f"which need units lj; here units {state.units.name} make kelvin and Angstrom of them"
        )


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
