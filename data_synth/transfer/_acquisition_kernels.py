"""Compiled impulse responses by recursion from sample to sample, with strict rounding."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_exactly

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@compiled_exactly
def add_decays(
    signal: Array,
    firsts: NDArray[np.int64],
    initial_states: ComplexArray,
    steps: ComplexArray,
) -> None:
    """Add ``Re sum_p s_p`` to a signal, where each s_p is multiplied by its step at each sample and impacts add to it.

    Parameters
    ----------
    signal : (n,) array
    firsts : (m,) int array
        First sample at or after each impact, rising.
    initial_states : (m, p) complex array
        Contribution of each impact to each s_p at that sample.
    steps : (p,) complex array
        ``exp(pole / rate)``.
    """
    state = np.zeros(steps.size, dtype=np.complex128)
    impact = 0
    for sample in range(signal.size):
        while impact < firsts.size and firsts[impact] <= sample:
            for p in range(steps.size):
                state[p] += initial_states[impact, p]
            impact += 1
        total = 0.0
        for p in range(steps.size):
            total += state[p].real
            state[p] *= steps[p]
        signal[sample] += total


@compiled_exactly
def add_pole_responses(
    out: Array,
    drive: Array,
    decays: ComplexArray,
    weights_new: ComplexArray,
    weights_old: ComplexArray,
    states: ComplexArray,
) -> None:
    """Add ``Re sum_p s_p`` to `out`, ``s_p[n] = decay_p s_p[n - 1] + new_p drive[n + 1] + old_p drive[n]``.

    Parameters
    ----------
    out : (n,) array
    drive : (n + 1,) array
    decays, weights_new, weights_old : (p,) complex array
    states : (p,) complex array
        States before the first sample; on return, after the last one.
    """
    for sample in range(out.size):
        old, new = drive[sample], drive[sample + 1]
        total = 0.0
        for p in range(decays.size):
            states[p] = decays[p] * states[p] + weights_new[p] * new + weights_old[p] * old
            total += states[p].real
        out[sample] += total
