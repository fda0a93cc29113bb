"""Sensor health: every fault made at several sizes, and sound records of many kinds that must pass."""

import numpy as np
import pytest
from scipy import signal as dsp

from signals.health import sensor_health

RATE_HZ = 10_000.0
N = 60_000
TIME = np.arange(N) / RATE_HZ


def judge(x, rate_hz=RATE_HZ):
    return sensor_health(x, rate_hz=rate_hz, units="g")


def kinds(x, rate_hz=RATE_HZ):
    return [fault.kind for fault in judge(x, rate_hz).faults]


def noise(seed, n=N):
    return np.random.default_rng(seed).normal(size=n)


def gear(seed):
    """A gear on a shaft of some speed, its mesh modulated once a revolution, in noise through a resonance."""
    rng = np.random.default_rng(seed)
    speed, teeth = rng.uniform(12, 45), int(rng.integers(17, 60))
    wander = 0.002 * np.cumsum(rng.normal(size=N)) / np.sqrt(RATE_HZ)
    turns = speed * TIME + wander
    x = sum(rng.uniform(0.1, 0.5) * np.cos(2 * np.pi * k * turns + rng.uniform(0, 6)) for k in (1, 2, 3))
    for k in (1, 2, 3):
        depth = 1 + rng.uniform(0, 0.5) * np.cos(2 * np.pi * turns)
        x = x + rng.uniform(0.2, 1) / k * depth * np.cos(2 * np.pi * k * teeth * turns)
    return x + dsp.lfilter([1], _resonance(rng.uniform(1500, 4000), 0.97), rng.normal(size=N)) * 0.1


def bearing(seed):
    """Impacts of a spall through a resonance, slipping, in noise."""
    rng = np.random.default_rng(seed)
    gaps = RATE_HZ / rng.uniform(60, 180) * (1 + 0.01 * rng.normal(size=2000))
    places = np.cumsum(gaps).astype(int)
    strikes = np.zeros(N)
    strikes[places[places < N]] = rng.normal(1, 0.2, size=np.count_nonzero(places < N))
    rung = dsp.lfilter([1], _resonance(rng.uniform(1500, 4000), 0.95), strikes)
    return rung * rng.uniform(1, 10) + rng.normal(size=N)


def runup(seed):
    """A speed that doubles, and a level that grows with its square."""
    rng = np.random.default_rng(seed)
    speed = np.linspace(1, 2, N)
    turns = 25 * np.cumsum(speed) / RATE_HZ
    return speed**2 * (np.cos(2 * np.pi * 23 * turns) + np.cos(2 * np.pi * turns) + 0.5 * rng.normal(size=N))


def _resonance(frequency_hz, radius):
    return [1, -2 * radius * np.cos(2 * np.pi * frequency_hz / RATE_HZ), radius**2]


def quantized(x, bits, of_range=2.5):
    step = of_range * np.abs(x).max() / 2 ** (bits - 1)
    return np.round(x / step) * step


# ---- sound records -----------------------------------------------------------------------------------------

SOUND = {
    "white noise": noise,
    "12 bits": lambda seed: quantized(noise(seed), 12),
    "8 bits": lambda seed: quantized(noise(seed), 8),
    "single precision": lambda seed: noise(seed).astype(np.float32),
    "coloured noise": lambda seed: dsp.lfilter([1], [1, -0.98], noise(seed)),
    "gear": gear,
    "gear, 16 bits": lambda seed: quantized(gear(seed), 16),
    "bearing": bearing,
    "bearing, 12 bits": lambda seed: quantized(bearing(seed), 12),
    "run-up": runup,
}


@pytest.mark.parametrize("kind", SOUND)
def test_twenty_sound_records_of_each_kind_pass(kind):
    # no alarm in the 200 of all kinds: with 95 % confidence fewer than 1.5 % of such records (rule of three)
    alarms = {seed: verdict.reasons for seed in range(20) if (verdict := judge(SOUND[kind](seed))).status != "ok"}
    assert not alarms


@pytest.mark.parametrize(("frequency_hz", "bits"), [(3.1, 6), (3.1, 16), (10.0, 8), (333.3, 6)])
def test_a_slow_sine_on_a_coarse_converter_passes(frequency_hz, bits):
    verdict = judge(quantized(np.sin(2 * np.pi * frequency_hz * TIME) + 1e-3 * noise(1), bits))
    assert verdict.status == "ok", verdict.reasons


def test_crests_of_a_slow_swing_are_no_dropouts():
    swing = (1 + 0.5 * np.cos(2 * np.pi * 0.4 * TIME)) * np.sin(2 * np.pi * 3.1 * TIME)
    assert judge(quantized(swing, 8)).status == "ok"


# ---- clipping ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [noise, lambda seed: quantized(noise(seed), 16), gear, bearing])
@pytest.mark.parametrize(("share", "status"), [(2e-4, "suspect"), (2e-3, "suspect"), (3e-2, "faulty")])
def test_clipping(make, share, status):
    x = make(3)
    limit = np.quantile(np.abs(x), 1 - share)
    cut = np.clip(x, -limit, limit)
    verdict = judge(cut)
    assert [fault.kind for fault in verdict.faults] == ["clipping"]
    assert verdict.status == status
    # a side with fewer than five flat samples passes for an ordinary extreme
    np.testing.assert_allclose(verdict.clipped.mean(), share, rtol=0.3)
    assert np.array_equal(verdict.clipped, np.abs(cut) == limit) or share < 1e-3
    assert f"{limit:.6g} g" in verdict.reasons[0]


def test_clipping_on_one_side():
    verdict = judge(np.minimum(noise(4), 1.5))
    assert [fault.kind for fault in verdict.faults] == ["clipping"]
    assert "-" not in verdict.reasons[0].split("reaches")[1].split("times")[0]


# ---- what is lost ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [noise, lambda seed: quantized(noise(seed), 12), gear, runup])
@pytest.mark.parametrize(("length", "status"), [(20, "suspect"), (3000, "faulty")])
@pytest.mark.parametrize("value", ["zero", "held", "gap"])
def test_dropouts(make, length, status, value):
    x = make(6)
    x[20_000 : 20_000 + length] = {"zero": 0.0, "held": x[20_000], "gap": np.nan}[value]
    verdict = judge(x)
    assert [fault.kind for fault in verdict.faults] == ["drop-out"]
    assert verdict.status == status
    # the sample before may by chance, or as the one that is held, have the same value
    assert verdict.lost[20_000 : 20_000 + length].all()
    assert length <= np.count_nonzero(verdict.lost) <= length + 1
    assert any(f"starting at {start_s}" in verdict.reasons[0] for start_s in ("2", "1.9999"))


@pytest.mark.parametrize("value", [0.0, -2.5])
def test_stuck_from_some_moment_on(value):
    x = noise(9)
    x[40_000:] = value
    verdict = judge(x)
    assert verdict.status == "faulty"
    assert verdict.faults[0].kind == "stuck"
    assert f"stuck at {value:.6g} g to the end, for 2 s, starting at 4 s" in verdict.reasons[0]


@pytest.mark.parametrize("x", [np.zeros(1000), np.full(1000, 3.3), np.full(1000, np.nan)])
def test_dead_throughout(x):
    verdict = judge(x)
    assert (verdict.status, verdict.faults[0].kind) == ("faulty", "stuck")
    assert verdict.missing.all()


def test_dead_but_for_one_sample():
    x = np.zeros(10_000)
    x[4000] = 1.0
    verdict = judge(x)
    assert verdict.status == "faulty"
    assert np.count_nonzero(verdict.lost) == 9999


# ---- hum ---------------------------------------------------------------------------------------------------


def humming(mains_hz, level):
    """Return hum of RMS `level`, its odd harmonics falling as rectifiers make them."""
    lines = sum(
        height * np.sin(2 * np.pi * k * mains_hz * TIME + k) for k, height in ((1, 1), (3, 0.4), (5, 0.2), (7, 0.1))
    )
    return level * lines / lines.std()


@pytest.mark.parametrize("mains_hz", [49.93, 60.0])
@pytest.mark.parametrize(("level", "status"), [(0.2, "suspect"), (1.0, "faulty")])
def test_hum(mains_hz, level, status):
    verdict = judge(noise(10) + humming(mains_hz, level))
    assert [fault.kind for fault in verdict.faults] == ["mains hum"]
    assert verdict.status == status
    found_hz = float(verdict.reasons[0].split("lines at ")[1].split(" Hz")[0])
    assert found_hz == pytest.approx(mains_hz, abs=0.02)  # steps of 1/6 Hz, interpolated between
    # lobes hold a little noise too
    assert verdict.faults[0].size == pytest.approx(level / np.sqrt(1 + level**2), rel=0.05)


@pytest.mark.parametrize("divisor", [2, 3])
def test_a_machine_at_a_divisor_of_the_mains_does_not_hum(divisor):
    lines = sum(np.cos(2 * np.pi * 50 / divisor * k * TIME + k) / k for k in range(1, 16))
    assert judge(lines + noise(11)).status == "ok"


# ---- loose sensors -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(("level", "status"), [(0.7, "suspect"), (3.0, "faulty")])
def test_a_ski_slope(order, level, status):
    # an integrated noise falls by 6 dB an octave, twice over by 12; its slowest part, below 0.5 Hz, is left out
    slow = dsp.sosfilt(dsp.butter(1, 0.5, "highpass", fs=RATE_HZ, output="sos"), np.cumsum(noise(12)))
    if order == 2:
        slow = dsp.lfilter([1], [1, -np.exp(-2 * np.pi / RATE_HZ)], slow)
    verdict = judge(noise(13) + level * slow / slow.std())
    assert "ski slope" in [fault.kind for fault in verdict.faults]
    assert verdict.status == status


def test_lines_of_a_slow_shaft_are_no_part_of_a_ski_slope():
    slow = dsp.sosfilt(dsp.butter(1, 0.5, "highpass", fs=RATE_HZ, output="sos"), np.cumsum(noise(12)))
    drifting = noise(13) + 0.7 * slow / slow.std()
    shaft = sum(np.cos(2 * np.pi * 1.7 * k * TIME + k) for k in range(1, 9))  # up to 14 Hz, with most of the power
    alone, turning = judge(drifting), judge(drifting + 2 * shaft)
    assert [fault.kind for fault in turning.faults] == ["ski slope"]
    assert turning.status == "suspect"
    assert turning.faults[0].size < alone.faults[0].size  # of the power of all


@pytest.mark.parametrize(("factor", "status"), [(2.5, "suspect"), (12, "faulty")])
@pytest.mark.parametrize("at", [0.3, 0.77])
@pytest.mark.parametrize("up", [True, False])
def test_a_jump_of_level(factor, status, at, up):
    later = at * TIME[-1] < TIME
    verdict = judge(gear(14) * np.where(later == up, factor, 1.0))
    assert [fault.kind for fault in verdict.faults] == ["level jump"]
    assert verdict.status == status
    assert verdict.faults[0].size == pytest.approx(factor, rel=0.1)
    seconds = float(verdict.reasons[0].split("about ")[1].split(" s")[0])
    assert abs(seconds - at * TIME[-1]) < 0.2  # two of the 64 parts of six seconds


def test_a_jump_of_level_where_the_speed_changes_is_no_sick_sensor():
    x = gear(14) * np.where(0.5 * TIME[-1] < TIME, 12, 1.0)
    at = np.linspace(0, 1, 200)
    stepping, steady, earlier = 20 + 6 * (at > 0.5), np.full(200, 20.0), 20 + 6 * (at > 0.2)  # at another time
    found = sensor_health(x, rate_hz=RATE_HZ, units="g", speed_hz=stepping)
    assert [fault.kind for fault in found.faults] == ["level jump"]
    assert found.status == "suspect"
    assert "where the speed changes from 20 to 26 rev/s and may cross a resonance" in found.reasons[0]
    for speed_hz in (steady, earlier, None):
        assert sensor_health(x, rate_hz=RATE_HZ, units="g", speed_hz=speed_hz).status == "faulty"


@pytest.mark.parametrize(("width", "status"), [(0.0, "faulty"), (0.05, "suspect")])
def test_a_jump_of_level_in_a_run_up_is_a_sick_sensor_if_it_is_sudden(width, status):
    """A cable that comes off, and a resonance that the speed takes a twentieth of the record to pass."""
    share = np.clip((TIME / TIME[-1] - 0.5) / max(width, 1e-9) + 0.5, 0, 1)
    verdict = sensor_health(gear(14) * 0.03**share, rate_hz=RATE_HZ, units="g", speed_hz=np.linspace(15, 30, 200))
    assert [(fault.kind, fault.severity) for fault in verdict.faults] == [("level jump", status)]


@pytest.mark.parametrize(("offset", "status"), [(5.0, "suspect"), (50.0, "faulty")])
def test_a_jump_of_the_mean(offset, status):
    verdict = judge(noise(15) + offset * (TIME > 2))
    found = {fault.kind: fault for fault in verdict.faults}
    assert found["offset jump"].severity == status
    assert found["offset jump"].size == pytest.approx(offset, rel=0.1)


# ---- spikes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", [noise, gear, bearing, lambda seed: quantized(noise(seed), 16)])
@pytest.mark.parametrize(("count", "height"), [(1, 4.0), (10, 10.0)])
def test_spikes(make, count, height):
    x = make(16)
    places = np.linspace(1000, 50_000, count).astype(int)
    x[places] = height * np.abs(x).max() * (-1.0) ** np.arange(count)
    verdict = judge(x)
    assert [fault.kind for fault in verdict.faults if fault.kind != "clipping"] == ["spikes"]
    assert verdict.status == "suspect"
    assert f"{count} isolated spikes" in verdict.reasons[-1]
    assert np.array_equal(np.flatnonzero(verdict.spiked), np.sort(np.concatenate([places - 1, places, places + 1])))


# ---- what cannot be judged ---------------------------------------------------------------------------------


def test_short_records_say_what_they_cannot_tell():
    verdict = judge(noise(19, 500))
    assert verdict.status == "ok"
    assert len(verdict.not_judged) == 3
    assert "detecting mains hum takes 1 s" in verdict.not_judged[0]
    assert "detecting jumps in level takes 4096 samples; the record has 500" in verdict.not_judged[2]


def test_what_is_no_record():
    with pytest.raises(ValueError, match="63 values; at least 64"):
        judge(np.zeros(63))
    with pytest.raises(ValueError, match="holds infinite values"):
        judge(np.r_[noise(20, 100), np.inf])


# ---- measured records --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "channel", "rate_hz"),
    [
        ("cwru/B007_0.mat", "X118_DE_time", 12000),
        ("cwru/IR007_0.mat", "X105_DE_time", 12000),
        ("cwru/normal_0.mat", "X097_DE_time", 48000),
        ("mfpt/InnerRaceFault_vload_1.mat", "bearing.gs", 48828),
        ("mfpt/OuterRaceFault_vload_1.mat", "bearing.gs", 48828),
        ("wt_hss_bearing/data-20130311T030024Z.mat", "vibration", 97656),
        ("wt_hss_bearing/data-20130425T232202Z.mat", "vibration", 97656),
    ],
)
def test_measured_records_pass_sound_or_faulty(real_data, file, channel, rate_hz):
    from hums.readers import read_file  # noqa: PLC0415

    verdict = judge(read_file(real_data / file).vector(channel), rate_hz)
    assert verdict.status == "ok", verdict.reasons


@pytest.mark.parametrize("samples", [20_000, 20_001])
def test_single_precision_finds_what_double_does(samples):
    rng = np.random.default_rng(4)
    hum = sum(np.sin(2 * np.pi * 50 * k * np.arange(samples) / 4000) for k in (1, 2, 3))
    x = (rng.standard_normal(samples) + hum).astype(np.float32)
    x[3000:3100] = x[3000]
    single, exact = (sensor_health(values, rate_hz=4000.0, units="g") for values in (x, x.astype(np.float64)))
    assert {fault.kind for fault in exact.faults} == {"mains hum", "drop-out"}
    assert single.reasons == exact.reasons
    np.testing.assert_array_equal(single.missing, exact.missing)


def test_a_known_transform_is_used():
    x = noise(3) + 2 * np.sin(2 * np.pi * 50 * TIME) + np.sin(2 * np.pi * 100 * TIME) + np.sin(2 * np.pi * 150 * TIME)
    transform = np.fft.rfft(x - x.mean())
    assert kinds(x) == ["mains hum"]
    given = sensor_health(x, rate_hz=RATE_HZ, units="g", transform=transform).faults
    assert [(fault.kind, fault.size) for fault in given] == [("mains hum", pytest.approx(judge(x).faults[0].size))]
    silent = sensor_health(x, rate_hz=RATE_HZ, units="g", transform=1e-9 * np.abs(transform[::-1]))
    assert not silent.faults  # it is the transform that is looked at
    with pytest.raises(ValueError, match="leave it out"):
        sensor_health(x, rate_hz=RATE_HZ, units="g", transform=transform[1:])
