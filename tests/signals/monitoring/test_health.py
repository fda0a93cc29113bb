import numpy as np
import pytest

from signals.monitoring.health import Layout, Prior, fused_scores, learn_normal, out_of_sample, regime

SERIES = 12
LAYOUT = Layout(
    components=((np.arange(6),), (np.arange(6, 12),)),
    channels=(np.arange(10),),
    powers=np.array([1.0] * 8 + [2.0] * 2 + [0.0] * 2),
)
PRIOR = Prior(series=np.full(SERIES, 0.2), score=0.6, level=0.1, dof=8.0)


def values(records, seed, *, sigma=0.2):
    return sigma * np.random.default_rng(seed).standard_normal((records, SERIES))


def layout(*components):
    return Layout(components=components, powers=np.zeros(40))


def none(records):
    return np.zeros((records, 0))


NORMAL = learn_normal(values(100, 1), none(100), LAYOUT, PRIOR)


def test_new_records_score_about_nothing():
    scores = NORMAL.read(values(2000, 2), none(2000)).scores[:, :2]
    # mean of 2000 with the error of the mean of 100; the scale of 100 within 4 / sqrt(200)
    assert scores.mean(axis=0) == pytest.approx([0, 0], abs=4 * np.sqrt(1 / 100 + 1 / 2000))
    assert scores.std(axis=0) == pytest.approx([1, 1], rel=0.3)


def test_a_gain_that_drifts_is_the_channels_and_no_components():
    seen = values(50, 3)
    before, after = (NORMAL.read(seen + shift * LAYOUT.powers, none(50)) for shift in (0.0, 0.7))
    assert after.scores[:, :2] == pytest.approx(before.scores[:, :2], abs=1e-9)
    assert after.level - before.level == pytest.approx(np.full((50, 1), 0.7), abs=1e-9)
    assert np.median(after.scores[:, 2]) > 5  # the level rises: 0.7 of about 0.1


def test_a_fault_in_one_component_is_its_own():
    seen = values(50, 4)
    seen[:, :2] += 1.2
    scores = NORMAL.read(seen, none(50)).scores
    assert scores[:, 0].mean() > 4
    assert abs(scores[:, 1].mean()) < 1


def test_a_sudden_fall_shows_and_a_slow_one_does_not():
    sudden, slow = np.r_[np.zeros(30), -np.ones(10)], -np.linspace(0, 1, 400)
    for course, falls in ((sudden, True), (slow, False)):
        recent, found = None, []
        for number, shift in enumerate(course):
            reading = NORMAL.read(values(1, 100 + number)[0] + shift * LAYOUT.powers, np.zeros(0), recent)
            recent = reading.recent
            found.append(reading.scores[3])
        assert (max(np.sort(found)[-2:]) > 6) == falls


def test_the_regime_is_what_was_learned_and_a_little_more():
    low, high = regime(np.array([[10.0], [20.0]]))
    assert (low[0], high[0]) == pytest.approx((10 - 1 - 0.75, 20 + 1 + 0.75))


def test_the_mean_of_the_largest_third():
    departures = np.array([[1.0, 5, 2, 4, 0, -9], [np.nan, np.nan, 3, 1, 2, np.nan]])
    found = fused_scores(departures, layout([np.arange(6)], [np.arange(2)]))
    assert found[0] == pytest.approx([4.5, 5.0])  # 5 and 4 of six; 5 of two
    assert found[1, 0] == 3.0  # one of three known
    assert np.isnan(found[1, 1])  # none of two known


def test_a_kind_is_not_diluted_by_the_others():
    departures = np.zeros(40)
    departures[:10] = 3.0
    ten = [np.arange(10 * kind, 10 * (kind + 1)) for kind in range(4)]
    assert fused_scores(departures, layout(ten)) == pytest.approx([3.0])
    assert fused_scores(departures, layout([np.arange(40)]))[0] == pytest.approx(30 / 14)  # of the largest 14
    departures[:6] = np.nan  # more than half of the kind
    assert fused_scores(departures, layout(ten)) == pytest.approx([0.0])


def test_departures_of_a_baseline_from_its_own_mean():
    drawn = np.random.default_rng(1).standard_normal((40_000, 4))
    own = (drawn - drawn.mean(axis=1, keepdims=True)).std()
    new = (np.random.default_rng(2).standard_normal(40_000) - drawn.mean(axis=1)).std()
    assert out_of_sample(4, np.zeros(1)) == pytest.approx(new / own, rel=0.02)
