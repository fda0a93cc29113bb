"""How often the truth lies within a nominal 90 % of estimates, and how large `std` is beside the error.

A cell is a kind of record, an estimator and its poles, and amplitudes that are drawn from the model (coverage 85 to
95 %, median `std` over the root mean square error 0.8 to 1.25) or constant, where the prior adds (at least 85 %, at
most 1.6). Its records are 20 / bandwidth long, with outputs 1 / bandwidth apart and the noise estimated. The first line
is judged.
"""

import inspect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jobs import Floats
from numpy.typing import NDArray
from page_files import table

from signals.harmonics import Bandwidth, track_orders, track_slipping_order

KINDS = {
    "white": "white noise",
    "pink": "pink noise",
    "resonance": "a resonance at the line, its half-power width 12 bandwidths",
    "narrow": "a resonance 6 bandwidths wide",
    "gaps": "white noise, a sixth missing in gaps of up to 2 / bandwidth",
    "clipped": "white noise, 5 % of the samples clipped, `clip_limits` given",
    "offset": "white noise, with an offset of five times its std",
    "AM": "white noise, amplitudes modulated by 50 % at a quarter of the bandwidth",
    "run-up": "pink noise, speed increasing threefold",
}
ESTIMATORS: tuple[Literal["smoother"], Literal["filter"]] = ("smoother", "filter")
RATE_HZ, BANDWIDTH_HZ, SAMPLES, CHANNELS = 1000.0, 2.0, 10_000, 24
ORDERS, TURN_HZ, RUN_UP_HZ = (3.0, 7.3), 40.0, (20.0, 60.0)
WIDTHS = {"resonance": 12.0, "narrow": 6.0}  # of a mode, in bandwidths
GAPS = (0.17, 0.19), (0.41, 0.46), (0.72, 0.82)  # parts of the record
OFFSET, DEPTH, MODULATION = 5.0, 0.5, 0.25  # modulation in bandwidths
WITHIN = 1.645  # standard deviations: 90 % of a normal distribution
DRAWN, CONSTANT = ((0.85, 0.95), (0.8, 1.25)), ((0.85, 1.0), (0.0, 1.6))  # limits of coverage and ratio
# of the slipping order: samples a revolution, bandwidth in orders and change of the slip in a revolution
SLIPPING, PER_REV, WIDTH, CHANGE, RECORDS = 3.6, 32.0, 0.1, 1e-3, 24
SLIPPING_KINDS = ("white", "pink", "resonance", "gaps", "offset", "run-up")
FASTER = (1, 2, 4, 8)  # than declared


@dataclass(frozen=True, kw_only=True)
class Cell:
    """What one estimator's `std` is worth on one kind of record."""

    kind: str
    drawn: bool
    estimator: str
    poles: int
    coverage: float
    ratio: float

    @classmethod
    def of(cls, wrong: Floats, std: Floats, **what: Any) -> "Cell":  # noqa: ANN401
        """Return the cell of errors, (..., record, output), that compare with (record, output) `std`."""
        typical = np.median(std, axis=0)
        ratio = 1 / np.sqrt(np.mean((wrong / typical) ** 2))
        return cls(coverage=float(np.mean(np.abs(wrong) < WITHIN * std)), ratio=float(ratio), **what)

    @property
    def holds(self) -> bool:
        """Whether coverage and ratio are within their limits."""
        coverage, ratio = DRAWN if self.drawn else CONSTANT
        return coverage[0] <= self.coverage <= coverage[1] and ratio[0] <= self.ratio <= ratio[1]

    @property
    def amplitudes(self) -> str:
        """How the true amplitudes are made."""
        return "of the model" if self.drawn else "constant"

    def __str__(self) -> str:
        words = f"{100 * self.coverage:.0f} %, {self.ratio:.2f}"
        return words if self.holds else f"**{words}**"


def cells(kind: str, poles: Sequence[int], *, first: int = 0) -> Iterator[Cell]:
    """Yield the cells of `track_orders` on one kind of record."""
    for number in poles:
        for drawn in (True, False) if kind != "AM" else (False,):
            rng = np.random.default_rng([53, first, number, drawn])
            x, turn, truth = _records(rng, kind, number, drawn=drawn)
            for estimator in ESTIMATORS if kind != "clipped" else ESTIMATORS[:1]:
                given = _tracking(turn, number, estimator)
                if kind == "clipped" and "clip_limits" in inspect.signature(track_orders).parameters:
                    given["clip_limits"] = [-1.0, 1.0]  # older trees have none
                tracks = track_orders(x, **given)
                wrong = (tracks.complex_amplitude - truth[..., :: given["output_every"]])[:, 0, 1:]
                parts = np.stack([wrong.real, wrong.imag])
                yield Cell.of(parts, tracks.std[:, 0, 1:], kind=kind, drawn=drawn, estimator=estimator, poles=number)


def _tracking(turn: Floats, poles: int, estimator: str) -> dict[str, Any]:
    return {
        "phase_rad": turn,
        "orders": ORDERS,
        "bandwidth_hz": BANDWIDTH_HZ,
        "rate_hz": RATE_HZ,
        "poles": poles,
        "estimator": estimator,
        "output_every": round(RATE_HZ / BANDWIDTH_HZ),
    }


def _records(
    rng: np.random.Generator, kind: str, poles: int, *, drawn: bool
) -> tuple[Floats, Floats, NDArray[np.complex128]]:
    """Return (channel, sample) records, the shaft's angle, and the (channel, order, sample) amplitudes."""
    at = np.arange(SAMPLES) / RATE_HZ
    speed = np.linspace(*RUN_UP_HZ, SAMPLES) if kind == "run-up" else np.full(SAMPLES, TURN_HZ)
    turn = 2 * np.pi * np.cumsum(speed) / RATE_HZ
    size = CHANNELS, len(ORDERS), 1
    truth = np.exp(2j * np.pi * rng.uniform(size=size)) * np.ones(SAMPLES)
    if kind == "AM":
        swing = 2 * np.pi * (MODULATION * BANDWIDTH_HZ * at + rng.uniform(size=size))
        truth = truth * (1 + DEPTH * np.sin(swing))
    if drawn:
        density = [_density(kind, order * speed, ORDERS[0] * TURN_HZ, BANDWIDTH_HZ) for order in ORDERS]
        truth += _walks(rng, np.stack(density), poles)
    x = _noise(rng, kind, (CHANNELS, SAMPLES), RATE_HZ, ORDERS[0] * TURN_HZ, BANDWIDTH_HZ)
    for place, order in enumerate(ORDERS):
        x += (truth[:, place] * np.exp(1j * order * turn)).real
    x += OFFSET if kind == "offset" else 0.0
    if kind == "clipped":
        limit = np.quantile(np.abs(x), 0.95, axis=-1, keepdims=True)
        return np.clip(x / limit, -1, 1), turn, truth / limit[..., None]
    return _cut(x, kind), turn, truth


def _walks(rng: np.random.Generator, density: Floats, poles: int) -> NDArray[np.complex128]:
    """Return walks of the model in noise of a density, (order, sample), less the polynomial that it leaves open."""
    q = 2 * density / Bandwidth(width=BANDWIDTH_HZ / RATE_HZ, poles=poles).weight ** 2
    walks = np.sqrt(q) * (rng.standard_normal((CHANNELS, *q.shape)) + 1j * rng.standard_normal((CHANNELS, *q.shape)))
    for _ in range(poles):
        np.cumsum(walks, axis=-1, out=walks)
    basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1, 1, SAMPLES), poles - 1))
    return np.asarray(walks - (walks @ basis) @ basis.T)


def _density(kind: str, at: Floats, line: float, bandwidth: float) -> Floats:
    """Return the density of the noise, relative to that at the line."""
    if kind in ("pink", "run-up"):
        return np.asarray(line / np.maximum(at, line / 1000))
    if kind in WIDTHS:
        loss = WIDTHS[kind] * bandwidth / line
        return np.asarray(loss**2 / ((1 - (at / line) ** 2) ** 2 + (loss * at / line) ** 2))
    return np.ones_like(at)


def _noise(
    rng: np.random.Generator, kind: str, shape: tuple[int, ...], rate: float, line: float, bandwidth: float
) -> Floats:
    lines = np.fft.rfft(rng.standard_normal(shape))
    density = _density(kind, np.fft.rfftfreq(shape[-1], 1 / rate), line, bandwidth)
    return np.asarray(np.fft.irfft(lines * np.sqrt(density), shape[-1]))


def _cut(x: Floats, kind: str) -> Floats:
    for begin, end in GAPS if kind == "gaps" else ():
        x[..., round(begin * x.shape[-1]) : round(end * x.shape[-1])] = np.nan
    return x


def slipping_cells(kind: str, *, first: int = 0, records: int = RECORDS) -> Iterator[Cell]:
    """Yield the cells of `track_slipping_order` on one kind of record: of the amplitude, and of a slip of the model."""
    for drawn in (True, False):
        for estimator in ESTIMATORS:
            found = [_followed(kind, estimator, first + n, drawn=drawn)[1:] for n in range(records)]
            wrong, std, off, slip_std = (np.stack(values) for values in zip(*found, strict=True))
            yield Cell.of(wrong, std, kind=f"slipping, {kind}: amplitude", drawn=drawn, estimator=estimator, poles=1)
            if drawn:
                yield Cell.of(off, slip_std, kind=f"slipping, {kind}: slip", drawn=drawn, estimator=estimator, poles=1)


def _followed(
    kind: str, estimator: str, number: int, *, drawn: bool, faster: float = 1.0
) -> tuple[str, Floats, Floats, Floats, Floats]:
    """Return the status, and errors and `std` of amplitude and slip, of one slipping line."""
    rng, apart = np.random.default_rng([54, number]), round(PER_REV / WIDTH)
    samples = 20 * apart
    speed = np.linspace(0.5, 1.5, samples) if kind == "run-up" else np.ones(samples)
    step = 2 * np.pi * speed / PER_REV
    slip = CHANGE * (
        10 * rng.standard_normal() + faster * np.cumsum(np.sqrt(speed / PER_REV) * rng.standard_normal(samples))
    )
    turn = np.cumsum(step)
    truth = np.full(samples, np.exp(2j * np.pi * rng.uniform()))
    if drawn:
        q = 2 / Bandwidth(width=WIDTH / PER_REV, poles=1).weight ** 2
        scale = np.sqrt(q * _density(kind, SLIPPING * speed, SLIPPING, WIDTH))
        truth += np.cumsum(scale * (rng.standard_normal(samples) + 1j * rng.standard_normal(samples)))
    x = OFFSET * (kind == "offset") + _noise(rng, kind, (samples,), PER_REV, SLIPPING, WIDTH)
    x += (truth * np.exp(1j * SLIPPING * np.cumsum(step * (1 + slip)))).real
    given: dict[str, Any] = {"phase_rad": turn, "order": SLIPPING, "largest_slip": 0.06, "slip_change_per_rev": CHANGE}
    track = track_slipping_order(
        _cut(x, kind), **given, bandwidth_hz=WIDTH, rate_hz=PER_REV, estimator=estimator, output_every=apart
    )
    at = track.sample_index[1:]
    off = track.slip[1:] - slip[at]
    wrong = np.abs(track.complex_amplitude[0, 1:]) - np.abs(truth[at])
    return track.status, wrong, track.amplitude_std[0, 1:], off, track.slip_std[1:]


def unnoticed(faster: float, number: int, estimator: str = "smoother") -> tuple[bool, float]:
    """Return whether a slip faster than declared is said to be converged, and the coverage of its `slip_std`."""
    status, _, _, off, std = _followed("white", estimator, number, drawn=True, faster=faster)
    return status == "converged", float(np.mean(np.abs(off) < WITHIN * std))


def lag(estimator: str, poles: int, modulation: float) -> float:
    """Return the error on an amplitude that is modulated without noise, over the modulation."""
    at = np.arange(SAMPLES) / RATE_HZ
    truth = DEPTH * np.cos(2 * np.pi * modulation * BANDWIDTH_HZ * at)
    turn = 2 * np.pi * TURN_HZ * at
    given = _tracking(turn, poles, estimator)
    tracks = track_orders((1 + truth) * np.cos(ORDERS[0] * turn), **given | {"output_every": 50}, noise_variance=1.0)
    wrong = (tracks.complex_amplitude[0] - 1 - truth[::50])[len(truth) // 150 : -len(truth) // 250]
    return float(np.sqrt(np.mean(np.abs(wrong) ** 2)) / DEPTH * np.sqrt(2))


def coverage(poles: Sequence[int], kinds: Sequence[str] = tuple(KINDS), records: int = RECORDS) -> list[str]:
    """Return the tables of the cells, of slips faster than declared, and of errors on modulations."""
    found = [cell for kind in kinds for cell in cells(kind, poles)]
    found += [cell for kind in SLIPPING_KINDS if kind in kinds for cell in slipping_cells(kind, records=records)]
    rows: dict[tuple[str, str, str], list[str]] = {}
    for one in found:
        rows.setdefault((one.kind, one.amplitudes, one.estimator), []).append(str(one))
    numbers = [f"{number} pole{'s' * (number > 1)}" for number in poles]
    lines = [f"- {kind}: {KINDS[kind]}" for kind in kinds]
    filled = [(*what, *some, *["-"] * (len(poles) - len(some))) for what, some in rows.items()]
    lines += ["", *table(("record", "amplitudes", "estimator", *numbers), filled)]
    lines += [f"{sum(not cell.holds for cell in found)} of {len(found)} cells are outside the limits."]
    faster = [(times, *zip(*(unnoticed(times, n) for n in range(records)), strict=True)) for times in FASTER]
    slips = [(f"{times} times", f"{sum(said)} of {records}", f"{np.mean(held):.2f}") for times, said, held in faster]
    lines += ["", *table(("slip over the declared change", "reported as converged", "coverage of the slip"), slips)]
    lags = [
        (f"{m:g}", each, *(f"{lag(each, p, m):.2f}" for p in poles)) for m in (0.25, 0.5, 1.0) for each in ESTIMATORS
    ]
    return lines + table(("modulation frequency in bandwidths: error over depth", "estimator", *numbers), lags)
