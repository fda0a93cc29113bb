"""Arithmetic on unevaluated sums of two doubles, about 32 digits: lanes or single numbers alike.

A number is a pair (high, low), the low part at most half a unit in the last place of the high one. The error of a sum
follows from the sum itself (Knuth), that of a product from one fused operation (Dekker) [1]_.

References
----------
.. [1] T. J. Dekker, "A floating-point technique for extending the available precision", Numer. Math. 18, 1971.
"""

from typing import Any

import numpy as np

from signals._compile import compiled_exactly
from signals._lanes import minus, multiply_add, negative, plus, times

Pair = tuple[Any, Any]


@compiled_exactly
def normalised(high: Any, low: Any) -> Pair:  # noqa: ANN401
    """Return the pair of the same sum whose high part is the rounded sum; the low part must be the smaller."""
    whole = plus(high, low)
    return whole, minus(low, minus(whole, high))


@compiled_exactly
def add(a_high: Any, a_low: Any, b_high: Any, b_low: Any) -> Pair:  # noqa: ANN401
    """Return a + b."""
    whole = plus(a_high, b_high)
    part = minus(whole, a_high)
    error = plus(minus(a_high, minus(whole, part)), minus(b_high, part))
    return normalised(whole, plus(error, plus(a_low, b_low)))


@compiled_exactly
def multiply(a_high: Any, a_low: Any, b_high: Any, b_low: Any) -> Pair:  # noqa: ANN401
    """Return a b, the same to the last bit for b a."""
    whole = times(a_high, b_high)
    error = multiply_add(a_high, b_high, negative(whole))
    return normalised(whole, plus(error, plus(times(a_high, b_low), times(a_low, b_high))))


@compiled_exactly
def add_product(c_high: Any, c_low: Any, a_high: Any, a_low: Any, b_high: Any, b_low: Any) -> Pair:  # noqa: ANN401
    """Return c + a b, the same to the last bit for c + b a."""
    whole = times(a_high, b_high)
    error = multiply_add(a_high, b_high, negative(whole))
    error = plus(error, plus(times(a_high, b_low), times(a_low, b_high)))
    return add(c_high, c_low, whole, error)


@compiled_exactly
def inverse_root(high: float, low: float) -> tuple[float, float]:
    """Return 1 / sqrt of a single positive number: Newton's step from the double."""
    first = 1.0 / np.sqrt(high)
    square = multiply(first, 0.0, first, 0.0)
    left = multiply(high, low, *square)
    rest = add(1.0, 0.0, -left[0], -left[1])
    return normalised(first, 0.5 * first * rest[0])
