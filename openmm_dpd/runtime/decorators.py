"""Decorators of compiled code, with the options that all of it shares."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numba
from numba import types
from numba.extending import overload, register_jitable

from ..base.garbage import nothing_collected
from .kernel_cache import keep_on_disk
from .numba_private import NO_REFERENCE_COUNTS, ONLY_LINKED, CFunc

#: Division by zero gives inf or nan, as in numpy: a loop that can raise an exception is never vectorised.  No option allows fast math, so
#: that all versions round alike and give the same bits.
SEMANTICS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
#: Options for code that allocates nothing.  Otherwise numba counts the references to every array of a tuple that is passed on, atomically,
#: which takes longer per pair than everything else.
BARE = SEMANTICS | NO_REFERENCE_COUNTS


def helper(function: Callable, *, bare: bool = True) -> Any:
    """Decorator of a function that only kernels call.  It is compiled separately but optimised together with its callers, which saves a
    third of the compile time.  A function that allocates arrays must not be ``bare``."""
    return numba.njit(**(BARE if bare else SEMANTICS), **ONLY_LINKED)(function)


#: Decorator of a function that numba inlines into the kernels that call it.
inlined = numba.njit(inline="always", **BARE)
#: Decorator of a function that LLVM inlines: one that is called often with many arrays (each is seven arguments of a call), or that is so
#: long that numba would take ten seconds to inline it.
merged = numba.njit(forceinline=True, **BARE, **ONLY_LINKED)
#: Decorator of a function that is inlined into kernels, and stays a plain function for Python.
both = register_jitable(inline="always", **BARE, **ONLY_LINKED)
#: Decorator factory: ``@by_types(name)`` is for a function that gets the types of the arguments with which kernels call ``name``, and
#: returns the function to compile for them.
by_types = partial(overload, jit_options=BARE)  # type: ignore[arg-type]  # has an option of our own


def compiled(function: Callable, *, kept: bool = True) -> Any:
    """Compile a function that Python calls.  It runs without the interpreter's lock, and is kept on disk if ``kept``."""
    dispatcher = numba.njit(**SEMANTICS)(function)
    if kept:
        keep_on_disk(dispatcher)
    return dispatcher


def at_address(function: Callable, arguments: tuple, *, bare: bool = True, kept: bool = True) -> CFunc:
    """Compile a function of integers that returns an integer, to be called by its ``address``.  It is kept on disk if ``kept``; a function
    that allocates arrays must not be ``bare``."""
    made = CFunc(function, (arguments, types.int64), locals={}, options=dict(BARE if bare else SEMANTICS))
    if kept:
        keep_on_disk(made)
    with nothing_collected():  # an eighth of the compiler's time
        made.compile()
    return made
