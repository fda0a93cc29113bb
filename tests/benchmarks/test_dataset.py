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
    assert np.mean(guess[~apart] == classes[~apart]) < 0.4  # nine classes of one distribution


def test_missing_features_are_medians_of_training():
    table = pd.DataFrame({"a": [1.0, 3.0, np.nan, 100.0], "b": [np.nan] * 4, "c": [1.0] * 4})
    x = dataset.standardised(table, np.array([True, True, False, False]))
    assert x == pytest.approx(np.array([[-1.0], [1.0], [0.0], [4.0]]))


def test_the_page_has_the_score_of_each_class():
    # features name every class but wear, whose test records look like eccentricity
    names = np.tile(np.repeat(dataset.CLASSES, 6), 3)
    number = np.array([dataset.CLASSES.index(name) for name in names])
    split = np.repeat(["train", "validation", "test"], names.size // 3)
    shown = np.where((names == "wear") & (split == "test"), dataset.CLASSES.index("eccentricity"), number)
    labels = pd.DataFrame(
        {
            "class": names,
            "split": split,
            "severity": np.tile([0.1, 0.5, 0.9], names.size // 3),
            "detectability_db": np.tile([10.0, 20.0, 60.0], names.size // 3),
            "component": "stage 1/shaft",
        }
    )
    features = pd.DataFrame(np.eye(len(dataset.CLASSES))[shown])
    plan = {"title": "benchmark-1 0: made up", "records": names.size, "seed": 1}
    said = [[("stage 1/shaft", "tooth", "indicated")] if name == "crack" else [] for name in names]
    said[0] = [("b", "cage", "diagnosed")]  # of a healthy machine
    said[names.tolist().index("spall") + 2] = [("stage 2/shaft", "tooth", "diagnosed")]
    page = dataset.page_of(labels, features, said, plan, "")
    assert "78 for training, 78 for the penalty" in page
    assert "Balanced accuracy 0.92 on test (1.00 on training)" in page  # twelve of thirteen
    assert "| wear | 6 | 0.00 |  | eccentricity |" in page
    assert "| eccentricity | 6 | 1.00 | 0.50 |  |" in page
    assert "| crack | 6 | 1.00 | 1.00 |  |" in page
    # of 24 faults of a third of severity, two of wear are wrong
    assert "| severity 0.00 to 0.33 | 24 | 0.92 |" in page
    assert "| detectability above 50 dB | 24 | 0.92 |" in page
    assert "| healthy | 18 |  |  |  | 1 |" in page
    assert "| crack | 18 | 6 | 6 | 0 | 0 |" in page
    assert "| spall | 18 | 6 | 0 | 1 | 1 |" in page
    assert "| wear | 18 |  |  |  | 0 |" in page
