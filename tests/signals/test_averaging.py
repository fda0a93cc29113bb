"""The synchronous average against its known comb response, and what is left of it."""

import numpy as np
import pytest

from signals.averaging import SynchronousAverage, residual_signal, synchronous_average
from signals.resampling import AngularSignal

PER_REV = 256


def over_angle(function, *, revolutions, per_rev=PER_REV):
    angle = 2 * np.pi * np.arange(revolutions * per_rev) / per_rev
    return AngularSignal(values=function(angle), samples_per_rev=per_rev, start_rev=0.0, passband_orders=0.44 * per_rev)


class TestAverage:
    def test_whole_orders_stay(self):
        amplitudes = {1: 2 - 1j, 27: 0.3j, 90: -0.04 + 0.03j}
        signal = over_angle(
            lambda angle: 0.7 + sum((z * np.exp(1j * k * angle)).real for k, z in amplitudes.items()), revolutions=40
        )
        average = synchronous_average(signal)
        expected = np.zeros(PER_REV // 2 + 1, dtype=complex)
        expected[[0, *amplitudes]] = [0.7, *amplitudes.values()]
        # every revolution is the same but for the rounding of angles up to 250 rad times 90
        np.testing.assert_allclose(average.complex_amplitude, expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(average.standard_error, 0, atol=1e-12)
        assert average.revolutions == 40

    @pytest.mark.parametrize("per_rev", [8, 9])
    def test_every_order_up_to_half_the_grid_reads_its_amplitude(self, per_rev):
        highest = per_rev // 2
        signal = over_angle(lambda angle: 3 * np.cos(highest * angle), revolutions=2, per_rev=per_rev)
        assert synchronous_average(signal).complex_amplitude[highest] == pytest.approx(3, abs=1e-14)

    @pytest.mark.parametrize("order", [7.1, 3.5848, 12.03])
    @pytest.mark.parametrize("revolutions", [2, 10, 37])
    def test_other_orders_fall_as_the_comb_says(self, order, revolutions):
        # averaging N revolutions multiplies order p by sin(pi N p) / (N sin(pi p)) (McFadden 1987)
        average = synchronous_average(over_angle(lambda angle: np.cos(order * angle), revolutions=revolutions))
        gain = np.sin(np.pi * revolutions * order) / (revolutions * np.sin(np.pi * order))
        angle = 2 * np.pi * np.arange(PER_REV) / PER_REV
        expected = gain * np.cos(order * angle + np.pi * order * (revolutions - 1))
        np.testing.assert_allclose(average.values, expected, rtol=0, atol=1e-12)

    def test_noise_falls_with_the_root_and_says_so(self):
        rng = np.random.default_rng(8)
        average = synchronous_average(over_angle(lambda angle: 3 * rng.standard_normal(angle.size), revolutions=400))
        # 3 / sqrt(400); a deviation from 256 values is known to 1 / sqrt(512), four of these are 18 %
        assert average.values.std() == pytest.approx(0.15, rel=0.18)
        # the mean of 256 such, each known to 1 / sqrt(800)
        assert average.standard_error.mean() == pytest.approx(0.15, rel=4 / np.sqrt(800 * 256) + 1 / 400)

    def test_two_revolutions_err_by_half_their_difference(self):
        first, second = np.random.default_rng(9).standard_normal((2, PER_REV))
        average = synchronous_average(over_angle(lambda _: np.append(first, second), revolutions=2))
        np.testing.assert_allclose(average.values, (first + second) / 2, rtol=0, atol=1e-15)
        np.testing.assert_allclose(average.standard_error, np.abs(first - second) / 2, rtol=0, atol=1e-15)

    def test_one_revolution_has_no_standard_error(self):
        average = synchronous_average(over_angle(np.cos, revolutions=1))
        assert np.isnan(average.standard_error).all()
        np.testing.assert_allclose(average.values, np.cos(2 * np.pi * np.arange(PER_REV) / PER_REV), atol=1e-15)


class TestResidual:
    ANGLE = 2 * np.pi * np.arange(PER_REV) / PER_REV

    def average(self, values):
        return SynchronousAverage(values=values, standard_error=np.zeros(values.size), revolutions=1)

    def test_what_is_removed(self):
        parts = {k: np.cos(k * self.ANGLE + k) for k in (1, 2, 27, 28, 54, 100)}
        average = self.average(5 + sum(parts.values()))
        residual = residual_signal(average, removed_orders=[1, 27, 54, 999], max_order=60)
        np.testing.assert_allclose(residual, parts[2] + parts[28], rtol=0, atol=1e-13)

    def test_nothing_removed_but_the_mean(self):
        values = np.random.default_rng(1).standard_normal(PER_REV)
        residual = residual_signal(self.average(values), removed_orders=[], max_order=PER_REV // 2)
        np.testing.assert_allclose(residual, values - values.mean(), rtol=0, atol=1e-14)

    def test_a_short_impact_outlives_the_removal_of_the_mesh(self):
        mesh = 2.0 * np.cos(27 * self.ANGLE)
        impact = np.exp(-0.5 * ((self.ANGLE - 3) / 0.05) ** 2)
        residual = residual_signal(self.average(mesh + impact), removed_orders=[27, 54, 81], max_order=110)
        assert abs(self.ANGLE[np.argmax(residual)] - 3) < 2 * np.pi / PER_REV
        # three orders of about a hundred, and the mean, are gone from the impact itself
        assert np.abs(residual).max() == pytest.approx(1, abs=0.1)

    def test_no_number_passes_silently(self):
        with pytest.raises(ValueError, match="not finite"):
            residual_signal(self.average(np.array([1.0, np.nan, 2, 3])), removed_orders=[1], max_order=2)
