"""Residual, difference and regular signals and mesh bands against the sums of cosines they are made of."""

import numpy as np
import pytest

from signals.angle.averaging import SynchronousAverage
from signals.angle.residual import (
    DifferenceSignal,
    RegularSignal,
    ResidualSignal,
    difference_signal,
    mesh_band,
    regular_signal,
    residual_signal,
)

PER_REV = 256
ANGLE = 2 * np.pi * np.arange(PER_REV) / PER_REV
# angles up to 100 x 6.28 rad are rounded to 6e-14 each, five of these add up below 1e-12
PARTS = {k: np.cos(k * ANGLE + k) for k in (1, 2, 3, 26, 27, 28, 53, 54, 55, 100)}


def average(values, **kwargs):
    return SynchronousAverage(values=values, standard_error=np.zeros(values.size), revolutions=1, **kwargs)


def parts(*orders):
    return sum(PARTS[order] for order in orders)


class TestResidual:
    def test_what_is_removed(self):
        residual = residual_signal(average(5 + parts(*PARTS)), teeth=27, harmonics=2, shaft_orders=[1, 2], max_order=60)
        np.testing.assert_allclose(residual.values, parts(3, 26, 28, 53, 55), rtol=0, atol=1e-12)
        assert residual.removed_orders == (0, 1, 2, 27, 54, *range(61, 129))
        assert isinstance(residual, ResidualSignal)
        assert residual.samples_per_rev == PER_REV

    def test_the_difference_signal_lacks_the_sidebands_too(self):
        difference = difference_signal(
            average(5 + parts(*PARTS)), teeth=27, harmonics=2, shaft_orders=[1, 2], max_order=60
        )
        np.testing.assert_allclose(difference.values, parts(3), rtol=0, atol=1e-12)
        assert difference.removed_orders == (0, 1, 2, 26, 27, 28, 53, 54, 55, *range(61, 129))
        assert isinstance(difference, DifferenceSignal)
        assert not isinstance(difference, ResidualSignal)

    def test_what_the_average_does_not_pass_is_removed_too(self):
        made = average(parts(*PARTS), passband_orders=54.9)
        residual = residual_signal(made, teeth=27, harmonics=1, shaft_orders=[])
        np.testing.assert_allclose(residual.values, parts(1, 2, 3, 26, 28, 53, 54), rtol=0, atol=1e-12)
        assert residual.remaining_orders == (*range(1, 27), *range(28, 55))

    @pytest.mark.parametrize("take", [residual_signal, difference_signal])
    def test_regular_and_rest_are_the_average(self, take):
        values = 1e3 + np.random.default_rng(2).standard_normal(PER_REV)
        made = average(values)
        left = take(made, teeth=27, harmonics=3, shaft_orders=[1], max_order=100)
        regular = regular_signal(made, left=left)
        # one subtraction and one addition, each rounded once
        np.testing.assert_allclose(regular.values + left.values, values, rtol=3e-16, atol=0)
        lines = np.abs(np.fft.rfft(regular.values))
        assert lines[list(regular.removed_orders)].max() < 1e-9  # 1e3 times 256 times rounding
        assert isinstance(regular, RegularSignal)
        assert set(regular.removed_orders) | set(left.removed_orders) == set(range(129))
        assert not set(regular.removed_orders) & set(left.removed_orders)

    def test_sidebands_of_a_coarse_gear_may_reach_below_zero(self):
        left = difference_signal(average(parts(*PARTS)), teeth=2, harmonics=1, shaft_orders=[], sidebands=4)
        assert left.removed_orders[:7] == (0, 1, 2, 3, 4, 5, 6)

    @pytest.mark.parametrize(
        ("wrong", "sentence"),
        [
            ({"teeth": []}, "teeth is empty"),
            ({"teeth": 27.5}, "teeth"),
            ({"harmonics": 0}, "harmonics=0"),
            ({"shaft_orders": [-1]}, "a shaft order=-1"),
            ({"teeth": 2, "harmonics": 64, "shaft_orders": range(1, 129, 2)}, "are removed; to retain orders"),
        ],
    )
    def test_what_makes_no_sense_is_refused(self, wrong, sentence):
        wanted = {"teeth": 27, "harmonics": 2, "shaft_orders": [1]} | wrong
        with pytest.raises(ValueError, match=sentence):
            residual_signal(average(parts(*PARTS)), **wanted)

    def test_the_rest_of_another_average_has_no_regular_part(self):
        left = residual_signal(average(np.arange(16.0)), teeth=3, harmonics=1, shaft_orders=[])
        with pytest.raises(ValueError, match="left has 16 samples"):
            regular_signal(average(parts(*PARTS)), left=left)


class TestMeshBand:
    AMPLITUDE = 1 + 0.3 * np.cos(ANGLE - 1) + 0.1 * np.cos(2 * ANGLE)
    PHASE = 0.2 * np.sin(ANGLE + 0.5)

    def test_demodulates_what_was_modulated(self):
        others = 3 + np.cos(20 * ANGLE) + np.cos(100 * ANGLE)  # outside 40 .. 80
        made = average(others + self.AMPLITUDE * np.cos(60 * ANGLE + self.PHASE + 0.7))
        band = mesh_band(made, mesh_order=60, sidebands=20)
        # lines of the phase modulation beyond 18 sidebands: J_18(0.2) = 1e-34
        np.testing.assert_allclose(band.amplitude, self.AMPLITUDE, rtol=0, atol=1e-12)
        np.testing.assert_allclose(band.phase_rad, self.PHASE + 0.7, rtol=0, atol=1e-12)
        np.testing.assert_allclose(band.values, made.values - others, rtol=0, atol=1e-12)
        assert band.remaining_orders == tuple(range(40, 81))
        assert set(band.remaining_orders) | set(band.removed_orders) == set(range(129))
        assert band.samples_per_rev == PER_REV

    @pytest.mark.parametrize(("order", "sidebands"), [(5, 5), (125, 3)])
    def test_must_lie_in_the_passband(self, order, sidebands):
        with pytest.raises(ValueError, match="must lie between 1 and 127"):
            mesh_band(average(parts(1)), mesh_order=order, sidebands=sidebands)
