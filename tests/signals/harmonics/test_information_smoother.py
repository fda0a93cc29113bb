"""The information smoother against least squares over all nodes at once."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signals.harmonics import _information_smoother
from signals.harmonics._information_kernels import marginalise
from signals.harmonics._information_smoother import Information, NodeChain, information_at_end, smooth_chain

LINES, NODES, BLOCK, LANES = 4, 40, 8, 2


def scene(poles, *, nodes=NODES, prior=100.0):
    """Return a chain of close lines, and what it sums up: regressors, (node, sample, state), and data, (.., lane)."""
    rng = np.random.default_rng(0)
    angle = 2 * np.pi * (0.05 + 5e-3 * np.arange(LINES))[:, None] * np.arange(nodes * BLOCK)
    columns = np.concatenate([np.cos(angle), np.sin(angle)]).T.reshape(nodes, BLOCK, -1)
    y = 5 * rng.standard_normal((nodes, BLOCK, LANES))
    u = np.arange(BLOCK) / BLOCK
    powers = u[:, None] ** np.arange(2 * poles - 1)
    differences = [
        np.prod([(u + k - 2 - i) / (i + 1) for i in range(k)], axis=0) * np.ones(BLOCK) for k in range(poles)
    ]
    # The levels last.
    regressors = np.concatenate([rise[:, None] * columns for rise in differences[::-1]], axis=2)
    width = columns.shape[2]
    before = Information.prior(prior * 0.1 ** (2 * np.arange(poles))[:, None] * np.ones(width), LANES)
    chain = NodeChain(
        gram=np.einsum("nm,kna,knb->kmab", powers, columns, columns),
        data=np.einsum("nm,kna,knl->kmal", powers[:, :poles], columns, y),
        nodes=nodes,
        process_noise=1e-3 * 0.1 ** (2 * poles - 2) * rng.uniform(0.5, 2, (nodes, width)),
        before=before,
        after=before.none(),
    )
    return chain, regressors, y


def least_squares(chain, regressors, y, first=0):
    """Levels, their variances, the variance explained at each node, and the log variance of the innovations."""
    nodes, poles, width, _ = chain.data.shape
    size, steps = poles * width, (nodes - 1) * width
    turn = np.kron(np.tril(np.ones((poles, poles))), np.eye(width))
    path = np.zeros((nodes, size, size + steps))  # of a first state and all increments
    path[0, :, :size] = np.eye(size)
    for k in range(1, nodes):
        path[k] = path[k - 1]
        path[k, :width, size + (k - 1) * width : size + k * width] += np.eye(width)
        path[k] = turn @ path[k]
    information = np.diag(np.concatenate([np.diag(chain.before.matrix), 1 / chain.process_noise[:-1].ravel()]))
    score = np.zeros((size + steps, y.shape[2]))
    for k in range(nodes):
        if k == first:
            log_before = np.linalg.slogdet(information)[1]
        rows = regressors[k] @ path[k]
        information += rows.T @ rows
        score += rows.T @ y[k]
    covariance = np.linalg.inv(information)
    levels = path[:, size - width :]
    joint = levels @ covariance @ levels.transpose(0, 2, 1)
    explained = np.einsum("kab,kba->k", joint, chain.gram[:, 0])
    variances = np.diagonal(joint, axis1=1, axis2=2)
    return levels @ (covariance @ score), variances, explained, np.linalg.slogdet(information)[1] - log_before


# Matrices with condition numbers of up to 1e8, from the prior of 1e6 to increments of 1e-9.
@pytest.mark.parametrize("poles", [1, 2, 3, 4])
@pytest.mark.parametrize("prior", [100.0, 1e6])
def test_it_is_least_squares(poles, prior):
    scenery = scene(poles, prior=prior)
    levels, variances, explained, log_variance = least_squares(*scenery, first=7)
    found = smooth_chain(scenery[0], first=7)
    assert np.max(np.abs(found.levels - levels) / np.sqrt(variances)[..., None]) < 1e-6
    assert_allclose(found.variances, variances, rtol=1e-6)
    assert_allclose(found.explained, explained, rtol=1e-6)
    assert found.log_variance == pytest.approx(log_variance, abs=1e-5)


@pytest.mark.parametrize("poles", [1, 3])
def test_stretches_change_nothing_but_memory(poles, monkeypatch):
    chain, _, _ = scene(poles)
    whole = smooth_chain(chain, first=11)
    monkeypatch.setattr(_information_smoother, "STRETCH_NUMBERS", 1)
    parts = smooth_chain(chain, first=11)
    for one, other in zip(whole, parts, strict=True):
        assert_allclose(one, other, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("poles", [1, 2, 4])
def test_what_lies_outside_a_range_of_nodes_takes_its_place(poles):
    chain, _, _ = scene(poles)
    whole = smooth_chain(chain, first=0)
    nodes = slice(12, 25)
    before, after = chain.outside(nodes)
    inner = NodeChain(
        gram=chain.gram[nodes], data=chain.data[nodes], nodes=13, process_noise=chain.process_noise[nodes],
        before=before, after=after,
    )  # fmt: skip
    part = smooth_chain(inner, first=0)
    assert_allclose(part.levels, whole.levels[nodes], rtol=1e-7, atol=1e-9)
    assert_allclose(part.variances, whole.variances[nodes], rtol=1e-7)


@pytest.mark.parametrize("poles", [1, 2, 4])
def test_information_is_carried_to_the_last_node(poles):
    """Of the last node past and data are all there is: what is carried there gives its levels."""
    chain, _, _ = scene(poles)
    whole, known = smooth_chain(chain, first=0), information_at_end(chain)
    state = np.linalg.solve(known.matrix, known.vector)
    assert_allclose(state[-2 * LINES :], whole.levels[-1], rtol=1e-7, atol=1e-9)


def test_a_state_is_integrated_out():
    """`log det J` and `j J^-1 j` by LAPACK, and no number where J is not positive."""
    rng = np.random.default_rng(2)
    root, vector = rng.standard_normal((6, 6)), rng.standard_normal((6, 3))
    matrix = root @ root.T + np.eye(6)
    squares, ones, scratch = np.ones(3), np.ones((1, 6)), np.empty(6)
    log_determinant = marginalise(ones, 0, True, matrix.copy(), vector.copy(), scratch, squares)
    assert log_determinant == pytest.approx(np.linalg.slogdet(matrix)[1])
    assert_allclose(squares, 1 + np.sum(vector * np.linalg.solve(matrix, vector), axis=0), rtol=1e-12)
    assert np.isnan(marginalise(ones, 0, True, matrix - 3 * np.eye(6), vector.copy(), scratch, squares))
