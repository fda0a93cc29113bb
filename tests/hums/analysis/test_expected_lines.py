"""Which lines are looked for, how far about their nominal order, and what they are weighed against: drawn spectra."""

import numpy as np
import pytest
from drawn_spectrum import PER_REV, REVOLUTIONS, drawn_spectrum, level_spectrum, typical_amplitude
from numpy.testing import assert_allclose
from scipy import stats

from hums.analysis.expected_lines import (
    ENVELOPE,
    ORDER_SPECTRUM,
    ExpectedLine,
    SearchPlan,
    expected_lines,
    search,
)
from hums.gearbox.kinematics import solve_kinematics
from hums.gearbox.model import Gearbox

MESH = 23
PLAN = SearchPlan(harmonics=3, sidebands=2, slip=0.02, speed_tolerance=0.0, envelope=True)
GEARBOX = {
    "name": "pair",
    "frame": "housing",
    "reference": "pinion",
    "axes": {"in": ["housing", "pinion"], "out": ["housing", "wheel"]},
    "mesh": [{"name": "mesh", "teeth": {"pinion": MESH, "wheel": 57}}],
    "bearing": [
        {
            "names": ["front"],
            "inner_ring": "pinion",
            "outer_ring": "housing",
            "elements": 9,
            "element_diameter_mm": 10,
            "pitch_diameter_mm": 50,
            "contact_angle_deg": 0,
        }
    ],
}
# Diameters in the ratio 0.2: cage 0.4 of the shaft, nine elements past the outer race 3.6, the inner race 5.4; an
# element spins at (1 - 0.04) / 0.4 = 2.4 and strikes with both sides.
BEARING_ORDERS = {"cage": 0.4, "outer_race": 3.6, "inner_race": 5.4, "rolling_element": 4.8}


def expected_of(plan=PLAN):
    return expected_lines(solve_kinematics(Gearbox.from_mapping(GEARBOX)), plan)


def line_at(order, kind, spectrum=ORDER_SPECTRUM, tolerance=0.0):
    return ExpectedLine(
        component="mesh", kind=kind, harmonic=1, sideband=0, order=order, tolerance=tolerance, spectrum=spectrum
    )


def hump(half_width, *, height, at=MESH):
    """Noise that is louder about a mesh line, as jitter of the tachometer makes it."""
    return lambda orders: np.where(np.abs(orders - at) <= half_width, height, 1.0)


def found_one(spectrum, line):
    (found,), beyond = search(spectrum, [line], channel="x", units="g")
    assert not beyond
    return found.line


class TestBackground:
    def test_noise_about_a_mesh_is_no_sideband_and_level_noise_neither(self):
        """Of 120 records one in a hundred reaches 0.01, within what is exceeded once in a thousand times."""
        low, high = stats.binom.interval(0.999, 120, 0.01)
        for level in (hump(0.4, height=3), hump(0.4, height=1)):
            rng = np.random.default_rng(0)
            alarms = {"tooth": 0, "gear_mesh": 0}
            for _ in range(120):
                spectrum = drawn_spectrum(level, rng=rng)
                for kind in alarms:
                    alarms[kind] += found_one(spectrum, line_at(23.1, kind)).false_alarm_probability < 0.01
            assert low <= alarms["tooth"] <= high
            if level(np.array([MESH])) == 1:
                assert low <= alarms["gear_mesh"] <= high
            else:
                # Nine times the power of the background: of its exponential law half are above 6 times theirs.
                assert alarms["gear_mesh"] > 29

    def test_a_sideband_above_the_noise_about_it_is_found(self):
        rng, size = np.random.default_rng(1), 6 * typical_amplitude(3.0)
        for _ in range(20):
            spectrum = drawn_spectrum(hump(0.4, height=3), rng=rng, lines=[(23.1, size)])
            line = found_one(spectrum, line_at(23.1, "tooth"))
            assert line.false_alarm_probability < 0.01
            # The noise moves it by its own rms, 1 / 6 / sqrt(2 ln 2) = 0.14 of it for each part.
            assert line.amplitude == pytest.approx(size, rel=0.5)


class TestTolerance:
    @pytest.mark.parametrize("slip", [0.005, 0.02, 0.03])
    def test_of_a_bearing_line_grows_with_its_order(self, slip):
        plan = SearchPlan(harmonics=5, sidebands=1, slip=slip, speed_tolerance=0.001, envelope=True)
        lines = [line for line in expected_of(plan) if line.kind in BEARING_ORDERS]
        assert len(lines) == 5 * len(BEARING_ORDERS)
        for line in lines:
            order = line.harmonic * BEARING_ORDERS[line.kind]
            assert line.order == pytest.approx(order, rel=1e-9)
            assert line.tolerance == pytest.approx(slip * order, rel=1e-9)
            assert line.spectrum == ENVELOPE
            assert line.fundamental == (line.harmonic == 1)

    @pytest.mark.parametrize("slipped", [-0.018, 0.0, 0.015])
    @pytest.mark.parametrize("kind", ["outer_race", "inner_race"])
    def test_all_harmonics_of_a_bearing_that_slips_are_found_where_they_are(self, kind, slipped):
        plan = SearchPlan(harmonics=5, sidebands=1, slip=0.02, speed_tolerance=0.0, envelope=True)
        orders = (1 + slipped) * BEARING_ORDERS[kind] * np.arange(1, 6)
        spectrum = drawn_spectrum(
            lambda axis: np.ones(axis.size),
            rng=np.random.default_rng(2),
            lines=[(order, 20 * typical_amplitude(1.0)) for order in orders],
        )
        lines = [line for line in expected_of(plan) if line.kind == kind]
        found, beyond = search(spectrum, lines, channel="x", units="g")
        assert not beyond
        # The frequency of a tone this far above the noise is known to a few hundredths of a bin.
        assert_allclose([one.line.found for one in found], orders, rtol=0, atol=0.2 / REVOLUTIONS)
        assert all(one.line.false_alarm_probability < 1e-6 for one in found)

    @pytest.mark.parametrize("harmonic", [1, 4])
    @pytest.mark.parametrize("side", [-1, 1])
    def test_a_line_beyond_the_slip_is_another(self, harmonic, side):
        order = harmonic * BEARING_ORDERS["inner_race"]
        line = next(line for line in expected_of(SearchPlan(
            harmonics=4, sidebands=1, slip=0.02, speed_tolerance=0.0, envelope=True,
        )) if line.kind == "inner_race" and line.harmonic == harmonic)  # fmt: skip
        inside, outside = (order * (1 + side * part) for part in (0.019, 0.023))
        for at, expected in ((inside, 12.0), (outside, 1.0)):
            spectrum = level_spectrum(lambda axis: np.ones(axis.size), lines=[(at, 12.0)])
            assert found_one(spectrum, line).amplitude == expected

    def test_of_shafts_and_meshes_is_that_of_the_speed(self):
        # 23.0 and the wheel's 23 / 57; sidebands are looked for no farther than a quarter of the way to the next.
        plan = SearchPlan(harmonics=3, sidebands=2, slip=0.02, speed_tolerance=0.01, envelope=True)
        spacing = {"mesh/pinion": 1.0, "mesh/wheel": MESH / 57}
        for line in expected_of(plan):
            if line.kind in {"shaft", "gear_mesh"}:
                assert line.tolerance == pytest.approx(0.01 * line.order, rel=1e-9)
            elif line.kind == "tooth" and line.sideband:
                assert line.order == pytest.approx(MESH * line.harmonic + line.sideband * spacing[line.component])
                widest = min(0.01 * MESH * line.harmonic, spacing[line.component] / 4)
                assert line.tolerance == pytest.approx(widest, rel=1e-9)


def test_lines_past_the_end_are_out_of_reach():
    spectrum = level_spectrum(lambda axis: np.ones(axis.size))
    lines = [line_at(order, "shaft") for order in (1.0, PER_REV / 2 - 1, PER_REV / 2 + 1)]
    found, beyond = search(spectrum, lines, channel="front", units="g")
    assert [one.expected for one in found] == lines[:2]
    assert beyond == lines[2:]
    assert {(one.channel, one.units, one.bin_width) for one in found} == {("front", "g", 1 / REVOLUTIONS)}
