"""Loops over samples and blocks of the extended Kalman filter and smoother of a slipping order; see `slip_tracking`.

A state is the real parts of A over the harmonics, their imaginary parts, the mean of the record, and the slip. The
filter in information form, with J and j, and the smoother are those of `signals.harmonics.node_chain`, for differences
from reference states: about these the record is linearised, and relative to their phase A is a random walk but for what
a difference ds of the slip turns it: A_k by j k (order times step of the phase) ds A_k.
"""

from typing import NamedTuple

import numpy as np

from signals._compile import compiled, compiled_sums_in_place
from signals.harmonics._chain_kernels import filter_forward, smooth_backward
from signals.harmonics._filter_kernels import dot
from signals.harmonics.state_space import Floats, Indices


class SlipChain(NamedTuple):
    """A record in blocks, divided by the standard deviation of its noise, and what the filter finds."""

    x: Floats  # (sample,), the record over the standard deviation of its noise
    angle: Floats  # (sample,), order times the angle of the shaft, in rad
    edges: Indices  # (block + 1,), first samples of the blocks and one past the last
    centres: Indices  # (block,), their middle samples
    process: Floats  # (block - 1, state), variances of the increments between blocks
    states: Floats  # (block, state), the reference; of the extended filter, the estimates
    slip_phase: Floats  # (block,), by which the reference has slipped in the middle of each block, in rad
    J: Floats  # (state, state), information on the difference from the first state, in the end from the last
    j: Floats  # (state, 1), the same
    gains: Floats  # (block, state, state), of `filter_forward`; once estimates are known, their covariances
    shares: Floats  # (block, state), of `filter_forward`
    offsets: Floats  # (block, state, 1), of `filter_forward`; once smoothed, the differences of the estimates


@compiled_sums_in_place
def _update(chain: SlipChain, m: int, h: Floats) -> float:
    """Update by block m: J + H^T H, j + H^T e, with e = x - h(state) and H = dh / dstate; return the sum of e^2."""
    state, size, harmonics = chain.states[m], h.size, h.size // 2 - 1
    total, h[-2] = 0.0, 1.0
    for n in range(chain.edges[m], chain.edges[m + 1]):
        lead = chain.angle[n] - chain.angle[chain.centres[m]]
        whole = chain.angle[n] + chain.slip_phase[m] + state[-1] * lead
        cosine, sine = np.cos(whole), np.sin(whole)
        c, s, e, h[-1] = 1.0, 0.0, chain.x[n] - state[-2], 0.0
        for k in range(harmonics):
            c, s = c * cosine - s * sine, s * cosine + c * sine
            h[k], h[harmonics + k] = c, -s
            e -= c * state[k] - s * state[harmonics + k]
            h[-1] -= (k + 1) * lead * (s * state[k] + c * state[harmonics + k])
        if not np.isnan(e):
            total += e * e
            for a in range(size):
                chain.j[a, 0] += h[a] * e
                for b in range(size):
                    chain.J[a, b] += h[a] * h[b]
    return total


@compiled_sums_in_place
def _turn(chain: SlipChain, m: int, state: Floats, M: Floats, v: Floats, back: bool, work: Floats) -> None:
    """Predict half of the way from block m to the next by F, or go back: T M T^T and T v.

    F = I + c e^T: the slip, of unit vector e, turns the amplitudes of the state by c. Of information, J and j, T is
    F^-T = I - e c^T; of a covariance P and a mean x, going back, F^-1 = I - c e^T. Scratch is (3, state).
    """
    c, e, product, size, harmonics = work[0], work[1], work[2], v.size, v.size // 2 - 1
    c[:], e[:], e[-1] = 0.0, 0.0, 1.0
    half = 0.5 * (chain.angle[chain.centres[m + 1]] - chain.angle[chain.centres[m]])
    for k in range(harmonics):
        c[k] = -(k + 1) * half * state[harmonics + k]
        c[harmonics + k] = (k + 1) * half * state[k]
    u, w = (c, e) if back else (e, c)
    for a in range(size):
        product[a] = dot(M[a], w)
    whole, level = dot(product, w), dot(w, v[:, 0])
    for a in range(size):
        v[a, 0] -= u[a] * level
        for b in range(size):
            M[a, b] -= u[a] * product[b] + u[b] * product[a] - u[a] * u[b] * whole


@compiled
def filter_blocks(chain: SlipChain, extended: bool) -> float:
    """Filter all blocks about the states of the chain or, as the extended Kalman filter, about each prediction.

    The extended filter starts from the first state and fills the others and their phase. Returns the sum of squared
    residuals; NaN where J is not positive.
    """
    J, j, states, (blocks, size) = chain.J, chain.j, chain.states, chain.states.shape
    no_data, no_score, h, squares = np.zeros((1, size**2)), np.zeros((1, size)), np.empty(size), np.zeros(1)
    total, P, work = 0.0, J, np.empty((3, size))
    for m in range(blocks):
        own = slice(m, m + 1)
        total += _update(chain, m, h)
        if extended:
            P = np.ascontiguousarray(np.linalg.inv(J))
            step = P @ j
            states[m] += step[:, 0]
            j[:] = 0.0
        if m + 1 < blocks:
            if extended:
                turn = chain.angle[chain.centres[m + 1]] - chain.angle[chain.centres[m]]
                states[m + 1], chain.slip_phase[m + 1] = states[m], chain.slip_phase[m] + states[m, -1] * turn
            # Predict: half of the way, the difference from the next state, its increments, and the other half.
            _turn(chain, m, states[m], J, j, False, work)
            for a in range(size):
                for b in range(size):
                    j[a, 0] -= J[a, b] * (states[m + 1, b] - states[m, b])
            filled = chain.gains[own], chain.shares[own], chain.offsets[own]
            if np.isnan(filter_forward(no_data, no_score, chain.process[own], False, J, j, *filled, squares)):
                return np.nan
            _turn(chain, m, states[m + 1], J, j, False, work)
        if extended:
            chain.gains[m] = P
    return total


@compiled
def smooth_blocks(chain: SlipChain) -> None:
    """Smooth what was filtered: fill the differences of the estimates from the states, and their covariances."""
    blocks, size = chain.states.shape
    no_data, row, unused = np.zeros((1, size**2)), np.empty(size), np.empty((1, size))
    work, P = np.empty((3, size)), np.ascontiguousarray(np.linalg.inv(chain.J))
    x = P @ chain.j
    chain.offsets[blocks - 1], chain.gains[blocks - 1] = x, P
    for m in range(blocks - 2, -1, -1):
        own = slice(m, m + 1)
        _turn(chain, m, chain.states[m + 1], P, x, True, work)
        smooth_backward(no_data, chain.gains[own], chain.shares[own], P, x, row, chain.offsets[own], unused, unused[0])
        x[:, 0] += chain.states[m + 1] - chain.states[m]
        _turn(chain, m, chain.states[m], P, x, True, work)
        chain.offsets[m], chain.gains[m] = x, P
