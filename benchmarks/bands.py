"""Kurtogram, chosen band, spectral correlation and envelopes timed: python benchmarks/bands.py [FOLDER].

Writes bands.md into FOLDER (default docs/benchmarks). The record: noise in which 50 impulses a second ring at
4,200 Hz, sampled at 20 kHz. The package openconmo (MIT) is timed beside the kurtogram where it is installed.
"""

import os
import sys

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )

import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.demodulation.band_selection import choose_band
from signals.demodulation.envelope import envelope, stream_envelope
from signals.demodulation.kurtogram import fast_kurtogram
from signals.spectra.cyclostationary import spectral_correlation

RATE_HZ = 20_000.0
RESONANCE_HZ, EVERY = 4200.0, 400
LEVELS = 7
MAX_CYCLIC_HZ, WINDOW = 500.0, 256
BLOCK = 10_000
BAND_HZ = (3700.0, 4700.0)

Floats = NDArray[np.float64]
PeerKurtogram = Callable[[Floats, float, int], tuple[Any, ...]]

NOTE = """\
Made by `python benchmarks/bands.py`, one thread: {samples:,} samples of noise in which 50 impulses a second ring at
4,200 Hz, at 20 kHz. Medians of {repeats}, the methods timed in turn, as multiples of `numpy.fft.rfft` of the same
record; compilation is apart."""


def record(samples: int) -> Floats:
    """Return noise of variance 1 with impulses of height 4 that decay within 2 ms."""
    times = np.arange(samples) / RATE_HZ
    hits = np.zeros(samples)
    hits[100::EVERY] = 4.0
    ring = np.exp(-times[:300] / 1e-3) * np.sin(2 * np.pi * RESONANCE_HZ * times[:300])
    impulses = np.convolve(hits, ring)[:samples]
    return np.asarray(impulses + np.random.default_rng(0).standard_normal(samples))


def peer() -> PeerKurtogram | None:
    """Return openconmo's kurtogram, if that package is there."""
    try:
        from openconmo.kurtogram import fast_kurtogram as theirs  # noqa: PLC0415
    except ImportError:
        return None
    return theirs  # type: ignore[no-any-return]


def periodogram(x: Floats, *, cyclic_hz: float, hop: int) -> NDArray[np.complex128]:
    """Return the averaged cyclic periodogram at one cyclic frequency, with the frames of the fast estimator."""
    window = np.hanning(WINDOW + 1)[:-1]
    moved = x * np.exp(2j * np.pi * cyclic_hz / RATE_HZ * np.arange(x.size))
    one, other = (
        np.fft.fft(np.lib.stride_tricks.sliding_window_view(s, WINDOW)[::hop] * window, axis=1) for s in (x, moved)
    )
    return np.asarray(np.mean(one * other.conj(), axis=0) / RATE_HZ / np.sum(window**2))


def timed(methods: dict[str, Callable[[], Any]], repeats: int) -> dict[str, float]:
    """Return the median seconds of each method, called in turn, after one call that is not counted."""
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    for turn in range(repeats + 1):
        for name, call in methods.items():
            start = time.perf_counter()
            call()
            if turn:
                seconds[name].append(time.perf_counter() - start)
    return {name: statistics.median(some) for name, some in seconds.items()}


def report(samples: int, repeats: int) -> list[str]:
    """Measure everything; return the lines of the page."""
    x = record(samples)
    before = x.copy()
    theirs = peer()
    fast = spectral_correlation(x, rate_hz=RATE_HZ, max_cyclic_hz=MAX_CYCLIC_HZ, window_length=WINDOW)
    methods: dict[str, Callable[[], Any]] = {
        "rfft": lambda: np.fft.rfft(x),
        "fast kurtogram": lambda: fast_kurtogram(x, rate_hz=RATE_HZ, levels=LEVELS),
        "fast kurtogram with negentropy": lambda: fast_kurtogram(
            x, rate_hz=RATE_HZ, levels=LEVELS, with_negentropy=True
        ),
        "choose_band": lambda: choose_band(x, rate_hz=RATE_HZ, levels=LEVELS),
        "fast spectral correlation": lambda: spectral_correlation(
            x, rate_hz=RATE_HZ, max_cyclic_hz=MAX_CYCLIC_HZ, window_length=WINDOW
        ),
        "cyclic periodogram, one cyclic frequency": lambda: periodogram(x, cyclic_hz=50.0, hop=fast.hop),
        "envelope of the whole record": lambda: envelope(x, rate_hz=RATE_HZ, band_hz=BAND_HZ),
        "envelope, streamed": lambda: streamed(x),
    }
    if theirs is not None:
        methods["openconmo's fast_kurtogram"] = lambda: theirs(x.copy(), RATE_HZ, LEVELS)
    seconds = timed(methods, repeats)
    lines = ["# Bands: kurtogram, spectral correlation, envelopes", "", NOTE.format(samples=samples, repeats=repeats)]
    lines += ["", "| method | time | seconds here |", "|---|---|---|"]
    lines += [f"| {name} | {some / seconds['rfft']:.3g} | {some:.3g} |" for name, some in seconds.items()]
    lines += ["", *kurtograms(x, theirs, seconds)]
    whole = seconds["cyclic periodogram, one cyclic frequency"] * fast.cyclic_hz.size
    correlation = (
        f"The fast spectral correlation holds {fast.cyclic_hz.size} cyclic frequencies by {fast.frequency_hz.size} "
        f"lines from {fast.frames} frames, {fast.hop} samples apart; by averaged cyclic periodograms, one after "
        f"another, that would take {whole / seconds['fast spectral correlation']:,.0f} times as long."
    )
    apart = np.abs(streamed(x) - envelope(x, rate_hz=RATE_HZ, band_hz=BAND_HZ))[1000:-1000]
    envelopes = (
        f"The streamed envelope differs from that of the whole record by {np.sqrt(np.mean(apart**2)):.2g} rms, of "
        f"{np.sqrt(np.mean(x**2)):.2g} rms of the record: it passes what its transitions of 250 Hz let through, the "
        "other cuts sharply."
    )
    if not np.array_equal(x, before):
        raise RuntimeError("a method changed the record it was given, so the figures are not of one record.")
    return [*lines, "", correlation, "", envelopes]


def streamed(x: Floats) -> Floats:
    """Return the envelope from blocks."""
    blocks = (x[first : first + BLOCK] for first in range(0, x.size, BLOCK))
    return np.concatenate(list(stream_envelope(blocks, rate_hz=RATE_HZ, band_hz=BAND_HZ)))


def kurtograms(x: Floats, theirs: PeerKurtogram | None, seconds: dict[str, float]) -> list[str]:
    """Return what the two kurtograms chose, and the ratio of their times."""
    gram = fast_kurtogram(x, rate_hz=RATE_HZ, levels=LEVELS)
    top = int(np.nanargmax(gram.kurtosis))
    lines = [f"Most kurtosis: {gram.kurtosis[top]:.2f} from {gram.low_hz[top]:.0f} to {gram.high_hz[top]:.0f} Hz."]
    if theirs is None:
        return [*lines, "openconmo is not installed, so its kurtogram was not timed."]
    given = x.copy()
    kurtosis, *_, middle, width = theirs(given, RATE_HZ, LEVELS)
    kept = "leaves the record as it was" if np.array_equal(given, x) else "writes into the record it is given"
    ratio = seconds["fast kurtogram"] / seconds["openconmo's fast_kurtogram"]
    found = f"{float(np.max(kurtosis)):.2f} from {middle - width / 2:.0f} to {middle + width / 2:.0f} Hz"
    return [*lines, f"openconmo finds {found}, and {kept}. Ours takes {ratio:.3g} of its time."]


def main(folder: Path, *, samples: int = 1_000_000, repeats: int = 3) -> int:
    """Measure, and write the page."""
    lines = report(samples, repeats)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bands.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/benchmarks")))
