"""The numbers of pulses of which some are wrong: searched for around what is doubtful, counted on in between.

The search (`_repair_kernels.best_numbering`) begins at pulses known to be sound and goes from there onwards, and
backwards through the list mirrored. Away from faults the numberings that still compete have come to agree, so a search
that ends a while after the last doubtful interval, with pulses numbered one by one, ends as one through all would.
"""

import numpy as np
from numpy.typing import NDArray

from signals._checks import Array

Counts = NDArray[np.int64]

_ROUGH = 0.01  # standard deviations, in intervals, above which a place is foretold by two pulses or by three
_PRICE = 3.0  # of a missing or an extra pulse, in half squares of standard deviations
_BEAM = 24
_KNOWN = 3  # pulses that a search begins with
_BEFORE = 8  # pulses from the beginning of a search to the first doubtful interval
_AFTER, _LAPS_AFTER = 16, 3  # pulses, and laps of them, from the last one to its end
_SETTLED = 8  # pulses at its end that must be numbered one by one


def numbered(
    times: Array, pattern: Array, *, doubtful: NDArray[np.bool_], anchor: int, width: float
) -> tuple[Counts, Counts]:
    """Return the pulses kept and their numbers, (kept,) each, the pulse at the anchor being number zero.

    Parameters
    ----------
    times : (n,) array, s
    pattern : (stripe,) array
        Places of the stripes in the revolution.
    doubtful : (n - 1,) array
        Intervals around which to search.
    anchor : int
        The first of three sound pulses, a whole number of laps after the first stripe.
    width : float
        Standard deviation of a pulse's place, in intervals.
    """
    kept, counts = _onwards(times[anchor:], pattern, doubtful[anchor:], first=0, width=width)
    mirrored = np.concatenate([[0.0], 1 - pattern[:0:-1]])
    known = anchor + _KNOWN
    backwards = np.negative(times[:known][::-1], order="C")
    before, numbers = _onwards(backwards, mirrored, doubtful[: known - 1][::-1], first=1 - _KNOWN, width=width)
    return (
        np.concatenate([known - 1 - before[: _KNOWN - 1 : -1], anchor + kept]),
        np.concatenate([-numbers[: _KNOWN - 1 : -1], counts]),
    )


def _onwards(
    times: Array, pattern: Array, doubtful: NDArray[np.bool_], *, first: int, width: float
) -> tuple[Counts, Counts]:
    """Return the pulses kept and their numbers, the first three, known to be sound, numbered from `first` on."""
    from signals._repair_kernels import best_numbering  # noqa: PLC0415 - compiled at need

    kept, counts = [np.arange(_KNOWN)], [np.arange(first, first + _KNOWN)]
    done, following = _KNOWN, first + _KNOWN  # pulses seen to, and the number of the next
    for start, stop in _searches(doubtful, after=_AFTER + _LAPS_AFTER * pattern.size):
        if stop <= done:
            continue
        begin, end = max(start, done - _KNOWN), stop
        plain = begin + _KNOWN - done
        kept.append(done + np.arange(plain))
        counts.append(following + np.arange(plain))
        while True:
            places, numbers = best_numbering(
                times[begin:end], pattern, following + plain - _KNOWN, _BEAM, width, width > _ROUGH, _PRICE
            )
            if end == times.size or _settled(places, numbers, end - begin):
                break
            end = min(times.size, 2 * end - begin)
        kept.append(begin + places[_KNOWN:])
        counts.append(numbers[_KNOWN:])
        done, following = end, int(numbers[-1]) + 1
    return np.concatenate(kept), np.concatenate(counts)


def _searches(doubtful: NDArray[np.bool_], *, after: int) -> list[tuple[int, int]]:
    """Return the pulses, from and up to without, between which to search, in order; always the end of the list."""
    last = doubtful.size  # the last pulse, beyond which nothing tells
    places = np.append(np.flatnonzero(doubtful), last)
    apart = np.flatnonzero(np.diff(places) > after + _BEFORE)
    begins = np.maximum(places[np.append(0, apart + 1)] - _BEFORE, 0)
    ends = np.minimum(places[np.append(apart, places.size - 1)] + 1 + after, last + 1)
    begins[-1] = max(min(int(begins[-1]), last - after), 0)
    return [(int(begin), int(end)) for begin, end in zip(begins, ends, strict=True)]


def _settled(places: Counts, numbers: Counts, pulses: int) -> bool:
    """Whether the last of the pulses are numbered one by one."""
    tail = slice(-_SETTLED, None)
    return bool(
        places.size >= _SETTLED + _KNOWN
        and places[-_SETTLED] == pulses - _SETTLED
        and np.all(np.diff(numbers[tail]) == 1)
    )
