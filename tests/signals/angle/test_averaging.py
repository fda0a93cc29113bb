"""The synchronous average against its known comb response, of any shaft, and piece by piece."""

from fractions import Fraction

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st

from signals.angle.averaging import RunningAverage, synchronous_average
from signals.resampling.resampling import AngularSignal

PER_REV = 256


def over_angle(function, *, revolutions, per_rev=PER_REV):
    angle = 2 * np.pi * np.arange(revolutions * per_rev) / per_rev
    return AngularSignal(values=function(angle), samples_per_rev=per_rev, start_rev=0.0, passband_orders=0.44 * per_rev)


class TestAverage:
    @pytest.mark.parametrize("per_rev", [8, 9])
    def test_every_order_up_to_half_the_grid_reads_its_amplitude(self, per_rev):
        highest = per_rev // 2
        signal = over_angle(lambda angle: 3 * np.cos(highest * angle), revolutions=2, per_rev=per_rev)
        # 16 cosines of angles of up to 50 rad, rounded to 7e-15: less than 3 times that for the mean
        assert synchronous_average(signal).complex_amplitude[highest] == pytest.approx(3, abs=5e-14)

    @pytest.mark.parametrize(("order", "revolutions"), [(7.1, 2), (3.5848, 37), (12.03, 10)])
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


class TestOtherShafts:
    def test_a_shaft_whose_revolution_is_whole_samples_is_averaged_as_it_is(self):
        # 256 samples to the reference, 8/3 turns to one of it: 96 to the shaft
        rng = np.random.default_rng(3)
        values = rng.standard_normal(30 * PER_REV)
        signal = AngularSignal(values=values, samples_per_rev=PER_REV, start_rev=0.0, passband_orders=112.0)
        average = synchronous_average(signal, ratio=Fraction(8, 3))
        # means of 80 values: sums of up to 40, in some other order, each of 80 roundings of 4e-15 over 80
        np.testing.assert_allclose(average.values, values.reshape(80, 96).mean(axis=0), rtol=0, atol=2e-14)
        assert (average.revolutions, average.samples_per_rev, average.ratio) == (80, 96, Fraction(8, 3))
        assert average.passband_orders == pytest.approx(112 * 3 / 8)

    @pytest.mark.parametrize(
        ("ratio", "mean"), [(Fraction(21, 41), 0.0), (Fraction(41, 20), 1e6), (Fraction(1009, 997), 1e6)]
    )
    def test_any_exact_ratio_keeps_its_own_orders(self, ratio, mean):
        lines = {1: 1.5 - 0.5j, 17: 0.2 + 0.7j}

        def over(angle):
            return mean + sum((z * np.exp(1j * k * float(ratio) * angle)).real for k, z in lines.items())

        average = synchronous_average(over_angle(over, revolutions=120), ratio=ratio, datum_rev=0.0)
        expected = np.zeros(average.samples_per_rev // 2 + 1, dtype=complex)
        expected[[0, *lines]] = [mean, *lines.values()]
        # the interpolator is within 2e-6 of one in its passband; 1e6 is known to 1e-10
        np.testing.assert_allclose(average.complex_amplitude, expected, rtol=0, atol=5e-6)
        # every revolution is the same, so the scatter is what interpolation and rounding leave
        assert average.standard_error.max() < 1e-5

    def test_ends_of_the_record_stay_out_of_an_interpolated_average(self):
        def noisy(angle):
            values = np.cos(3 * 21 / 41 * angle)
            values[0], values[-1] = 1e9, -1e9
            return values

        average = synchronous_average(over_angle(noisy, revolutions=50), ratio=Fraction(21, 41))
        assert np.abs(average.values).max() < 1.01

    def test_parts_of_one_record_share_their_angle_zero(self):
        ratio = Fraction(8, 3)
        first = over_angle(lambda angle: np.cos(5 * float(ratio) * angle + 1), revolutions=7)
        values = over_angle(lambda angle: np.cos(5 * float(ratio) * angle + 1), revolutions=20).values
        second = AngularSignal(
            values=values[7 * PER_REV :], samples_per_rev=PER_REV, start_rev=7.0, passband_orders=112.0
        )
        parts = [synchronous_average(part, ratio=ratio, datum_rev=0.0) for part in (first, second)]
        np.testing.assert_allclose(parts[0].values, parts[1].values, rtol=0, atol=1e-12)
        # 7 reference revolutions are 18 2/3 of the shaft's, so the next one begins at 19 x 3/8 of the reference
        assert parts[1].start_rev == pytest.approx(19 * 3 / 8, abs=1e-12)

    def test_exact_number_of_revolutions_puts_a_null_on_a_neighbour(self):
        signal = over_angle(lambda angle: np.cos(32.05 * angle), revolutions=33)
        assert np.abs(synchronous_average(signal, revolutions=20).values).max() < 1e-12
        decibels = -20 * np.log10(np.abs(synchronous_average(signal, revolutions=10).values).max())
        assert decibels == pytest.approx(3.89, abs=0.005)

    @pytest.mark.parametrize("ratio", [0.5, True, "1/2", None])
    def test_a_ratio_must_be_exact(self, ratio):
        with pytest.raises(ValueError, match=r"is not exact.*give the teeth"):
            synchronous_average(over_angle(np.cos, revolutions=3), ratio=ratio)

    @pytest.mark.parametrize(("ratio", "revolutions"), [(1, 4), (Fraction(1, 5), None), (Fraction(21, 41), 2)])
    def test_too_few_revolutions_are_counted(self, ratio, revolutions):
        with pytest.raises(ValueError, match=r"holds \d whole revolutions of the shaft.*are needed; record longer"):
            synchronous_average(over_angle(np.cos, revolutions=3), ratio=ratio, revolutions=revolutions)


class TestRunningAverage:
    @hypothesis.given(
        cuts=st.lists(st.integers(0, 640), max_size=12), mean=st.sampled_from([0.0, 1e6]), seed=st.integers(0, 9)
    )
    def test_where_the_record_is_cut_changes_nothing(self, cuts, mean, seed):
        values = mean + np.random.default_rng(seed).standard_normal(640)
        running = RunningAverage(samples_per_rev=16)
        for piece in np.split(values, sorted(cuts)):
            running.update(piece)
        found = running.average()
        rows = values.reshape(40, 16)
        assert found.revolutions == 40
        # a few roundings of the largest value
        np.testing.assert_allclose(found.values, rows.mean(axis=0), rtol=1e-15 * 4, atol=1e-12 if mean == 0 else 0)
        expected = rows.std(axis=0, ddof=1) / np.sqrt(40)
        np.testing.assert_allclose(found.standard_error, expected, rtol=1e-12 if mean == 0 else 1e-8)

    def test_averages_of_parts_join(self):
        values = np.random.default_rng(5).standard_normal(50 * 16)
        left = RunningAverage(samples_per_rev=16, passband_orders=7.5)
        right = RunningAverage(samples_per_rev=16, passband_orders=7.0)
        left.update(values[: 13 * 16])
        right.update(values[13 * 16 :])
        left.merge(right)
        left.merge(RunningAverage(samples_per_rev=16))  # one that has seen nothing adds nothing
        whole = synchronous_average(
            AngularSignal(values=values, samples_per_rev=16, start_rev=0.0, passband_orders=7.0)
        )
        np.testing.assert_allclose(left.average().values, whole.values, rtol=0, atol=1e-14)
        np.testing.assert_allclose(left.average().standard_error, whole.standard_error, rtol=1e-12)
        assert left.average().passband_orders == 7.0  # of both

    def test_no_average_before_a_revolution(self):
        running = RunningAverage(samples_per_rev=4)
        running.update([1.0, 2, 3])
        with pytest.raises(ValueError, match="only 3 of the 4 samples"):
            running.average()
