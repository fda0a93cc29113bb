"""Cosine and sine of many angles in a plain loop, without a branch, which compilers turn into vector instructions.

An angle is reduced to a quarter turn about zero by the nearest multiple of pi, subtracted in three parts (Cody and
Waite [1]_), and both functions are their Taylor polynomials there: the first terms left out are below 1e-17. Multiples
up to 2^19 pi are exact in the first two parts, so an angle of up to a million radians keeps all its digits; beyond, the
error grows as that of the angle itself does.

References
----------
.. [1] W. J. Cody, W. Waite, "Software manual for the elementary functions", Prentice-Hall, 1980.
"""

from fractions import Fraction
from math import factorial, frexp, ldexp, pi

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def _leading_bits(value: Fraction, bits: int) -> float:
    exponent = frexp(float(value))[1]
    return ldexp(int(value * Fraction(2) ** (bits - exponent)), exponent - bits)


# pi to 40 digits.
_PI = Fraction(31415926535897932384626433832795028841971, 10**40)
_PI_HIGH = _leading_bits(_PI, 33)
_PI_MIDDLE = _leading_bits(_PI - Fraction(_PI_HIGH), 33)
_PI_LOW = float(_PI - Fraction(_PI_HIGH) - Fraction(_PI_MIDDLE))
_PER_PI = 1 / pi

_S3, _S5, _S7, _S9, _S11, _S13, _S15, _S17, _S19 = ((-1) ** (n // 2) / factorial(n) for n in range(3, 21, 2))
_C2, _C4, _C6, _C8, _C10, _C12, _C14, _C16, _C18, _C20 = ((-1) ** (n // 2) / factorial(n) for n in range(2, 22, 2))


@compiled
def fill_phasors(order: float, phase: Floats, cosine: Floats, sine: Floats) -> None:
    """Fill `cosine` and `sine`, (sample or more,) arrays, with those of `order * phase`, (sample,) in rad."""
    for n in range(phase.size):
        angle = order * phase[n]
        multiple = np.rint(angle * _PER_PI)
        rest = angle - multiple * _PI_HIGH
        rest = rest - multiple * _PI_MIDDLE
        rest = rest - multiple * _PI_LOW
        # Half a multiple is a whole number, or half away from one: where both functions change their sign.
        off = 0.5 * multiple - np.rint(0.5 * multiple)
        sign = 1.0 - 8.0 * off * off
        s = rest * rest
        odd = _S3 + s * (_S5 + s * (_S7 + s * (_S9 + s * (_S11 + s * (_S13 + s * (_S15 + s * (_S17 + s * _S19)))))))
        even = _C8 + s * (_C10 + s * (_C12 + s * (_C14 + s * (_C16 + s * (_C18 + s * _C20)))))
        even = 1.0 + s * (_C2 + s * (_C4 + s * (_C6 + s * even)))
        cosine[n] = sign * even
        sine[n] = sign * (rest + rest * s * odd)


def phasors(angle: Floats) -> Complexes:
    """Return exp(-j angle) of an array of any shape, in rad."""
    cosine, sine = np.empty(angle.size), np.empty(angle.size)
    fill_phasors(-1.0, angle.ravel(), cosine, sine)
    return (cosine + 1j * sine).reshape(angle.shape)
