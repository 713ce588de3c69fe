"""exp, log, powers, sines and the error function in plain arithmetic: the same bits on every processor, with every C library.

A C library's functions differ in the last bit from version to version and from processor to processor (with or without fused
multiplication), and so would trajectories.  Sums, products, quotients and square roots are rounded alike everywhere, and numba, without
fastmath, lets no compiler join two of them.  There is no branch and no call in these functions, so that loops around them are vectorised.
They take numbers in kernels, and numbers or (exp, sine, erfc) arrays of numpy where kernels are prepared::

    exp(x)        x = n ln 2 + r with |r| <= ln(2)/2, ln 2 in two parts (Cody and Waite); 2^n times Taylor's series of exp(r)
    log(x)        x = 2^n (1 + f) from sqrt(1/2) to sqrt(2); with s = f/(2 + f), ln(1 + f) = 2 artanh(s) = f - s (f - 2 s^2 (1/3 + ...))
    power(w, s)   exp(s ln w)
    sine(turns)   Taylor's series of sin(2 pi q) for the nearest quarter
    erfc(x)       1 - 2/sqrt(pi) exp(-x^2) x (1 + 2 x^2/3 (1 + 2 x^2/5 (...))), and from FAR on a continued fraction,
                  exp(-x^2)/(sqrt(pi) (x + (1/2)/(x + 1/(x + (3/2)/(x + ...)))))

exp and log are within 1 unit of the last place, a power within 1 + |s ln w| units, sine and erfc within 6e-16.
"""

import math

import numpy as np

from ..runtime import both, merged

_LOG2E = 1.4426950408889634
#: ln 2: 33 bits, whose products with exponents are exact, and the rest.
_LN2, _LN2_REST = float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33")
#: A number between -2^51 and 2^51 that is added to this one is rounded to a whole one, which the lowest bits then hold.
_WHOLE = 1.5 * 2.0**52
_MANTISSA, _BIAS = np.int64(52), np.int64(1023)
_ROOT_HALF = np.float64(0.5**0.5).view(np.int64)
_LEAST_NORMAL, _LIFT = 2.0**-1022, 2.0**54
_EXP = tuple(1.0 / math.factorial(k) for k in range(2, 14))
_LOG = tuple(2.0 / (2 * k + 3) for k in range(12))
_SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 13))
#: Where the continued fraction of erfc begins; terms of the series below, and of the fraction.
_FAR, _TERMS, _DEPTH = 2.25, 40, 40


@both
def _two_to(n):
    """2^n of whole numbers from -1022 to 1023."""
    return np.int64((n + _BIAS) << _MANTISSA).view(np.float64)


@both
def _sum(x, c):
    """c0 + c1 x + ... + c11 x^11, in parts that the processor works on side by side (Estrin)."""
    x2 = x * x
    x4 = x2 * x2
    first = (c[0] + c[1] * x) + (c[2] + c[3] * x) * x2
    second = (c[4] + c[5] * x) + (c[6] + c[7] * x) * x2
    third = (c[8] + c[9] * x) + (c[10] + c[11] * x) * x2
    return first + (second + third * x4) * x4


@both
def exp(x):
    """exp(x)."""
    bounded = np.minimum(np.maximum(x, -746.0), 710.0)
    shifted = _LOG2E * bounded + _WHOLE
    whole = shifted - _WHOLE
    r = (bounded - whole * _LN2) - whole * _LN2_REST
    p = _sum(r, _EXP)
    # two factors, for numbers whose 2^n is none
    n = (np.float64(shifted).view(np.int64) << _MANTISSA) >> _MANTISSA
    half = n >> np.int64(1)
    return ((1.0 + (r + r * r * p)) * _two_to(half)) * _two_to(n - half)


@both
def log_of(x, m):
    """ln(2^m x) of normal numbers x > 0 and whole numbers m."""
    bits = np.float64(x).view(np.int64)
    n = (bits - _ROOT_HALF) >> _MANTISSA
    f = np.int64(bits - (n << _MANTISSA)).view(np.float64) - 1.0
    s = f / (2.0 + f)
    z = s * s
    m = m + np.float64(n)
    return m * _LN2 + (f - (s * (f - z * _sum(z, _LOG)) - m * _LN2_REST))


@both
def log(x):
    """ln(x) of a number x > 0; -inf at 0, NaN below."""
    if not x < np.inf:
        return x
    if not x > 0.0:
        return -np.inf if x == 0.0 else np.nan
    tiny = np.float64(x < _LEAST_NORMAL)
    return log_of(x * (1.0 + tiny * (_LIFT - 1.0)), -54.0 * tiny)


@merged
def power(w, s):
    """w^s of w = 0 and normal numbers w > 0, and s >= 0."""
    # everything first, and then what is right: compilers vectorise choices, and no branches, nor a choice that is returned
    found = exp(s * log_of(w, 0.0))
    found = found if w > 0.0 else np.float64(s == 0.0)
    found = np.sqrt(w) if s == 0.5 else found
    found = w if s == 1.0 else found
    return found


@both
def sine(turns):
    """sin(2 pi turns)."""
    part = turns - np.floor(turns + 0.5)
    # the nearest half turn: sin(pi - a) = sin a
    half = np.floor(2.0 * part + 0.5)
    angle = 2.0 * np.pi * (part - 0.5 * half) * (1.0 - 2.0 * np.abs(half))
    z = angle * angle
    return angle + angle * z * _sum(z, _SINE)


@both
def _erf_near(x):
    z, p = 2.0 * x * x, 1.0
    for k in range(_TERMS, 0, -1):
        p = 1.0 + p * z / (2.0 * k + 1.0)
    return 2.0 / np.sqrt(np.pi) * x * exp(-x * x) * p


@both
def _erfc_far(x):
    p = x
    for k in range(_DEPTH, 0, -1):
        p = x + 0.5 * k / p
    return exp(-x * x) / (np.sqrt(np.pi) * p)


@both
def erfc(x):
    """1 - erf(x) of x >= 0."""
    far = np.float64(x > _FAR)
    return (1.0 - far) * (1.0 - _erf_near(np.minimum(x, _FAR))) + far * _erfc_far(np.maximum(x, _FAR))


def without_last_bits(values: np.ndarray, bits: int) -> np.ndarray:
    """Values with so many bits after the point: those of a library's function without its last ones."""
    return np.round(values * 2.0**bits) / 2.0**bits
