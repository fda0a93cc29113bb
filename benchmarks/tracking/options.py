"""What the other settings of the trackers cost, beside the plain call."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from jobs import Job, standard_job

from signals.harmonics import Bandwidth, order_waveform, residual_record, track_orders, vold_kalman_filter
from tracking.clock import Effort, seconds, time_in_ffts
from tracking.settings import DECIMATED
from tracking.tables import table

SMOOTHER_HZ, FILTER_HZ = 1.17, 4.0  # bandwidths on J1
GAP, EVERY_GAP = 500, 50_000  # samples missing of so many
PHASE_STD_RAD = 1e-3


def options(effort: Effort) -> list[str]:
    """Time the smoother on blocks with two poles and the exact filter with one on J1, one setting more at a time."""
    job = standard_job("J1 run-up", samples=effort.samples)
    lines = []
    for what, call in [*_of_smoother(job), *_of_filter(job)]:
        call()  # compiles
        lines.append((what, f"{time_in_ffts(call, job.x, effort, took=seconds(call)):.3g}"))
    return table(("what", "time"), lines)


def _of_smoother(job: Job) -> list[tuple[str, Callable[[], object]]]:
    plain: dict[str, Any] = job.tracking(SMOOTHER_HZ) | {"poles": 2, "method": "fast", "output_every": DECIMATED}
    tracks = track_orders(**plain)
    gaps = np.where(np.arange(job.samples) % EVERY_GAP < GAP, np.nan, job.x)
    width = SMOOTHER_HZ * np.linspace(0.8, 1.2, job.samples)[None]
    weight = Bandwidth(width=SMOOTHER_HZ / job.rate, poles=2).weight
    named = {name: plain[name] for name in ("phase_rad", "orders", "rate_hz", "poles", "method", "output_every")}
    return [
        ("smoother", partial(track_orders, **plain)),
        ("with its `std`", lambda: track_orders(**plain).std),
        ("with the phase's own `std` in it", lambda: track_orders(**plain, phase_std_rad=PHASE_STD_RAD).std),
        ("bandwidth that varies in time", partial(track_orders, **(plain | {"bandwidth_hz": width}))),
        (f"{GAP:,} of {EVERY_GAP:,} samples missing", partial(track_orders, **(plain | {"x": gaps}))),
        ("noise variance given", partial(track_orders, **plain, noise_variance=1.0)),
        ("`vold_kalman_filter` of the same weight", partial(vold_kalman_filter, job.x, weight=weight, **named)),
        ("`order_waveform` of its tracks", partial(order_waveform, tracks, phase_rad=job.phase_rad)),
        ("`residual_record` of its tracks", partial(residual_record, job.x, tracks, phase_rad=job.phase_rad)),
    ]


def _of_filter(job: Job) -> list[tuple[str, Callable[[], object]]]:
    plain: dict[str, Any] = job.tracking(FILTER_HZ) | {"method": "exact", "output_every": DECIMATED}
    causal = partial(track_orders, estimator="filter", **plain)
    return [("filter", causal), ("with its innovations", partial(causal, innovations=True))]
