"""Numbers of a record under names that other records share: its lines, its indicators."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

LINE = ("channel", "spectrum", "component", "kind", "harmonic", "sideband", "units")
INDICATOR = ("channel", "component", "kind", "indicator", "units")


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """Numbers of a record (keys, columns) under keys that other records share: the same tuple for equal ones."""

    keys: tuple[Any, ...]
    values: NDArray[Any]


NOTHING = Numbers(keys=(), values=np.zeros((0, 4)))  # of a record without lines or indicators


def named(rows: Iterable[Sequence[Any]], names: int, numbers: int) -> Numbers:
    """Return rows of that many names, and of numbers."""
    taken = [tuple(row) for row in rows]
    values = np.array([row[names:] for row in taken], dtype=np.float64).reshape(len(taken), numbers)
    return Numbers(keys=_shared(tuple(row[:names] for row in taken)), values=values)


@lru_cache(maxsize=256)
def _shared(keys: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the first tuple that equals this one, so that what follows from it is found by its identity."""
    return keys
