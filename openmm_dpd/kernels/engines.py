"""The engines that there are, by name; :func:`register_engine` adds one."""

from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass

from ..base.errors import ParameterError, what_is
from .engine import host_engine, warm_up
from .extras import warm_up_extras
from .interface import Engine
from .layer import PairSpec
from .moment import Stepper, StepSpec, Watch
from .steps import StepLoop


@dataclass(frozen=True, eq=False, kw_only=True)
class EngineKind:
    """One kind of engines: how it is made, and what it can do."""

    name: str  #: What :func:`openmm_dpd.build` is told
    what: str  #: What it is, in a few words
    make: Callable[[PairSpec], Engine]  #: A new engine
    #: What it can do, in the words of :meth:`openmm_dpd.plan.plan.Plan.needs`, and "stress" and "Laplacian" for measurements; everything by
    #: default.  Scenes that need more are refused.
    can: Container[str] | None = None
    #: From (StepSpec, engine, watch, reach) to what does whole steps with it, see :class:`.steps.StepLoop`.
    stepper: Callable[[StepSpec, Engine, Watch, float], Stepper] = StepLoop
    #: Does what has to be done once before the first step, such as compiling, and says in ``log``, a function of a text, if it takes long.
    warm_up: Callable[[PairSpec, Callable[[str], None]], None] = lambda spec, log: None

    def lacks(self, needs: Iterable[str]) -> str | None:
        """The first of some things that it cannot do, None if it can do them all."""
        return None if self.can is None else next((need for need in needs if need not in self.can), None)


#: All kinds of engines, by name.
ENGINES: dict[str, EngineKind] = {}


def register_engine(kind: EngineKind) -> EngineKind:
    """Make an engine known to the package; ParameterError if there is another one of that name."""
    if kind.name == "auto" or ENGINES.setdefault(kind.name, kind) is not kind:
        raise ParameterError(f"there is an engine {kind.name!r} already")
    return kind


def engine_kind(name: str) -> EngineKind:
    """The kind of engines of a name; ParameterError if none was registered."""
    if not isinstance(name, str) or name not in ENGINES:
        raise ParameterError(f"engine must be 'auto' or one of {', '.join(map(repr, ENGINES))}, not {what_is(name)}")
    return ENGINES[name]


def _warm_up_host(spec: PairSpec, log: Callable[[str], None]) -> None:
    warm_up(spec, log)
    warm_up_extras(spec.extras)


register_engine(EngineKind(name="host", what="compiled pair kernel", make=host_engine, warm_up=_warm_up_host))
