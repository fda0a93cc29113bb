"""Planet and sun averages of a synthetic ring sensor, whose planets and sun are known tooth by tooth."""

from fractions import Fraction

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st

from signals.angle.planets import PassWindow, PlanetaryTeeth, pass_angle, planet_average, sun_average
from signals.resampling.resampling import AngularSignal

TEETH = PlanetaryTeeth(ring=99, planet=36, sun=27, planets=3)
HUNTING = PlanetaryTeeth(ring=62, planet=21, sun=19, planets=3)
PER_TOOTH = 16
WINDOWS = [
    PassWindow.rectangular(5),
    PassWindow.hann(5),
    PassWindow.tukey(6, taper_teeth=2),
    PassWindow.hann(4.5),
]


def periodic(rng, teeth, highest):
    """Ten lines of one revolution, as a function of the tooth coordinate."""
    orders = rng.choice(np.arange(1, highest + 1), min(10, highest), replace=False)
    amplitudes = rng.standard_normal(orders.size)
    phases = rng.uniform(0, 2 * np.pi, orders.size)

    def value(tooth):
        angle = 2 * np.pi / teeth * np.ravel(tooth)
        return sum(a * np.cos(k * angle + p) for a, k, p in zip(amplitudes, orders, phases, strict=True))

    return value


def angular(values, per_rev):
    return AngularSignal(values=values, samples_per_rev=per_rev, start_rev=0.0, passband_orders=0.4 * per_rev)


def ring_sensor(teeth, revolutions, first_pass, sources, *, path, start=0.0, sun=None):
    """A sensor hears each planet through `path(carrier revolutions from its pass)`."""
    theta = start + np.arange(revolutions * teeth.ring * PER_TOOTH) / (teeth.ring * PER_TOOTH)
    values = np.zeros(theta.size)
    for place, source in zip(teeth.positions_rev, sources, strict=True):
        since = theta - (first_pass - float(place))
        heard = source(teeth.ring * since)
        if sun is not None:
            # seen from the carrier the sun turns against the ring, forwards: its teeth go past a point as often as the
            # ring's, and are past planet 0 before they come to the place p ahead, by p times the sun's teeth
            heard = heard + sun(teeth.ring * (theta - first_pass) - teeth.sun * float(place))
        values += path((since + 0.5) % 1 - 0.5) * heard
    return AngularSignal(
        values=values, samples_per_rev=teeth.ring * PER_TOOTH, start_rev=start, passband_orders=0.44 * 99 * PER_TOOTH
    )


def near(since):
    """Only the planet within half a planet spacing is heard, all of that alike."""
    return (np.abs(since) < 1 / 6).astype(float)


def silence(tooth):
    return np.zeros(np.size(tooth))


class TestTeeth:
    @pytest.mark.parametrize("teeth", [TEETH, HUNTING, PlanetaryTeeth(ring=93, planet=21, sun=51, planets=8)])
    def test_the_sequence_is_that_of_turning_tooth_by_tooth(self, teeth):
        # the mesh goes on by one tooth of ring, planet and sun at once
        planet, sun = [], []
        for mesh in range(teeth.ring * max(teeth.planet_reset, teeth.sun_reset)):
            if mesh % teeth.ring == 0:
                planet.append(mesh % teeth.planet)
                sun.append(mesh % teeth.sun)
        assert teeth.planet_sequence == tuple(planet[: teeth.planet_reset])
        assert teeth.sun_sequence == tuple(sun[: teeth.sun_reset])
        assert len(set(teeth.planet_sequence)) == teeth.planet_reset  # none twice before the reset
        assert teeth.planet_reset * teeth.ring % teeth.planet == 0
        assert teeth.sun_reset * teeth.ring % teeth.sun == 0

    @pytest.mark.parametrize(
        ("wrong", "sentence"),
        [
            ({"planets": 4}, "cannot be assembled between 99 and 27 teeth"),
            ({"positions_rev": (Fraction(0), Fraction(1, 3))}, "a position for each of 3 planets"),
            ({"positions_rev": (Fraction(1, 3), Fraction(0), Fraction(2, 3))}, "0 first"),
            ({"ring": 99.0}, "ring=99.0 must be a whole number"),
        ],
    )
    def test_what_cannot_be_assembled(self, wrong, sentence):
        with pytest.raises(ValueError, match=sentence):
            PlanetaryTeeth(**({"ring": 99, "planet": 36, "sun": 27, "planets": 3} | wrong))


class TestWindow:
    @pytest.mark.parametrize(
        ("window", "total"),
        [
            (PassWindow.rectangular(1), 1),
            (PassWindow.rectangular(5), 5),
            (PassWindow.hann(2), 1),
            (PassWindow.hann(5), 2.5),
            (PassWindow.tukey(5, taper_teeth=1), 4),
            (PassWindow.tukey(6, taper_teeth=2), 4),
        ],
    )
    def test_one_tooth_apart_they_add_up_to_the_same_everywhere(self, window, total):
        place = np.linspace(0, 1, 101)[:-1]
        added = sum(window.weight(place + k) for k in range(-8, 9))
        np.testing.assert_allclose(added, total, rtol=0, atol=1e-14)

    def test_a_taper_must_fit(self):
        with pytest.raises(ValueError, match=r"taper_teeth=3 must lie between 0 and 2\.5"):
            PassWindow.tukey(5, taper_teeth=3)


class TestPlanet:
    @pytest.mark.parametrize("window", WINDOWS)
    @pytest.mark.parametrize(("planet", "first_pass"), [(0, 0.0), (2, 0.1 + 1 / 62 / PER_TOOTH / 3)])
    def test_recovers_each_tooth(self, window, planet, first_pass):
        rng = np.random.default_rng(7)
        known = [periodic(rng, 21, 100) for _ in range(3)]
        signal = ring_sensor(HUNTING, 64, first_pass, known, path=near)
        average = planet_average(signal, teeth=HUNTING, planet=planet, first_pass_rev=first_pass, window=window)
        tooth = np.arange(21 * PER_TOOTH) / PER_TOOTH
        # every window lies where this planet alone is heard; the turn by part of a sample is exact below the highest
        # of 168 lines
        np.testing.assert_allclose(average.values, known[planet](tooth), rtol=0, atol=1e-9)
        np.testing.assert_allclose(average.standard_error, 0, atol=1e-9)
        assert (average.teeth, average.samples_per_rev) == (21, 21 * PER_TOOTH)
        assert average.revolutions == average.passes // 21
        assert average.ratio == Fraction(62, 21)

    def test_a_part_of_a_record_numbers_the_teeth_alike(self):
        known = [periodic(np.random.default_rng(k), 21, 60) for k in range(3)]
        late = ring_sensor(HUNTING, 45, 0.4, known, path=near, start=11.0)
        average = planet_average(late, teeth=HUNTING, planet=1, first_pass_rev=0.4, window=PassWindow.hann(5))
        np.testing.assert_allclose(average.values, known[1](np.arange(21 * PER_TOOTH) / PER_TOOTH), rtol=0, atol=1e-9)

    def test_standard_error_is_that_of_the_sequences(self):
        rng = np.random.default_rng(4)
        # 30 sequences of white noise under five rectangular teeth: each angle is the mean of 5 x 30 values
        count = 30 * 21 + 1
        signal = angular(rng.standard_normal(count * 62 * 4), 62 * 4)
        average = planet_average(signal, teeth=HUNTING, planet=0, first_pass_rev=0.5, window=PassWindow.rectangular(5))
        assert average.revolutions == 30
        # 84 angles, each deviation known to 1 / sqrt(58)
        assert average.standard_error.mean() == pytest.approx(1 / np.sqrt(150), rel=4 / np.sqrt(58 * 84) + 0.01)
        assert average.values.std() == pytest.approx(1 / np.sqrt(150), rel=4 / np.sqrt(2 * 84))

    @hypothesis.given(
        ring=st.integers(20, 60), planet=st.integers(5, 25), pass_rev=st.floats(-2, 2), width=st.integers(1, 6)
    )
    def test_any_teeth(self, ring, planet, pass_rev, width):
        teeth = PlanetaryTeeth(ring=ring, planet=planet, sun=9, planets=1)
        common = planet // teeth.planet_reset
        hypothesis.assume(common <= width <= ring)
        known = periodic(np.random.default_rng(ring), planet, planet)
        theta = np.arange((teeth.planet_reset + 2) * ring * 4) / (ring * 4)
        signal = angular(known(ring * (theta - pass_rev)), ring * 4)
        average = planet_average(
            signal, teeth=teeth, planet=0, first_pass_rev=pass_rev, window=PassWindow.rectangular(width)
        )
        np.testing.assert_allclose(average.values, known(np.arange(planet * 4) / 4), rtol=0, atol=1e-7)
        np.testing.assert_allclose(average.weights.sum(), width * 4 * average.passes, rtol=1 / (4 * width) + 1e-9)

    def test_teeth_that_never_come_are_not_made_up(self):
        signal = ring_sensor(TEETH, 8, 0.0, [silence] * 3, path=near)
        with pytest.raises(ValueError, match=r"5 teeth does not cover the whole planet.*every 9th.*widen"):
            planet_average(signal, teeth=TEETH, planet=0, first_pass_rev=0.0, window=PassWindow.rectangular(5))

    @pytest.mark.parametrize(
        ("change", "sentence"),
        [
            ({"planet": 3}, "planet=3 must be a whole number from 0 to 2"),
            ({"window": PassWindow.hann(63)}, "wider than the ring"),
            ({"first_pass_rev": np.nan}, "must be finite"),
            ({"teeth": TEETH}, "not a multiple of 99"),
        ],
    )
    def test_what_makes_no_sense(self, change, sentence):
        signal = ring_sensor(HUNTING, 22, 0.0, [silence] * 3, path=near)
        wanted = {"teeth": HUNTING, "planet": 0, "first_pass_rev": 0.0, "window": PassWindow.hann(5)} | change
        with pytest.raises(ValueError, match=sentence):
            planet_average(signal, **wanted)

    def test_too_short_a_record(self):
        signal = ring_sensor(HUNTING, 20, 0.5, [silence] * 3, path=near)
        with pytest.raises(ValueError, match=r"holds 20 complete passes of a planet.*once in 21; record 22 carrier"):
            planet_average(signal, teeth=HUNTING, planet=0, first_pass_rev=0.5, window=PassWindow.hann(5))


def tooth_at(coordinate):
    """Number of the tooth whose middle is nearest; half a tooth before a middle belongs to it, half a tooth after not.

    Coordinates are multiples of 1 / 144 or more, so a millionth is rounding.
    """
    return np.floor(coordinate + 0.5 + 1e-6)


class TestToothBoundaries:
    """Records whose every sample is the number of the tooth in mesh: a sample of another tooth is another number."""

    # whole numbers of samples from planet to planet: a turn by parts of a sample would round the steps off
    @pytest.mark.parametrize("gear", ["planet", "sun"])
    @pytest.mark.parametrize(
        ("per_tooth", "window", "first_pass"),
        [
            (6, PassWindow.rectangular(1), 0.0),
            (9, PassWindow.rectangular(3), 0.5),
            (15, PassWindow.hann(4), 0.5),
            (48, PassWindow.hann(4), 0.0),
        ],
    )
    def test_each_tooth_has_its_own_samples_and_no_other(self, per_tooth, gear, window, first_pass):
        per_rev, turned = 62 * per_tooth, 62 * (np.arange(45 * 62 * per_tooth) / (62 * per_tooth) - first_pass)
        if gear == "planet":
            # planet 1 is a third of a turn ahead: 62 / 3 teeth of the ring have passed the sensor since it did
            tooth = tooth_at(turned + 62 / 3) % 21
        else:
            # past the sensor is planet p, every third of a turn; its tooth of the sun is 19 p / 3 behind planet 0's
            passing = -tooth_at(turned * 3 / 62) % 3
            tooth = tooth_at(turned - 19 * passing / 3) % 19
        signal = angular(tooth, per_rev)
        if gear == "planet":
            average = planet_average(signal, teeth=HUNTING, planet=1, first_pass_rev=first_pass, window=window)
        else:
            average = sun_average(signal, teeth=HUNTING, first_pass_rev=first_pass, window=window)
        expected = np.repeat(np.arange(average.teeth)[:, None], per_tooth, axis=1)
        # a weighted mean of numbers alike; a pass that rounding puts 1e-13 of a sample beside one turns steps of 20
        np.testing.assert_allclose(average.by_tooth, expected, rtol=0, atol=1e-9)


class TestSun:
    @pytest.mark.parametrize(
        "teeth",
        [
            HUNTING,
            PlanetaryTeeth(
                ring=62, planet=21, sun=19, planets=3, positions_rev=(Fraction(0), Fraction(26, 81), Fraction(55, 81))
            ),
        ],
    )
    def test_is_put_together_from_all_planets(self, teeth):
        rng = np.random.default_rng(5)
        known = periodic(rng, 19, 90)
        signal = ring_sensor(teeth, 40, 0.17, [silence] * 3, path=lambda s: (np.abs(s) < 0.15) * 1.0, sun=known)
        average = sun_average(signal, teeth=teeth, first_pass_rev=0.17, window=PassWindow.hann(5))
        np.testing.assert_allclose(average.values, known(np.arange(19 * PER_TOOTH) / PER_TOOTH), rtol=0, atol=1e-9)
        # two sequences of 19 passes of three planets: 2.5 for each
        assert (average.revolutions, average.passes, average.teeth) == (2, 114, 19)
        assert average.weights.mean() == pytest.approx(2 * 3 * 2.5, rel=1e-12)


class TestPassAngle:
    @pytest.mark.parametrize(("first_pass", "start"), [(0.0, 0.0), (0.05, 7.25), (0.31, 0.0)])
    def test_finds_where_the_planets_pass(self, first_pass, start):
        rng = np.random.default_rng(8)
        signal = ring_sensor(
            HUNTING, 60, first_pass, [periodic(rng, 21, 90) for _ in range(3)], path=near_smooth, start=start
        )
        found = pass_angle(signal, teeth=HUNTING)
        away = (found.first_pass_rev - first_pass + 1 / 6) % (1 / 3) - 1 / 6
        assert abs(away) < 4 * found.std_rev
        assert found.std_rev < 0.01
        assert 0 <= found.first_pass_rev < 1 / 3

    def test_uneven_planets_tell_which_is_which(self):
        teeth = PlanetaryTeeth(
            ring=62, planet=21, sun=19, planets=3, positions_rev=(Fraction(0), Fraction(20, 81), Fraction(50, 81))
        )
        rng = np.random.default_rng(9)
        alike = [lambda tooth: rng.standard_normal(np.size(tooth))] * 3
        signal = ring_sensor(teeth, 80, 0.61, alike, path=near_smooth)
        found = pass_angle(signal, teeth=teeth)
        assert abs(found.first_pass_rev - 0.61) < 4 * found.std_rev
        assert found.std_rev < 0.01

    def test_reads_the_modulation(self):
        rng = np.random.default_rng(10)
        theta = np.arange(400 * 248) / 248
        swing = np.sqrt(1 + 0.4 * np.cos(2 * np.pi * 3 * (theta - 0.2)))
        signal = angular(swing * rng.standard_normal(theta.size), 248)
        found = pass_angle(signal, teeth=HUNTING)
        # squares of normal values scatter by sqrt(2): a line of 1e5 of them is known to 2 / sqrt(1e5)
        assert found.modulation == pytest.approx(0.4, abs=4 * 2 / np.sqrt(theta.size))
        # and its phase to that over 0.4, over 2 pi 3
        assert found.std_rev == pytest.approx(2 / np.sqrt(theta.size) / 0.4 / (6 * np.pi), rel=0.2)
        assert abs(found.first_pass_rev - 0.2) < 4 * found.std_rev

    def test_noise_has_no_passes(self):
        rng = np.random.default_rng(11)
        signal = angular(rng.standard_normal(20 * 248), 248)
        with pytest.raises(ValueError, match="is not modulated by 3 planets"):
            pass_angle(signal, teeth=HUNTING)

    def test_one_revolution_is_no_evidence(self):
        signal = angular(np.ones(248), 248)
        with pytest.raises(ValueError, match="give at least two"):
            pass_angle(signal, teeth=HUNTING)


def near_smooth(since):
    return np.exp(3 * (np.cos(2 * np.pi * since) - 1))
