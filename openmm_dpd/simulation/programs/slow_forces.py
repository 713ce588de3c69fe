"""Forces that stay OpenMM's where a loop could do the steps: they kick before and after a step, as they do in the loop.

In a program without a loop they kick with all other forces, and nothing is written here.  The pair force exerts none in phase STORE, so
that ``f`` is what all others exert.
"""

from contextlib import nullcontext

from ...base.names import SLOW_STEP, Phase
from .program import Program


def kick_before(p: Program) -> None:
    """Before a step, in every one or after so many of them."""
    if p.options.slow_every > 1 and p.options.execution.looped:
        p.declare(SLOW_STEP, 0.0, "steps done since OpenMM's forces kicked")
    _kick(p, p.options.slow_kicks[0], "before")


def kick_after(p: Program) -> None:
    """The same behind a step."""
    every = p.options.slow_every
    if every > 1 and p.options.execution.looped:
        p.set(SLOW_STEP, f"{SLOW_STEP}+1-{every}*step({SLOW_STEP}+1-{every})")
    _kick(p, p.options.slow_kicks[1], "after")


def _kick(p: Program, steps: float, where: str) -> None:
    every = p.options.slow_every
    if steps and p.options.execution.looped:
        with nullcontext() if every == 1 else p.when(f"{SLOW_STEP} < 1", f"do they kick {where} this step?"):
            p.phase(Phase.STORE)
            p.each("v", f"v+{steps!r}*dt*f/m", "kick by OpenMM's forces; the pair force stores x")
