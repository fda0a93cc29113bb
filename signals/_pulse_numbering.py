"""Numbering of pulses of which some are missing or extra: a search around doubtful intervals, a count in between.

The search (`_repair_kernels.best_numbering`) begins at sound pulses and goes forwards, and backwards over the
time-reversed list. A while after the last fault all surviving numberings agree, so that a search may end there with
the result that one through the whole list would have.
"""

import numpy as np
from numpy.typing import NDArray

from signals._checks import Array

Counts = NDArray[np.int64]

_ROUGH = 0.01  # prediction error in intervals from which predictions by two and by three pulses are both allowed
_FAULT_COST = 3.0  # of a missing or an extra pulse, as a negative log likelihood
_BEAM = 24
_SEEDS = 3  # sound pulses that a search begins with
_BEFORE = 8  # pulses from the beginning of a search to the first doubtful interval
_AFTER, _REVS_AFTER = 16, 3  # pulses, and revolutions of them, from the last doubtful interval to its end
_CONVERGED = 8  # pulses at its end whose numbers must be consecutive


def numbered(
    times: Array, positions: Array, *, doubtful: NDArray[np.bool_], anchor: int, std: float
) -> tuple[Counts, Counts]:
    """Return the indices of the pulses kept and their numbers, (kept,) each, that at the anchor being zero.

    Parameters
    ----------
    times : (n,) array
        Pulse times in s.
    positions : (stripe,) array
        Angles of the stripes in revolutions.
    doubtful : (n - 1,) array
        Intervals around which to search.
    anchor : int
        Index of the first of three sound pulses, a pulse of the first stripe.
    std : float
        Standard deviation of the prediction error of a pulse, in intervals.
    """
    kept, counts = _numbered_forwards(times[anchor:], positions, doubtful[anchor:], first=0, std=std)
    reversed_positions = np.concatenate([[0.0], 1 - positions[:0:-1]])
    stop = anchor + _SEEDS
    reversed_times = np.negative(times[:stop][::-1], order="C")
    before, numbers = _numbered_forwards(
        reversed_times, reversed_positions, doubtful[: stop - 1][::-1], first=1 - _SEEDS, std=std
    )
    return (
        np.concatenate([stop - 1 - before[: _SEEDS - 1 : -1], anchor + kept]),
        np.concatenate([-numbers[: _SEEDS - 1 : -1], counts]),
    )


def _numbered_forwards(
    times: Array, positions: Array, doubtful: NDArray[np.bool_], *, first: int, std: float
) -> tuple[Counts, Counts]:
    """Return the indices of the pulses kept and their numbers; the first three are sound, numbered from `first`."""
    from signals._repair_kernels import best_numbering  # noqa: PLC0415 - compiled at need

    kept, counts = [np.arange(_SEEDS)], [np.arange(first, first + _SEEDS)]
    done, following = _SEEDS, first + _SEEDS  # pulses numbered so far, and the number of the next
    for start, stop in _searches(doubtful, after=_AFTER + _REVS_AFTER * positions.size):
        if stop <= done:
            continue
        begin, end = max(start, done - _SEEDS), stop
        sound = begin + _SEEDS - done  # pulses before the search, counted one by one
        kept.append(done + np.arange(sound))
        counts.append(following + np.arange(sound))
        while True:
            indices, numbers = best_numbering(
                times[begin:end], positions, following + sound - _SEEDS, _BEAM, std, std > _ROUGH, _FAULT_COST
            )
            if end == times.size or _converged(indices, numbers, end - begin):
                break
            end = min(times.size, 2 * end - begin)
        kept.append(begin + indices[_SEEDS:])
        counts.append(numbers[_SEEDS:])
        done, following = end, int(numbers[-1]) + 1
    return np.concatenate(kept), np.concatenate(counts)


def _searches(doubtful: NDArray[np.bool_], *, after: int) -> list[tuple[int, int]]:
    """Return the first pulse of each search and that after its last, in order; the end of the list is always searched.

    The last pulse has no interval after it to confirm it.
    """
    last = doubtful.size
    index = np.append(np.flatnonzero(doubtful), last)
    apart = np.flatnonzero(np.diff(index) > after + _BEFORE)
    begins = np.maximum(index[np.append(0, apart + 1)] - _BEFORE, 0)
    ends = np.minimum(index[np.append(apart, index.size - 1)] + 1 + after, last + 1)
    begins[-1] = max(min(int(begins[-1]), last - after), 0)
    return [(int(begin), int(end)) for begin, end in zip(begins, ends, strict=True)]


def _converged(indices: Counts, numbers: Counts, pulses: int) -> bool:
    """Return whether the last pulses of a search are all kept, with consecutive numbers."""
    tail = slice(-_CONVERGED, None)
    return bool(
        indices.size >= _CONVERGED + _SEEDS
        and indices[-_CONVERGED] == pulses - _CONVERGED
        and np.all(np.diff(numbers[tail]) == 1)
    )
