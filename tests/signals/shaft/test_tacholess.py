"""Speed without a tachometer, on records whose angle is known in closed form and on a turbine beside its tachometer."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.io
from scipy.signal import lfilter

from signals.shaft.phase import ShaftPhase, constant_speed
from signals.shaft.phase_demodulation import refine_phase
from signals.shaft.tacholess import estimate_speed

RATE_HZ = 12_800.0


@dataclass(frozen=True)
class Law:
    """A speed and its integral."""

    speed_hz: object
    revolutions: object


def ramp(low, high, duration):
    slope = (high - low) / duration
    return Law(lambda t: low + slope * t, lambda t: low * t + slope * t**2 / 2)


def swing(mean, parts):
    """Mean speed with sinusoids (fraction of it, Hz) on top."""

    def speed(t):
        return mean * (1 + sum(size * np.sin(2 * np.pi * f * t) for size, f in parts))

    def revolutions(t):
        return mean * (t + sum(size * (1 - np.cos(2 * np.pi * f * t)) / (2 * np.pi * f) for size, f in parts))

    return Law(speed, revolutions)


def resonator(x, hz, damping):
    """Pass through a mode: unit gain far below, a peak of about one over twice the damping, and 180 degrees over it."""
    w, r = 2 * np.pi * hz / RATE_HZ, np.exp(-damping * 2 * np.pi * hz / RATE_HZ)
    a = np.array([1, -2 * r * np.cos(w), r * r])
    return lfilter([a.sum()], a, x)


def vibration(law, *, duration, orders, snr_db, seed, sidebands=True, modes=((430, 0.05), (1900, 0.03)), missing=()):
    """Orders with sidebands through structural modes, in noise of which half goes through a mode of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(duration * RATE_HZ)) / RATE_HZ
    turns = law.revolutions(t)
    x = np.zeros(t.size)
    for order in orders:
        size = rng.uniform(0.5, 1.0) * (order not in missing)
        lines = [(order, size)]
        if sidebands:
            lines += [(order + side, size * rng.uniform(0.1, 0.4)) for side in (-2, -1, 1, 2) if order + side > 0]
        for at, height in lines:
            x += height * np.cos(2 * np.pi * at * turns + rng.uniform(0, 2 * np.pi))
    x = x + sum(resonator(x, hz, damping) for hz, damping in modes)
    noise = rng.standard_normal(t.size)
    noise += resonator(noise, 1300, 0.05)
    return t, x + noise * (x.std() / noise.std() * 10 ** (-snr_db / 20))


def error(found, law):
    return found.speed_hz / law.speed_hz(found.times_s) - 1


MESH = (20, 40, 60)
RUN = {"speed_range_hz": (5.0, 50.0), "max_acceleration_hz_s": 4.0}
LAWS = {
    "run-up": (ramp(10, 40, 10), 10, MESH),
    "run-down, gearbox of two stages": (ramp(40, 12, 10), 10, (17, 34, 51, 4.25, 8.5)),
    "swing": (swing(25, [(0.04, 0.3), (0.01, 1.1)]), 14, MESH),
    "shaft orders": (ramp(15, 35, 10), 10, (1, 2, 3, 4, 5, 6)),
    "constant": (ramp(25, 25 + 1e-9, 10), 10, MESH),
}


@pytest.fixture(scope="module")
def short_run_up():
    """Return a record of the run-up's first seconds, its orders, and the speed found in it."""
    law, _, orders = LAWS["run-up"]
    _, x = vibration(law, duration=3, orders=orders, snr_db=0, seed=6)
    return x, orders, estimate_speed(x, rate_hz=RATE_HZ, orders=orders, **RUN)


class TestAccuracy:
    @pytest.mark.parametrize(("name", "snr_db"), [*((name, -8) for name in LAWS), ("shaft orders", 0)])
    def test_speed(self, name, snr_db):
        law, duration, orders = LAWS[name]
        _, x = vibration(law, duration=duration, orders=orders, snr_db=snr_db, seed=3, sidebands=name != "shaft orders")
        found = estimate_speed(x, rate_hz=RATE_HZ, orders=orders, **RUN)
        assert found.status == "ok"
        assert np.isfinite(found.speed_hz).all()
        off = np.abs(error(found, law))
        # what is asked: 0.05 % in the median, 1 % for 95 of 100. Orders up to six tell a tenth of mesh orders, so that
        # shaft orders in noise 8 dB above them are let off; without that noise they are not
        assert np.median(off) <= (5e-4 if (name, snr_db) != ("shaft orders", -8) else 1e-3)
        assert np.quantile(off, 0.95) <= 0.01
        assert np.median(found.confidence) > 0.99

    def test_std_tells_the_error(self):
        law, duration, orders = LAWS["constant"]
        ratios = []
        for seed in range(3):
            _, x = vibration(law, duration=duration, orders=orders, snr_db=-5, seed=seed)
            found = estimate_speed(x, rate_hz=RATE_HZ, orders=orders, **RUN)
            ratios.append(error(found, law) * found.speed_hz / found.std_hz)
        # three records of some hundred independent windows: 6 % of scatter; neighbours are correlated, so twice that
        assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.6

    @pytest.mark.parametrize("speed", [4.0, 5.03, 8.0])
    def test_of_a_slow_shaft_speeds_that_frames_cannot_tell_apart_are_one(self, speed):
        """Orders 1 to 3 at 4 Hz: lines 2 bins wide lie 1 Hz of the mean order about it, 1 % would be a 25th of that."""
        orders = (1, 2, 3)
        law = ramp(speed, speed + 1e-9, 20)
        _, x = vibration(law, duration=20, orders=orders, snr_db=-5, seed=2, sidebands=False)
        found = estimate_speed(
            x,
            rate_hz=RATE_HZ,
            orders=orders,
            speed_range_hz=(0.6 * speed, 10),  # half of the speed would have the same lines
            max_acceleration_hz_s=0.1,
        )
        assert found.status == "ok"
        assert found.alternatives == ()
        assert found.confidence.min() > 0.99

    def test_phase_turns_with_the_shaft(self):
        law, _, orders = LAWS["swing"]
        _, x = vibration(law, duration=8, orders=orders, snr_db=0, seed=5)
        phase = estimate_speed(x, rate_hz=RATE_HZ, orders=orders, **RUN).phase
        t = np.linspace(phase.start_s, phase.stop_s, 4000)[200:-200]
        lag = phase.revolutions_at(t) - law.revolutions(t)
        # order 60 stays within a quarter of its turn over 200 revolutions; modes turn it a little
        assert np.ptp(lag) < 1 / 240
        assert 0 < phase.std_rad(t[:1])[0] < 0.01


class TestDoubt:
    def test_only_even_orders(self):
        law = ramp(12, 20, 12)
        _, x = vibration(law, duration=12, orders=range(1, 9), snr_db=5, seed=1, sidebands=False, missing=(1, 3, 5, 7))
        found = estimate_speed(x, rate_hz=RATE_HZ, orders=range(1, 9), speed_range_hz=(10, 45), max_acceleration_hz_s=2)
        assert found.status == "ambiguous"
        assert found.phase is None
        assert found.confidence.max() <= 0.5
        speeds = [found.speed_hz, *(other.speed_hz for other in found.alternatives)]
        ratios = {round(float(np.median(speed / law.speed_hz(found.times_s))), 2) for speed in speeds}
        assert {1.0, 2.0} <= ratios
        assert sum(other.probability for other in found.alternatives) < 1

    def test_missing_orders(self):
        law, duration, _ = LAWS["run-up"]
        orders = (20, 40, 60, 80, 100)
        _, x = vibration(law, duration=duration, orders=orders, snr_db=0, seed=2, missing=(40, 100))
        found = estimate_speed(x, rate_hz=RATE_HZ, orders=orders, **RUN)
        assert found.status == "ok"
        assert np.median(np.abs(error(found, law))) < 5e-4
        assert list(found.shown > 3) == [True, False, True, True, False]

    def test_three_harmonics_may_be_of_half_the_speed(self):
        _, x = vibration(ramp(20, 20 + 1e-9, 10), duration=10, orders=(1, 2, 3), snr_db=5, seed=3, sidebands=False)
        found, narrow = (
            estimate_speed(x, rate_hz=RATE_HZ, orders=(1, 2, 3), speed_range_hz=speeds, max_acceleration_hz_s=2)
            for speeds in ((8, 28), (15, 28))
        )
        assert (found.status, narrow.status) == ("ambiguous", "ok")
        assert any(abs(other.ratio - 0.5) < 1e-3 for other in found.alternatives)
        assert narrow.reason == ""

    def test_harmonics_without_the_meshes_may_be_of_another_machine(self):
        _, x = vibration(ramp(24, 24 + 1e-9, 5), duration=5, orders=(1, 2, 3), snr_db=10, seed=3, sidebands=False)
        orders = (1, 2, 3, 19.5, 39, 58.5)
        found = estimate_speed(x, rate_hz=RATE_HZ, orders=orders, speed_range_hz=(15, 38), max_acceleration_hz_s=2)
        assert found.status == "ambiguous"

    def test_a_constant_speed_beside_a_hum_does_not_roam(self):
        """Order 2 at 58.4 Hz and the mains at 60 Hz: windows of six turns, 5 Hz wide, followed their beat."""
        _, x = vibration(ramp(29.2, 29.2 + 1e-9, 10), duration=10, orders=(1, 2, 3), snr_db=0, seed=1, sidebands=False)
        t = np.arange(x.size) / RATE_HZ
        for hum in (0.3, 2.0):
            found = estimate_speed(
                x + hum * np.sin(2 * np.pi * 60 * t),
                rate_hz=RATE_HZ,
                orders=(1, 2, 3),
                speed_range_hz=(20, 41),
                max_acceleration_hz_s=5,
            )
            assert found.status == "ambiguous" or np.abs(found.speed_hz / 29.2 - 1).max() < 0.005

    @pytest.mark.parametrize("weak", [0.1, 0.2])
    def test_hum_speaks_for_no_speed(self, weak):
        # 1.25 times the speed has 16 and 32 where 20 and 40 are, and its first order, 50 Hz, at the mains
        law = swing(40.0, [(0.03, 0.2)])
        t = np.arange(int(6 * RATE_HZ)) / RATE_HZ
        lines = ((20.0, 1.0), (40.0, 1.0), (5.7, weak), (11.4, weak))
        x = sum(height * np.cos(2 * np.pi * order * law.revolutions(t) + order) for order, height in lines)
        x = x + 0.5 * np.cos(2 * np.pi * 50 * t) + np.random.default_rng(0).standard_normal(t.size)
        orders = [1.0, 5.7, 11.4, 16.0, 20.0, 32.0, 40.0]
        found = estimate_speed(
            x, rate_hz=RATE_HZ, orders=orders, speed_range_hz=(30.0, 52.0), max_acceleration_hz_s=5.0
        )
        assert found.status == "ok"
        assert abs(np.nanmedian(found.speed_hz / law.speed_hz(found.times_s)) - 1) < 1e-4

    def test_meshes_in_a_run_up_are_surer_than_a_pump(self):
        """In frames for order 3 a run-up smears the meshes 25 and 50, and a pump at 17.3 Hz passes for orders 1 to 3.

        A quarter of such a frame, 0.13 s, holds order 25 within a bin, 7.7 Hz: at 1.3 Hz/s it moves by 4.3 Hz.
        """
        law = ramp(20, 28, 6)
        t = np.arange(6 * 6400) / 6400
        lines = ((1, 0.3), (3, 0.5), (25, 1.0), (50, 0.7))
        x = sum(height * np.cos(2 * np.pi * order * law.revolutions(t) + order) for order, height in lines)
        x = x + sum(0.6 * np.cos(2 * np.pi * k * 17.3 * t + k) for k in (1, 2, 3))
        x = x + 2 * np.random.default_rng(0).standard_normal(t.size)
        search = {"orders": (1, 2, 3, 25, 50), "speed_range_hz": (10, 45), "max_acceleration_hz_s": 5}
        found = estimate_speed(x, rate_hz=6400, **search)
        assert found.status == "ok"
        assert np.nanmax(np.abs(error(found, law))) < 0.005

    @pytest.mark.parametrize("loud", [1.0, 8.0])
    def test_a_run_up_beside_a_louder_machine_of_constant_speed(self, loud):
        """A pump's four harmonics pass for orders 1 to 3 of a speed in the range; they stay in their bins."""
        law = ramp(12, 24, 6)
        t = np.arange(6 * 6400) / 6400
        x = sum(
            height * np.cos(2 * np.pi * order * law.revolutions(t) + order) for order, height in ((20, 0.3), (40, 0.25))
        )
        x = x + sum(loud / k * np.cos(2 * np.pi * 17.3 * k * t + k) for k in (1, 2, 3, 4))
        x = x + np.random.default_rng(0).standard_normal(t.size)
        found = estimate_speed(
            x, rate_hz=6400, orders=(1, 2, 3, *MESH), speed_range_hz=(9, 30), max_acceleration_hz_s=4
        )
        assert found.status == "ok"
        assert np.nanmax(np.abs(error(found, law))) < 0.005

    def test_two_machines(self):
        # a pump at another speed, its lines as strong: two answers, or none
        first, second = (
            vibration(ramp(f, f + 1e-9, 6), duration=6, orders=MESH, snr_db=20, seed=1)[1] for f in (25, 31.7)
        )
        x = first + second + np.random.default_rng(0).standard_normal(first.size)
        found = estimate_speed(x, rate_hz=RATE_HZ, orders=MESH, speed_range_hz=(20, 40), max_acceleration_hz_s=2)
        assert found.status == "ambiguous"
        both = sorted([np.median(found.speed_hz), *(np.median(a.speed_hz) for a in found.alternatives)])
        assert any(abs(f - 25) < 0.1 for f in both)
        assert any(abs(f - 31.7) < 0.1 for f in both)

    @pytest.mark.parametrize("orders", [MESH, (1, 2, 3, 4, 5, 6)])
    def test_noise_is_not_a_shaft(self, orders):
        found = [
            estimate_speed(
                np.random.default_rng(seed).standard_normal(20_000),
                rate_hz=5_000.0,
                orders=orders,
                speed_range_hz=(10, 40),
                max_acceleration_hz_s=2,
            )
            for seed in range(20)  # benchmarks/speed.py takes a hundred
        ]
        assert {one.status for one in found} == {"not found"}
        assert all(one.phase is None for one in found)

    def test_standstill_is_left_out(self):
        law = ramp(10, 30, 10)
        t, x = vibration(law, duration=10, orders=MESH, snr_db=0, seed=4)
        rng = np.random.default_rng(1)
        quiet = rng.standard_normal(int(5 * RATE_HZ)) * 0.3
        found = estimate_speed(np.concatenate([quiet, x]), rate_hz=RATE_HZ, orders=MESH, **RUN)
        assert found.status == "ok"
        still, turning = found.times_s < 4.6, found.times_s > 5.4  # frames of 0.16 s lie across the start
        assert np.isnan(found.speed_hz[still]).all()
        assert found.confidence[still].max() < 0.5
        true = law.speed_hz(found.times_s - 5)
        assert np.median(np.abs(found.speed_hz / true - 1)[turning]) < 5e-4
        assert found.phase.start_s > 4.5
        assert t[-1] + 5 - found.phase.stop_s < 0.01


class TestInput:
    @pytest.mark.compiles
    def test_scale(self, short_run_up):
        x, orders, one = short_run_up
        small = estimate_speed(x * 2.0**-60, rate_hz=RATE_HZ, orders=orders, **RUN)
        np.testing.assert_allclose(small.speed_hz, one.speed_hz, rtol=1e-12)

    @pytest.mark.parametrize(
        ("changes", "sentence"),
        [
            ({"x": np.r_[np.ones(99), np.nan, np.ones(9999)]}, "1 values that are not finite, the first at index 99"),
            ({"x": np.ones(1000)}, "3.91 revolutions at 50 Hz, the top of speed_range_hz; at least 10"),
            ({"speed_range_hz": (50, 5)}, "is empty; give a lower end below"),
            ({"orders": ()}, "orders is empty"),
            ({"orders": (20, -1)}, "an order=-1 must be above zero"),
            ({"orders": (2000,)}, "beyond half of rate_hz=12800"),
            ({"max_acceleration_hz_s": 0}, "max_acceleration_hz_s=0 must be above zero"),
        ],
    )
    def test_refusals(self, changes, sentence):
        settings = {"x": np.ones(50_000), "orders": MESH} | RUN | changes
        with pytest.raises(ValueError, match=sentence):
            estimate_speed(settings.pop("x"), rate_hz=RATE_HZ, **settings)


class TestRefinePhase:
    def test_without_noise_it_is_exact(self):
        # no noise, no modes: what is left are higher terms of the swing within a window of six revolutions
        law = swing(30, [(0.003, 0.2)])
        _, x = vibration(law, duration=10, orders=MESH, snr_db=200, seed=7, modes=())
        phase = constant_speed(29.9, start_s=0, stop_s=(x.size - 1) / RATE_HZ)
        found = refine_phase(x, rate_hz=RATE_HZ, phase=phase, orders=MESH, tolerance=0.007)
        inner = slice(8, -8)
        assert np.abs(found.speed_hz / law.speed_hz(found.times_s) - 1)[inner].max() < 2e-6

    def test_noise_is_not_found(self):
        phase = constant_speed(20.0, start_s=0, stop_s=9.9)
        found = [
            refine_phase(
                np.random.default_rng(seed).standard_normal(50_000),
                rate_hz=5_000.0,
                phase=phase,
                orders=orders,
                tolerance=0.008,
            )
            for seed in range(10)
            for orders in ((20,), MESH)
        ]
        assert {one.status for one in found} == {"not found"}
        assert all(one.phase is None for one in found)

    def test_a_part_of_the_record(self):
        law = ramp(20, 30, 10)
        t, x = vibration(law, duration=10, orders=MESH, snr_db=0, seed=8)
        inside = (t > 3) & (t < 8)
        rough = ShaftPhase(times_s=t[inside][::500], revolutions=1.002 * law.revolutions(t[inside][::500]))
        found = refine_phase(x, rate_hz=RATE_HZ, phase=rough, orders=MESH, tolerance=0.004)
        assert found.phase.start_s == pytest.approx(rough.start_s, abs=1e-3)
        assert found.phase.stop_s == pytest.approx(rough.stop_s, abs=1e-3)
        assert np.median(np.abs(found.speed_hz / law.speed_hz(found.times_s) - 1)) < 2e-4

    @pytest.mark.parametrize(
        ("changes", "sentence"),
        [
            ({"tolerance": 0.05}, "exceeds 3.5, the highest that is unambiguous"),
            ({"window_rev": 200.0}, "share 300 revolutions; windows of 200 require 400"),
            ({"start_s": 50.0}, "do not overlap; check start_s"),
            ({"orders": (220,), "tolerance": 0.0005}, "too close to half the sampling rate"),
            ({"x": np.r_[np.ones(5), np.inf, np.ones(127_995)]}, "1 values that are not finite"),
        ],
    )
    def test_refusals(self, changes, sentence):
        phase = constant_speed(30.0, start_s=0, stop_s=10.0)
        settings = {"x": np.ones(128_001), "phase": phase, "orders": MESH, "tolerance": 0.005} | changes
        with pytest.raises(ValueError, match=sentence):
            refine_phase(settings.pop("x"), rate_hz=RATE_HZ, **settings)


TURBINE_ORDERS = (20, 40, 60, 80, 100)
TURBINE = {
    "0311": "data-20130311T030024Z.mat",
    "0326": "data-20130326T014150Z.mat",
    "0420": "data-20130420T151307Z.mat",
    "0425": "data-20130425T232202Z.mat",
}


def turbine(real_data, day):
    record = scipy.io.loadmat(real_data / "wt_hss_bearing" / TURBINE[day])
    return record["vibration"].ravel(), record["tach"].ravel()


class TestTurbine:
    @pytest.mark.parametrize("day", ["0311", "0420", "0425"])
    def test_speed_beside_the_tachometer(self, real_data, day):
        x, pulses = turbine(real_data, day)
        found = estimate_speed(
            x, rate_hz=97656.0, orders=TURBINE_ORDERS, speed_range_hz=(5.0, 50.0), max_acceleration_hz_s=2.0
        )
        assert found.status == "ok"
        turns = np.diff(found.phase.revolutions_at(pulses[2:-2:2]))  # two pulses a revolution
        assert np.median(np.abs(turns - 1)) < 3e-4
        assert np.quantile(np.abs(turns - 1), 0.9) < 1e-3
        assert np.median(found.confidence) > 0.99

    @pytest.mark.parametrize(
        ("orders", "speeds"),
        [  # for another speed, for a tone with harmonics, and for a single order
            (TURBINE_ORDERS, (28.0, 33.0)),
            ((20, 40, 60), (5.0, 50.0)),
            ((1, 20, 40, 60), (28.0, 33.0)),
        ],
    )
    def test_without_mesh_lines_it_says_so(self, real_data, orders, speeds):
        x, _ = turbine(real_data, "0326")
        found = estimate_speed(x, rate_hz=97656.0, orders=orders, speed_range_hz=speeds, max_acceleration_hz_s=2.0)
        assert found.status != "ok"
        assert found.phase is None
        assert found.confidence.max() <= 0.5
