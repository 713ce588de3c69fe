"""How kernels are compiled, kept on disk, called, shared by threads, recorded and played again.  Nothing here knows physics.

Other rooms use the names below; ``docs/runtime.md`` describes what is behind them.
"""

import numba

if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise ImportError("NUMBA_DISABLE_JIT is set, but openmm_dpd computes in kernels that numba compiles; unset it")

from .addresses import instruction as instruction
from .decorators import (
    both as both,
    by_types as by_types,
    compiled as compiled,
    helper as helper,
    inlined as inlined,
    merged as merged,
)
from .kernel_cache import cache_folder as cache_folder
from .native import Kernel as Kernel
from .notice import announced as announced
from .tape import Tape as Tape
from .team import meet as meet
from .threads import get_threads as get_threads, set_threads as set_threads, threads_for as threads_for
