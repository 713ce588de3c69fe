"""How kernels are compiled and kept on disk."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numba
from numba import types
from numba.extending import overload, register_jitable

from ..base.garbage import nothing_collected
from .kernel_cache import keep_on_disk
from .numba_private import NO_REFERENCE_COUNTS, ONLY_LINKED, CFunc

#: Division by zero gives inf or nan, as in numpy: a loop with an exception in it is never vectorised.
SEMANTICS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
#: The same for code that allocates nothing.  Numba would count the references to every array of a tuple that is handed on, atomically, and
#: for each pair that takes longer than all the rest.
BARE = SEMANTICS | NO_REFERENCE_COUNTS


def helper(function: Callable, *, bare: bool = True) -> Any:
    """Decorator of a function that kernels call.  It is compiled on its own, without a way in from Python, and optimised with those that
    call it: to optimise each for itself would take a third of the compiler's time.  One that allocates arrays is not ``bare``."""
    return numba.njit(**(BARE if bare else SEMANTICS), **ONLY_LINKED)(function)


#: Decorator of a function that is put in where kernels call it.
inlined = numba.njit(inline="always", **BARE)
#: Compiled on their own, and put in by LLVM where they are called: what is called often with many arrays, each of which is seven arguments,
#: and what is long, for which numba would take ten seconds.
merged = numba.njit(forceinline=True, **BARE, **ONLY_LINKED)
#: The same for functions that are also called from Python, where they stay what they are.
both = register_jitable(inline="always", **BARE, **ONLY_LINKED)
#: Decorator (with the function that kernels call) of one that gets the types of its arguments, and returns what is compiled for these.
by_types = partial(overload, jit_options=BARE)  # type: ignore[arg-type]  # has an option of our own


def compiled(function: Callable, *, bare: bool = False, kept: bool = True) -> Any:
    """Compile a function that Python calls; without the interpreter's lock, and cached on disk if ``kept``.  One that allocates nothing may
    be ``bare``.

    No fastmath, so that all versions round alike, and give the same bits.
    """
    dispatcher = numba.njit(**(BARE if bare else SEMANTICS))(function)
    if kept:
        keep_on_disk(dispatcher)
    return dispatcher


def at_address(function: Callable, arguments: tuple, *, bare: bool = True, kept: bool = True) -> CFunc:
    """Compile a function of numbers (and addresses) that returns a whole one, to be called by its ``address``; see :func:`compiled`."""
    made = CFunc(function, (arguments, types.int64), locals={}, options=dict(BARE if bare else SEMANTICS))
    if kept:
        keep_on_disk(made)
    with nothing_collected():  # an eighth of the compiler's time
        made.compile()
    return made
