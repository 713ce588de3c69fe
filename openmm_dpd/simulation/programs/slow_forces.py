"""Forces that stay OpenMM's where a loop could do the steps: they kick before and after a step, as they do in the loop.

In a program without a loop they kick with all other forces, and nothing is written here.  The pair force exerts none in phase STORE, so
that ``f`` is what all others exert.
"""

from ...base.names import SLOW_STEP, Phase
from .program import Program


def kick_before(p: Program) -> None:
    """Before a step, in every one or after so many of them."""
    if not p.options.execution.looped:
        return
    if p.options.slow_every == 1:
        _kick(p, p.options.slow_kicks[0])
        return
    p.declare(SLOW_STEP, 0.0, "steps done since OpenMM's forces kicked")
    with p.when(f"{SLOW_STEP} < 1", "do they kick before this step?"):
        _kick(p, p.options.slow_kicks[0])


def kick_after(p: Program) -> None:
    """The same behind a step."""
    if not p.options.execution.looped:
        return
    every, steps = p.options.slow_every, p.options.slow_kicks[1]
    if every == 1:
        _kick(p, steps)
        return
    p.set(SLOW_STEP, f"{SLOW_STEP}+1-{every}*step({SLOW_STEP}+1-{every})")
    with p.when(f"{SLOW_STEP} < 1", "do they kick after this step?"):
        _kick(p, steps)


def _kick(p: Program, steps: float) -> None:
    if steps:
        p.phase(Phase.STORE)
        p.each("v", f"v+{steps!r}*dt*f/m", "kick by OpenMM's forces; the pair force stores x")
