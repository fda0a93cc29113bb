"""How time grows with samples and with orders."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jobs import RATE_HZ, SAMPLES_PER_REV, TEN_ORDERS, Floats
from page_files import table

from signals.harmonics import track_orders
from tracking.clock import Effort, seconds, time_in_ffts
from tracking.measuring import REFUSED
from tracking.settings import DECIMATED

UNIT = 1_000_000  # samples of the rfft
REPEATS = 5
FITTED = 3  # largest sizes, by whose times an exponent is judged
LONGEST_S = 30.0  # of one call; larger sizes are not tried
SAMPLE_BY_SAMPLE = 5_000  # samples in a record where orders grow, for the exact estimators


@dataclass(frozen=True, kw_only=True)
class Growth:
    """What grows, and how far.

    Attributes
    ----------
    what : of it, as the table says it.
    sizes : to be timed.
    make : from a size to the call.
    """

    what: str
    sizes: Sequence[int]
    make: Callable[[int], Callable[[], object]]


def scaling(bandwidths: tuple[float, float], effort: Effort) -> tuple[list[str], dict[str, float]]:
    """Time against samples and against orders, and the exponents that fit the largest sizes.

    `bandwidths` in Hz are those of smoother and filter on J1.
    """
    lines: list[tuple[str, ...]] = []
    exponents = {}
    for growth in _growths(bandwidths, effort):
        times = _timed(growth, effort)
        sizes, logs = list(times), np.log(np.array(list(times.items())).reshape(-1, 2))
        steps = ["", *(f"{rise / run:.2f}" for run, rise in np.diff(logs, axis=0))]
        lines += [
            (growth.what, f"{size:,}", f"{times[size]:.3g}", step) for size, step in zip(sizes, steps, strict=False)
        ]
        if len(logs) > 1:
            exponents[growth.what] = float(np.polyfit(*logs[-FITTED:].T, 1)[0])
    return table(("what grows", "how many", "time", "exponent since the size before"), lines), exponents


def _growths(bandwidths: tuple[float, float], effort: Effort) -> list[Growth]:
    smooth: dict[str, Any] = {"method": "fast", "poles": 2, "output_every": DECIMATED}
    exact: dict[str, Any] = {"method": "exact", "poles": 1, "output_every": DECIMATED}
    late, causal = (partial(_run_up, bandwidth_hz=bandwidth) for bandwidth in bandwidths)
    return [
        Growth(
            what=f"J1 extended, smoother, fast, 2 poles, every {DECIMATED}: samples",
            sizes=effort.lengths,
            make=partial(late, **smooth),
        ),
        Growth(
            what="J1 extended, filter, exact, 1 pole, all outputs: samples",
            # The smallest keep much of what they fill in the cache; amplitudes of the largest would fill gigabytes.
            sizes=effort.lengths[1:-1] or effort.lengths,
            make=partial(causal, method="exact", poles=1, estimator="filter"),
        ),
        Growth(
            what="smoother, fast, 2 poles: orders 1, 2, 3, ..., 0.05 wide, separable",
            sizes=effort.separable,
            make=partial(_orders, effort.grown, 1.0, 1.0, 0.05, **smooth),
        ),
        Growth(
            what="smoother, fast, 2 poles: orders 20, 20.011, ..., 0.011 wide as on J3, coupled",
            sizes=effort.coupled,
            make=partial(_orders, effort.grown, 20.0, 0.011, 0.011, **smooth),
        ),
        Growth(
            what="smoother, fast, 2 poles: orders 20, 20.05, ..., 0.05 wide, coupled",
            sizes=effort.coupled,
            make=partial(_orders, effort.grown, 20.0, 0.05, 0.05, **smooth),
        ),
        Growth(
            what=f"filter, exact, 1 pole, every {DECIMATED}: the same orders",
            sizes=effort.coupled,
            make=partial(_orders, SAMPLE_BY_SAMPLE, 20.0, 0.05, 0.05, **exact, estimator="filter"),
        ),
        Growth(
            what=f"smoother, exact, 1 pole, every {DECIMATED}: the same orders",
            sizes=effort.coupled,
            make=partial(_orders, SAMPLE_BY_SAMPLE, 20.0, 0.05, 0.05, **exact),
        ),
    ]


def _timed(growth: Growth, effort: Effort) -> dict[int, float]:
    """Time a call at each size, in rffts of a million samples, as far as one call may last."""
    times: dict[int, float] = {}
    took, record, less = 0.0, np.ones(UNIT), replace(effort, repeats=min(REPEATS, effort.repeats))
    for size in growth.sizes:
        if times and took * (size / max(times)) ** 3 > LONGEST_S:
            break
        call = growth.make(size)
        try:
            took = seconds(call)
        except REFUSED:
            break
        if not times:
            took = seconds(call)  # without what it takes to compile
        times[size] = time_in_ffts(call, record, less, took=took)
    return times


def _noise(samples: int) -> Floats:
    """Plain noise: what a record holds hardly changes how long it takes."""
    return np.random.default_rng(0).standard_normal(samples)


def _run_up(samples: int, *, bandwidth_hz: float, **settings: Any) -> Callable[[], object]:  # noqa: ANN401
    """Track the ten orders of J1, whose shaft goes on to gain speed for as long as the record lasts."""
    t = np.arange(samples) / RATE_HZ
    phase_rad = 2 * np.pi * (10 * t + 0.75 * t**2)
    given: dict[str, Any] = {"orders": TEN_ORDERS, "bandwidth_hz": bandwidth_hz, "rate_hz": RATE_HZ}
    return partial(track_orders, _noise(samples), phase_rad=phase_rad, **given, **settings)


def _orders(
    samples: int,
    first: float,
    apart: float,
    bandwidth: float,
    count: int,
    **settings: Any,  # noqa: ANN401
) -> Callable[[], object]:
    """Track so many orders in a record sampled in angle."""
    phase_rad = 2 * np.pi / SAMPLES_PER_REV * np.arange(samples)
    orders = first + apart * np.arange(count)
    given: dict[str, Any] = {"orders": orders, "bandwidth_orders": bandwidth, "samples_per_rev": SAMPLES_PER_REV}
    return partial(track_orders, _noise(samples), phase_rad=phase_rad, **given, **settings)
