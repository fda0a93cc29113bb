"""The standard jobs of the trackers: records whose complex amplitudes are known exactly.

A job is `x = sum_k Re{ Z_k exp(j theta_k) } + v` with white normal noise v of variance 1. With `u` the sample number
over the number of samples and K orders, a generator seeded with the job's number draws, once and in this order::

    A = uniform(0.3, 1, K)   f = uniform(2, 6, K)   m = uniform(1, 4, K)   p = uniform(0, 2 pi, (3, K))
    Z_k(u) = A_k (1 + 0.35 sin(2 pi f_k u + p_0k)) exp(j (p_1k + 0.5 m_k sin(2 pi 1.3 u + p_2k)))
    v = standard_normal(samples)

A job that is cut short is the beginning of the full one, to the last bit.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
JobName = Literal["J1 run-up", "J2 crossing", "J3 angle", "J4 close"]

RATE_HZ = 50_000.0
SAMPLES_PER_REV = 512.0
TEN_ORDERS = (1.0, 2.0, 3.0, 4.6, 7.1, 12.3, 20.0, 27.0, 36.0, 54.0)
MIDDLE = 0.9  # of the outputs, over which an error is taken


@dataclass(frozen=True, kw_only=True, eq=False)
class Envelopes:
    """Complex amplitudes Z of all orders, as drawn for one job.

    Attributes
    ----------
    samples : how many there are in the full record: u goes from 0 to 1 over it.
    level, depth_rad, ripples : (order,) arrays A, 0.5 m and f.
    phase_rad : (3, order) array p.
    """

    samples: int
    level: Floats
    ripples: Floats
    depth_rad: Floats
    phase_rad: Floats

    @classmethod
    def drawn(cls, rng: np.random.Generator, *, orders: int, samples: int) -> "Envelopes":
        """Draw A, f, m, p, in this order."""
        level, ripples, swing = rng.uniform(0.3, 1.0, orders), rng.uniform(2, 6, orders), rng.uniform(1, 4, orders)
        phase_rad = rng.uniform(0, 2 * np.pi, (3, orders))
        return cls(samples=samples, level=level, ripples=ripples, depth_rad=0.5 * swing, phase_rad=phase_rad)

    def of(self, order: int, at: Indices) -> NDArray[np.complex128]:
        """Z of one order (its place in the list) at these samples."""
        u = at / self.samples
        early, constant, slow = self.phase_rad[:, order]
        swell = 1 + 0.35 * np.sin(2 * np.pi * self.ripples[order] * u + early)
        turn = constant + self.depth_rad[order] * np.sin(2 * np.pi * 1.3 * u + slow)
        return np.asarray(self.level[order] * swell * np.exp(1j * turn))


@dataclass(frozen=True, kw_only=True, eq=False)
class Job:
    """One record, what is to be found in it, and how far an answer is from it.

    Attributes
    ----------
    name : as the report calls it.
    x : (sample,) array, the record.
    phase_rad : (sample,) array of the shaft, or a mapping from shaft to such arrays.
    orders : cycles per revolution, or (shaft, order) pairs where the phases are a mapping.
    rate : samples per second, or per revolution where `per_revolution`.
    per_revolution : whether the record is sampled in angle.
    envelopes : the truth.
    """

    name: JobName
    x: Floats
    phase_rad: Floats | Mapping[str, Floats]
    orders: tuple[float, ...] | tuple[tuple[str, float], ...]
    rate: float
    per_revolution: bool
    envelopes: Envelopes

    @property
    def samples(self) -> int:
        """Samples in the record."""
        return self.x.size

    def amplitude(self, at: Indices) -> NDArray[np.complex128]:
        """(order, output) true complex amplitudes at these samples."""
        return np.stack([self.envelopes.of(order, at) for order in range(len(self.orders))])

    def angle_rad(self, order: int) -> Floats:
        """(sample,) array, the angle theta of one order (its place in the list)."""
        return _angle(self.phase_rad, self.orders[order])

    def tracking(self, bandwidth: float | Floats) -> dict[str, Any]:
        """Return the arguments that put this job to `track_orders`, at this bandwidth in Hz or in orders."""
        names = ("bandwidth_orders", "samples_per_rev") if self.per_revolution else ("bandwidth_hz", "rate_hz")
        rates = dict(zip(names, (bandwidth, self.rate), strict=True))
        return {"x": self.x, "phase_rad": self.phase_rad, "orders": self.orders, **rates}

    def error(self, amplitude: NDArray[np.complex128], at: Indices) -> float:
        """`sqrt(sum |Zhat - Z|^2 / sum |Z|^2)` over all orders and the middle 90 % of the outputs.

        Parameters
        ----------
        amplitude : (order, output) array, Zhat.
        at : (output,) array, the sample each output belongs to.
        """
        margin = round((1 - MIDDLE) / 2 * at.size)
        middle = slice(margin, at.size - margin)
        wrong = power = 0.0
        for order, estimate in enumerate(amplitude[:, middle]):
            truth = self.envelopes.of(order, at[middle])
            power += float(np.sum(np.abs(truth) ** 2))
            wrong += float(np.sum(np.abs(estimate - truth) ** 2))
        return float(np.sqrt(wrong / power))


def standard_job(name: JobName, *, samples: int | None = None) -> Job:
    """Make a job, or the first `samples` of it.

    J1: ten orders of a shaft that runs up from 10 to 40 Hz in 20 s. J2: orders 20 and 20.2 of the same shaft, and a
    line at 300 Hz that both cross. J3: the ten orders in a record of 2,000 turns sampled in angle. J4: orders 10, 10.1
    and 10.25 of a shaft at 10 Hz, 12,000 samples in 12 s.
    """
    full = {"J3 angle": 1_024_000, "J4 close": 12_000}.get(name, 1_000_000)
    at = np.arange(full if samples is None else min(samples, full))
    rate = {"J3 angle": SAMPLES_PER_REV, "J4 close": 1000.0}.get(name, RATE_HZ)
    t = at / rate
    run_up = 2 * np.pi * (10 * t + 0.75 * t**2)
    phase_rad: Floats | Mapping[str, Floats] = run_up
    orders: tuple[float, ...] | tuple[tuple[str, float], ...] = TEN_ORDERS
    if name == "J2 crossing":
        phase_rad = {"shaft": run_up, "steady": 2 * np.pi * 300 * t}
        orders = (("shaft", 20.0), ("shaft", 20.2), ("steady", 1.0))
    elif name == "J3 angle":
        phase_rad = 2 * np.pi / SAMPLES_PER_REV * at.astype(np.float64)
    elif name == "J4 close":
        phase_rad, orders = 2 * np.pi * 10 * t, (10.0, 10.1, 10.25)
    rng = np.random.default_rng(int(name[1]))
    envelopes = Envelopes.drawn(rng, orders=len(orders), samples=full)
    x = rng.standard_normal(at.size)
    for place in range(len(orders)):
        x += (envelopes.of(place, at) * np.exp(1j * _angle(phase_rad, orders[place]))).real
    return Job(
        name=name,
        x=x,
        phase_rad=phase_rad,
        orders=orders,
        rate=rate,
        per_revolution=name == "J3 angle",
        envelopes=envelopes,
    )


def _angle(phase_rad: Floats | Mapping[str, Floats], order: float | tuple[str, float]) -> Floats:
    if isinstance(order, tuple):
        assert isinstance(phase_rad, Mapping)  # noqa: S101  (the two come in pairs)
        return order[1] * phase_rad[order[0]]
    assert not isinstance(phase_rad, Mapping)  # noqa: S101
    return order * phase_rad
