"""The page on benchmark-1: its classifier separates what can be separated, and nothing else."""

import dataset
import numpy as np
import pandas as pd
import pytest


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(1)
    classes = np.repeat(np.arange(len(dataset.CLASSES)), 20)
    return rng.standard_normal((classes.size, 4)) + 6 * np.eye(len(dataset.CLASSES), 4)[classes], classes


def test_classes_apart_are_told_apart_and_the_others_guessed(rows):
    x, classes = rows
    guess = dataset.predicted(x, dataset.fitted(x, classes, penalty=1e-3))
    apart = classes < 4
    assert np.mean(guess[apart] == classes[apart]) > 0.95
    assert np.mean(guess[~apart] == classes[~apart]) < 0.4  # seven classes of one distribution


def test_a_heavy_penalty_leaves_equal_odds(rows):
    x, classes = rows
    weights = dataset.fitted(x, classes, penalty=1e6)
    assert np.abs(weights[:-1]).max() < 1e-3
    assert np.ptp(weights[-1]) < 1e-2  # classes are weighted equally


def test_balanced_accuracy_is_the_mean_recall():
    true, guess = np.array([0, 0, 0, 0, 1, 1]), np.array([0, 0, 0, 1, 1, 0])
    assert dataset.balanced_accuracy(true, guess) == pytest.approx((3 / 4 + 1 / 2) / 2)


def test_missing_features_are_medians_of_training():
    table = pd.DataFrame({"a": [1.0, 3.0, np.nan, 100.0], "b": [np.nan] * 4, "c": [1.0] * 4})
    x = dataset.standardised(table, np.array([True, True, False, False]))
    assert x == pytest.approx(np.array([[-1.0], [1.0], [0.0], [4.0]]))
