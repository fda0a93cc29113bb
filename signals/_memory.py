"""Room for large results, used again once nobody holds them.

Fresh memory costs more than what is written into it: the system clears it, page by page, before it hands it out. So
the room of a result that is gone waits for the next one. It is offered to the system, which takes it back whenever
memory runs short, at no cost to anyone who asks again before that. Systems that know no such offer get their memory
back at once.
"""

import mmap
from collections import deque
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Bytes from which fresh memory is asked of the system rather than found in the heap; rooms that wait at a time; how
# many times too large one may be.
LARGE = 1 << 22
WAITING = 4
SPACIOUS = 2.0
# Numbers in a line of the cache.
LINE = 8

_OFFER: int | None = getattr(mmap, "MADV_FREE", None)
_HUGE: int | None = getattr(mmap, "MADV_HUGEPAGE", None)

# The oldest goes for good where there are more.
_waiting: deque[mmap.mmap] = deque(maxlen=WAITING)


def room(*shape: int) -> NDArray[np.float64]:
    """Return an array of numbers, whichever, that begins where a line of the cache does."""
    count = prod(shape)
    size = count * np.dtype(np.float64).itemsize
    if size < LARGE or _OFFER is None:
        array = np.empty(count + LINE)
        start = -(array.ctypes.data // array.itemsize) % LINE
        return array[start : start + count].reshape(shape)
    return np.asarray(_Loan(_found(size) or _fresh(size), _OFFER))[:count].reshape(shape)


def _found(size: int) -> mmap.mmap | None:
    """Return a room that waits and does."""
    for _ in range(len(_waiting)):
        try:
            memory = _waiting.popleft()
        except IndexError:  # another thread took the last one
            break
        if size <= len(memory) <= SPACIOUS * size:
            return memory
        _waiting.append(memory)
    return None


def _fresh(size: int) -> mmap.mmap:
    memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    if _HUGE is not None:
        memory.madvise(_HUGE)
    return memory


class _Loan:
    """Memory that arrays rest on: when the last of them goes, it waits for the next."""

    def __init__(self, memory: mmap.mmap, offer: int) -> None:
        self._memory, self._offer, self._waiting = memory, offer, _waiting
        count = len(memory) // np.dtype(np.float64).itemsize
        self.__array_interface__: dict[str, Any] = np.frombuffer(memory, count=count).__array_interface__

    def __del__(self) -> None:
        self._memory.madvise(self._offer)
        self._waiting.append(self._memory)
