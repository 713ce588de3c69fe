"""Compiled pair terms: arrays in, arrays out.  Nothing here knows OpenMM or the model."""

import numba

if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise ImportError("NUMBA_DISABLE_JIT is set, but openmm_dpd computes in kernels that numba compiles; unset it")
