"""The kinds of engines, by name; :func:`register_engine` adds one."""

from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass

from ..base.errors import ParameterError, what_is
from .engine import host_engine, warm_up
from .extras import warm_up_extras
from .interface import Engine
from .layer import PairSpec
from .moment import Stepper, StepSpec, Watch
from .reactions import step_loop


@dataclass(frozen=True, eq=False, kw_only=True)
class EngineKind:
    """One kind of engines: how it is made, and what it can do."""

    name: str  #: The ``engine=`` of :func:`openmm_dpd.build`
    what: str  #: A description in a few words, for explanations of plans
    make: Callable[[PairSpec], Engine]  #: Makes an engine for these pair terms
    #: What its engines can do, in the words of :meth:`openmm_dpd.plan.plan.Plan.needs`, with "stress" and "Laplacian" for measurements;
    #: None: everything.  Scenes that need more are refused.
    can: Container[str] | None = None
    #: Makes what does whole steps with an engine, from (StepSpec, engine, watch, reach), see :class:`.steps.StepLoop`.
    stepper: Callable[[StepSpec, Engine, Watch, float], Stepper] = step_loop
    #: Does what is needed once before the first step, such as compiling; tells ``log``, a function of a text, if that takes long.
    warm_up: Callable[[PairSpec, Callable[[str], None]], None] = lambda spec, log: None

    def lacks(self, needs: Iterable[str]) -> str | None:
        """The first of these needs that its engines cannot meet, or None."""
        return None if self.can is None else next((need for need in needs if need not in self.can), None)


#: All kinds of engines, by name.
ENGINES: dict[str, EngineKind] = {}


def register_engine(kind: EngineKind) -> EngineKind:
    """Make an engine known to the package; ParameterError if there is another one of that name."""
    if kind.name == "auto" or ENGINES.setdefault(kind.name, kind) is not kind:
        raise ParameterError(f"there is an engine {kind.name!r} already")
    return kind


def engine_kind(name: str) -> EngineKind:
    """The kind of engines with this name; ParameterError if none was registered."""
    if not isinstance(name, str) or name not in ENGINES:
        raise ParameterError(f"engine must be 'auto' or one of {', '.join(map(repr, ENGINES))}, not {what_is(name)}")
    return ENGINES[name]


def _warm_up_host(spec: PairSpec, log: Callable[[str], None]) -> None:
    warm_up(spec, log)
    warm_up_extras((*spec.extras, *spec.sorts))


register_engine(EngineKind(name="host", what="compiled pair kernel", make=host_engine, warm_up=_warm_up_host))
