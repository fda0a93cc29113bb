"""How often the truth lies within what `std` says, with the bandwidth by maximum likelihood."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jobs import Floats, Job, JobName, standard_job

from signals.harmonics import likely_bandwidth, track_orders
from tracking.clock import Effort, time_in_ffts
from tracking.settings import DECIMATED, EVERYWHERE
from tracking.tables import table
from tracking.targets import Target

WITHIN = 1.96  # standard deviations: 95 % of a normal distribution
NEEDED = 0.93
LARGEST = {1: 8.0, 2: 3.0, 3: 3.0, 4: 3.0}  # Hz, or hundredths of an order, that a bandwidth may have
ASKED = "J1 run-up", "J2 crossing"


def coverage(effort: Effort) -> tuple[list[str], list[Target]]:
    """Track all jobs with the likeliest bandwidths and the noise estimated; compare errors with `std`."""
    lines, found = [], []
    for name in EVERYWHERE:
        job = standard_job(name, samples=effort.samples)
        for number in effort.poles:
            answers: list[Floats] = []
            search = partial(_search, job, number, answers)
            time = time_in_ffts(search, job.x, replace(effort, repeats=1, slow_repeats=1))
            widths = answers[0]
            tracks = track_orders(**job.tracking(widths), poles=number, method="fast", output_every=DECIMATED)
            wrong = (tracks.complex_amplitude - job.amplitude(tracks.sample_index)) / tracks.std
            share = float(np.mean(np.abs(np.concatenate([wrong.real, wrong.imag])) < WITHIN))
            error = job.error(tracks.complex_amplitude, tracks.sample_index)
            span = f"{widths.min():.3g} to {widths.max():.3g}"
            lines.append((name, str(number), span, f"{100 * share:.1f} %", f"{error:.4f}", f"{time:.3g}"))
            if name in ASKED and number == 2:  # noqa: PLR2004
                found.append(_target(name, number, share))
    head = ("job", "poles", "likeliest bandwidths", f"within {WITHIN} std", "error", "time of the search")
    return table(head, lines), found


def _search(job: Job, poles: int, answers: list[Floats]) -> None:
    unit, names = (0.01, "orders") if job.per_revolution else (1.0, "hz")
    given: dict[str, Any] = job.tracking(0.0)
    rate = {name: given[name] for name in ("samples_per_rev", "rate_hz") if name in given}
    largest: dict[str, Any] = {f"largest_bandwidth_{names}": unit * LARGEST[poles]}
    answers.append(likely_bandwidth(job.x, phase_rad=job.phase_rad, orders=job.orders, poles=poles, **rate, **largest))


def _target(name: JobName, poles: int, share: float) -> Target:
    return Target(
        what=f"{name[:2]} smoother, {poles} poles, bandwidth by maximum likelihood: quadratures within {WITHIN} std",
        needed=f"{100 * NEEDED:.0f} %",
        measured=f"{100 * share:.1f} %",
        passed=share >= NEEDED,
    )
