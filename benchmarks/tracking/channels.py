"""What several channels of one record cost beside one."""

from functools import partial
from typing import Any

import numpy as np
from jobs import JobName, standard_job
from page_files import table

from signals.harmonics import track_orders
from tracking.clock import Effort, time_in_ffts
from tracking.settings import DECIMATED


def channels(effort: Effort) -> list[str]:
    """Time a record of one channel and one of several; they share phases, not noise."""
    smoother: dict[str, Any] = {"method": "fast"}
    causal: dict[str, Any] = {"estimator": "filter", "poles": 1}
    cases: list[tuple[str, JobName, float, dict[str, Any]]] = [
        ("smoother, fast, 1 pole", "J1 run-up", 1.7, smoother | {"poles": 1}),
        ("smoother, fast, 2 poles", "J1 run-up", 1.17, smoother | {"poles": 2}),
        ("filter, exact, 1 pole", "J1 run-up", 4.0, causal | {"method": "exact"}),
        ("filter, fast, 1 pole", "J3 angle", 0.033, causal | {"method": "fast"}),
    ]
    lines = []
    for what, name, bandwidth, settings in cases:
        job = standard_job(name, samples=effort.samples)
        noise = np.random.default_rng(0).standard_normal((effort.channels, job.samples))
        given = job.tracking(bandwidth) | settings | {"output_every": DECIMATED}
        one, several = (
            time_in_ffts(partial(track_orders, **(given | {"x": x})), job.x, effort) for x in (job.x, job.x + noise)
        )
        share = several / (effort.channels * one)
        lines.append(
            (f"{name[:2]} {what}", f"{one:.3g}", f"{several:.3g}", f"{several / one:.2f}", f"{100 * share:.0f} %")
        )
    head = ("what", "1 channel", f"{effort.channels} channels", "ratio", f"of {effort.channels} calls with one")
    return table(head, lines)
