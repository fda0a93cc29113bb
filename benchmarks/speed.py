"""Speed without a tachometer, error against time: python benchmarks/speed.py [FOLDER].

Writes speed.md into FOLDER (default docs/benchmarks). Records are synthetic, their angle known in closed form; beside
ours runs the usual first try, the tallest peak of each frame of a spectrogram within the band of the first mesh order.
"""

import os

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from board.speed_records import mode
from numpy.typing import NDArray
from page_files import folder_given, table, write_page
from resampling import timed
from scipy.signal import ShortTimeFFT

from signals.shaft.phase import ShaftPhase
from signals.shaft.phase_demodulation import refine_phase
from signals.shaft.tacholess import estimate_speed

Floats = NDArray[np.float64]
Answer = tuple[str, Floats, Floats]  # status, times, speeds

RATE_HZ = 25_600.0
DURATION_S = 20.0
ORDERS = (20.0, 40.0, 60.0)
RANGE_HZ = (8.0, 45.0)
ACCELERATION_HZ_S = 3.0
REPEATS = 7
MODES = ((430.0, 0.05), (1900.0, 0.03))

NOTE = """\
Made by `python benchmarks/speed.py`, one thread. Orders 20, 40, 60 with two pairs of sidebands each, through modes at
430 and 1900 Hz, in noise, half of which passes through a mode at 1300 Hz; {seconds:g} s at {rate:g} Hz. Error: relative
error of the speed over all instants. Time: as a multiple of `numpy.fft.rfft` of the record, both timed alternately
{repeats} times, ratio of medians, without compilation. Search range: {low:g} to {high:g} Hz at up to {acceleration:g}
Hz/s. False alarms: how many of 100 records of noise, 5 s each, are accepted as a shaft ("ok"); white noise, and white
noise plus an equal part through a mode at 700 Hz, which is narrower than the bins over which noise is levelled."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """A record and the law of its shaft: mean speed, ramp (Hz/s), swings (fraction of the mean, Hz)."""

    name: str
    mean_hz: float
    ramp_hz_s: float
    swings: tuple[tuple[float, float], ...]
    snr_db: float

    def speed_hz(self, t: Floats) -> Floats:
        """Speed in closed form."""
        swing = sum((size * np.sin(2 * np.pi * f * t) for size, f in self.swings), np.zeros_like(t))
        return self.mean_hz * (1 + swing) + self.ramp_hz_s * t

    def revolutions(self, t: Floats) -> Floats:
        """Its integral."""
        swing = sum(
            (size * (1 - np.cos(2 * np.pi * f * t)) / (2 * np.pi * f) for size, f in self.swings), np.zeros_like(t)
        )
        return self.mean_hz * (t + swing) + self.ramp_hz_s * t**2 / 2

    def samples(self, seed: int) -> Floats:
        """Vibration in noise."""
        rng = np.random.default_rng(seed)
        t = np.arange(int(DURATION_S * RATE_HZ)) / RATE_HZ
        turns = self.revolutions(t)
        x = np.zeros(t.size)
        for order in ORDERS:
            size = rng.uniform(0.5, 1.0)
            for side in (-2, -1, 0, 1, 2):
                height = size * (1.0 if side == 0 else rng.uniform(0.1, 0.4))
                x += height * np.cos(2 * np.pi * (order + side) * turns + rng.uniform(0, 2 * np.pi))
        x = x + sum(mode(x, hz, damping, RATE_HZ) for hz, damping in MODES)
        noise = rng.standard_normal(t.size)
        noise += mode(noise, 1300.0, 0.05, RATE_HZ)
        return np.asarray(x + noise * (x.std() / noise.std() * 10 ** (-self.snr_db / 20)))


def ours(x: Floats) -> Answer:
    """`estimate_speed`."""
    found = estimate_speed(
        x,
        rate_hz=RATE_HZ,
        orders=ORDERS,
        speed_range_hz=RANGE_HZ,
        max_acceleration_hz_s=ACCELERATION_HZ_S,
    )
    return found.status, found.times_s, found.speed_hz


def refined(x: Floats, record: Record) -> Answer:
    """`refine_phase` from a phase half a per cent fast."""
    t = np.arange(x.size)[::1000] / RATE_HZ
    rough = ShaftPhase(times_s=t, revolutions=1.005 * record.revolutions(t))
    found = refine_phase(x, rate_hz=RATE_HZ, phase=rough, orders=ORDERS, tolerance=0.006)
    return found.status, found.times_s, found.speed_hz


def tallest_peak(x: Floats, frame_s: float = 0.2) -> Answer:
    """Tallest peak of each frame in the band of the first order, its place by a parabola."""
    length = int(frame_s * RATE_HZ)
    transform = ShortTimeFFT(np.hanning(length), hop=length // 2, fs=RATE_HZ, mfft=length)
    power = np.abs(transform.stft(x)) ** 2
    low, high = (int(ORDERS[0] * f * frame_s) for f in RANGE_HZ)
    peak = low + np.argmax(power[low:high], axis=0)
    below, at, above = (np.log(power[peak + k, np.arange(power.shape[1])] + 1e-300) for k in (-1, 0, 1))
    place = peak + 0.5 * (below - above) / (below - 2 * at + above)
    times = transform.t(x.size)
    inside = (times >= 0) & (times <= DURATION_S)
    return "-", times[inside], place[inside] / frame_s / ORDERS[0]


def false_alarms() -> tuple[int, int]:
    """Count the records of noise, white and through a mode of its own beside it, that are called a shaft."""
    samples, counts = int(5 * RATE_HZ), [0, 0]
    for seed in range(100):
        noise = np.random.default_rng(seed).standard_normal(samples)
        counts[0] += ours(noise)[0] == "ok"
        counts[1] += ours(noise + mode(noise, 700, 0.03, RATE_HZ))[0] == "ok"
    return counts[0], counts[1]


def rows(record: Record) -> list[list[str]]:
    """Run all ways on one record; return lines of a table."""
    x = record.samples(seed=1)
    ways = {
        "`estimate_speed`": lambda: ours(x),
        "`refine_phase` from 0.5 % off": lambda: refined(x, record),
        "tallest peak of a spectrogram": lambda: tallest_peak(x),
    }
    lines = []
    for name, way in ways.items():
        status, times, speeds = way()
        shown = np.isfinite(speeds)
        off = np.abs(speeds[shown] / record.speed_hz(times[shown]) - 1) * 100
        figures = [f"{np.median(off):.2g}", f"{np.quantile(off, 0.95):.2g}"] if off.size else ["-", "-"]
        took = timed(way, lambda: np.fft.rfft(x), REPEATS)
        lines.append([record.name, f"{record.snr_db:g} dB", name, status, *figures, f"{took:.2g}"])
    return lines


def main(folder: Path) -> None:
    """Write the report."""
    laws: tuple[tuple[str, float, float, tuple[tuple[float, float], ...]], ...] = (
        ("run-up 10 to 40 Hz", 10.0, 1.5, ()),
        ("swing about 25 Hz", 25.0, 0.0, ((0.04, 0.3), (0.01, 1.1))),
        ("constant 25 Hz", 25.0, 0.0, ()),
    )
    head = ["record", "SNR", "method", "status", "median error, %", "95 of 100 within, %", "time"]
    found: list[list[str]] = []
    for snr_db in (0.0, -8.0):
        for name, mean, slope, swings in laws:
            found += rows(Record(name=name, mean_hz=mean, ramp_hz_s=slope, swings=swings, snr_db=snr_db))
    note = NOTE.format(
        seconds=DURATION_S,
        rate=RATE_HZ,
        repeats=REPEATS,
        low=RANGE_HZ[0],
        high=RANGE_HZ[1],
        acceleration=ACCELERATION_HZ_S,
    )
    white, through_mode = false_alarms()
    alarms = f"False alarms: {white} of 100 in white noise, {through_mode} of 100 in noise with a mode."
    write_page(folder / "speed.md", ["# Speed without a tachometer", "", note, "", *table(head, found), alarms])


if __name__ == "__main__":
    main(folder_given())
