"""The comb of an average against sums of phasors, and its nulls."""

from fractions import Fraction

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st

from signals.angle.averaging import comb_gain, quietest_revolutions

ORDER = Fraction(641, 20)  # 32.05


class TestGain:
    @pytest.mark.parametrize(("revolutions", "decibels"), [(10, 3.89), (16, 12.58)])
    def test_a_tone_at_32_05_orders(self, revolutions, decibels):
        gain = comb_gain([32.05, ORDER], revolutions=revolutions)
        np.testing.assert_allclose(-20 * np.log10(gain.astype(float)), decibels, atol=0.005)  # as printed

    def test_its_null_is_exact(self):
        assert comb_gain(ORDER, revolutions=20) == 0
        # 32.05 is off the nearest float by up to 4e-15; the slope there, pi / sin(0.05 pi) = 20, makes it 7e-14
        assert comb_gain(32.05, revolutions=20) < 1e-12

    def test_whole_orders_pass_and_nothing_passes_more(self):
        orders = np.concatenate([np.arange(50.0), 7 + np.array([1e-300, 1e-15, 1e-9, -1e-9])])
        np.testing.assert_allclose(comb_gain(orders, revolutions=37), 1, rtol=0, atol=1e-12)
        assert comb_gain(np.random.default_rng(1).uniform(0, 99, 10_000), revolutions=37).max() <= 1

    @pytest.mark.parametrize("orders", [[np.nan], [Fraction(1, 2), np.nan], ["three"]])
    def test_what_is_no_order_is_refused(self, orders):
        with pytest.raises(ValueError, match=r"finite|must be|give real numbers"):
            comb_gain(orders, revolutions=2)


class TestAdvice:
    def test_a_null_of_every_neighbour(self):
        advice = quietest_revolutions([Fraction(21, 41), Fraction(7, 6)], most=1000)
        assert (advice.null_every, advice.revolutions, advice.gain) == (246, 984, 0.0)
        for order in (Fraction(21, 41), Fraction(7, 6)):
            assert comb_gain(order, revolutions=advice.revolutions) == 0

    @hypothesis.given(
        orders=st.lists(st.floats(0.1, 9).filter(lambda f: f != round(f)), min_size=1, max_size=4),
        most=st.integers(1, 80),
    )
    def test_without_a_null_the_least_of_all(self, orders, most):
        advice = quietest_revolutions(orders, most=most)
        gains = [max(comb_gain(order, revolutions=n) for order in orders) for n in range(1, most + 1)]
        assert advice.gain == pytest.approx(min(gains), abs=1e-12)
        assert gains[advice.revolutions - 1] == pytest.approx(min(gains), abs=1e-12)
        assert advice.null_every is None

    def test_too_few_revolutions_for_the_null(self):
        advice = quietest_revolutions([Fraction(21, 41)], most=40)
        assert advice.null_every == 41
        assert 0 < advice.gain <= min(comb_gain(Fraction(21, 41), revolutions=n) for n in range(1, 41)) + 1e-15

    @pytest.mark.parametrize("order", [3, 3.0, Fraction(6, 2)])
    def test_what_repeats_with_the_shaft_cannot_be_averaged_away(self, order):
        with pytest.raises(ValueError, match="order 3 repeats with the averaged shaft"):
            quietest_revolutions([0.3, order], most=10)

    def test_something_must_be_named(self):
        with pytest.raises(ValueError, match="orders is empty"):
            quietest_revolutions([], most=10)
