"""Compiled products with small matrices. Each operation is rounded as written."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_inline

Array = NDArray[np.float64]


@compiled_inline
def add_columns(columns: Array, x: Array, out: Array, first: int) -> None:
    """Add the product with a matrix whose columns are the rows of `columns`, from the first on: four at a time."""
    width = out.size
    for j in range(first, x.size, 4):
        one, two, a, b = columns[j], columns[j + 1], x[j], x[j + 1]
        three, four, c, d = columns[j + 2], columns[j + 3], x[j + 2], x[j + 3]
        for i in range(width):
            out[i] += (one[i] * a + two[i] * b) + (three[i] * c + four[i] * d)


@compiled_inline
def apply_columns(columns: Array, added: Array, x: Array, out: Array) -> None:
    """Multiply by a matrix whose columns are the rows of `columns`, and add. The number of columns is even."""
    size, width = x.size, out.size
    one, two, a, b = columns[0], columns[1], x[0], x[1]
    if size % 4 == 0:
        three, four, c, d = columns[2], columns[3], x[2], x[3]
        for i in range(width):
            out[i] = added[i] + ((one[i] * a + two[i] * b) + (three[i] * c + four[i] * d))
    else:
        for i in range(width):
            out[i] = added[i] + (one[i] * a + two[i] * b)
    add_columns(columns, x, out, 4 if size % 4 == 0 else 2)
