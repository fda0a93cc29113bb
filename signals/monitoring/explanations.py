"""Comparison of explanations of a change of many series: parts, a common change of a channel, or what is unknown.

The change z of N series, standardised by its scatter in health, less the change that channels have in common. Negative
values count as none. An explanation predicts a change of its own series, and consequences in others, none of which
exceeds its cause:

    L = sum over own (z^2 / 2 - ln 2) + sum over others max(0, (z^2 - max(0, z - a)^2) / 2 - c),   a = max over own z,

with c = ln 4 for series that are related to its own, and ln N for the rest: the log likelihood ratio of the best means
within these bounds to no change, less the information that states which of the series change, in nats (minimum
description length; Rissanen 1978, Automatica 14(5), 465-471) if each of the own series does with probability 1/2, a
related one with 1/4, and any other with 1/N (our choice).
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_OWN, _RELATED = math.log(2), math.log(4)


def evidence(
    change: Array, own: NDArray[np.bool_], related: NDArray[np.bool_], alike: Sequence[Sequence[NDArray[np.int64]]]
) -> tuple[Array, Array, float]:
    """Return the evidence of each explanation of a change, of a common change of each channel, and of any change.

    Parameters
    ----------
    change : (series,) array
        Change of each series, in standard deviations of its scatter in health.
    own, related : (explanations, series) array
        Series whose change each explanation predicts, and those in which it may have consequences.
    alike : sequence of sequence of (k,) int array
        Of each channel, groups of like series of many components: their median is what they have in common.

    Returns
    -------
    (explanations,) array, (channels,) array, float
        Log likelihood ratios to no change, less the cost of what is predicted, in nats: of each explanation, with a
        common change of channels beside it; of what the series of each channel have in common, alone; and of a change
        of any series, without a pattern.

    Examples
    --------
    A large change of the first of two pairs, and a smaller one of the second:

    >>> import numpy as np
    >>> from signals.monitoring.explanations import evidence
    >>> own = np.array([[True, True, False, False], [False, False, True, True]])
    >>> found = evidence(np.array([6.0, 5.0, 3.0, 0.0]), own, ~own, [])
    >>> [round(float(one), 1) for one in found[0]]
    [32.2, 24.3]
    """
    common, channels = np.zeros_like(change), np.zeros(len(alike))
    for number, groups in enumerate(alike):
        for those in groups:
            common[those] = np.median(change[those])
            channels[number] += (change[those] ** 2 - (change - common)[those] ** 2).sum() / 2 - _OWN
    beside, rise = np.maximum(channels, 0).sum(), np.maximum(change - common, 0)
    cause = np.where(own, rise, 0).max(axis=1, keepdims=True)
    explained = (rise**2 - np.maximum(rise - cause, 0) ** 2) / 2
    anywhere = math.log(change.size)
    consequences = np.maximum(explained - np.where(related, _RELATED, anywhere), 0)
    parts = np.where(own, explained - _OWN, consequences).sum(axis=1)
    return parts + beside, channels, float(np.maximum(rise**2 / 2 - anywhere, 0).sum() + beside)
