import math

import numpy as np
import pytest
from scipy.stats import chi2

from signals.monitoring.explanations import evidence

OWN = np.kron(np.eye(4), np.ones(5)).astype(bool)  # four parts of five series
ALIKE = [[np.arange(20)]]


def test_scores_are_those_of_the_equation():
    change = np.abs(np.random.default_rng(0).normal(0, 3, 20))
    related = np.roll(OWN, 5, axis=1)
    parts, _, unknown = evidence(change, OWN, related, [])
    for part, found in enumerate(parts):
        cause, total = change[OWN[part]].max(), 0.0
        for z, own, near in zip(change, OWN[part], related[part], strict=True):
            gain = (z**2 - max(0.0, z - cause) ** 2) / 2
            total += gain - math.log(2) if own else max(0.0, gain - math.log(4 if near else 20))
        assert found == pytest.approx(total, rel=1e-12)
    assert unknown == pytest.approx(sum(max(0.0, z**2 / 2 - math.log(20)) for z in change), rel=1e-12)


def test_noise_explains_a_part_as_seldom_as_its_cost_says():
    rng = np.random.default_rng(1)
    found = np.array([evidence(rng.normal(size=20), OWN, ~OWN & False, [])[0] for _ in range(1000)])
    over = [math.comb(5, k) / 32 * chi2.sf(10 * math.log(2), k) for k in range(1, 6)]  # k of five values are positive
    assert (found > 0).mean() == pytest.approx(sum(over), abs=0.02)  # 4 sqrt(0.06 / 4000), and rare consequences


@pytest.mark.parametrize("part", range(4))
def test_the_part_whose_series_change_most_is_the_cause_of_others(part):
    change = np.where(OWN[part], 8.0, 3.0)
    parts, _, unknown = evidence(change, OWN, ~OWN, [])
    assert parts.argmax() == part
    assert parts[part] > unknown


def test_what_is_predicted_and_not_seen_counts_against_a_part():
    narrow, wide = np.arange(20) < 2, np.arange(20) < 10
    change = np.where(narrow, 6.0, 0.0)
    parts, *_ = evidence(change, np.array([narrow, wide]), np.zeros((2, 20), dtype=bool), [])
    assert parts[0] - parts[1] == pytest.approx(8 * math.log(2))


def test_a_common_change_is_the_channels_and_no_parts():
    change = np.full(20, 4.0)
    change[OWN[2]] += 5
    alone = evidence(change - 4, OWN, ~OWN, ALIKE)
    parts, channels, unknown = evidence(change, OWN, ~OWN, ALIKE)
    assert channels[0] > 100  # 15 squares of 4, and what the others share of them
    assert parts - channels[0] == pytest.approx(alone[0], abs=1e-9)
    assert unknown - channels[0] == pytest.approx(alone[2], abs=1e-9)
