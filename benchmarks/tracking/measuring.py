"""Every setting on every job, at the bandwidth that suits it best there: time, error, memory."""

import contextlib
import dataclasses
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jobs import Job, JobName, standard_job
from scipy.optimize import minimize_scalar

from tracking.clock import SLOW_S, Effort, give_back, resident_mb, seconds, time_in_ffts
from tracking.settings import Run, Setting, Tracks

# What an estimator may answer instead of numbers; the report says so and goes on.
REFUSED = (ValueError, ArithmeticError, np.linalg.LinAlgError, ImportError)
BANDWIDTH_HZ = (0.4, 8.0)  # searched


@dataclass(frozen=True, kw_only=True)
class Row:
    """What one setting did on one job: time in multiples of an rfft, memory in MB (NaN where unknown)."""

    job: Job
    setting: Setting
    bandwidth: float
    time: float
    error: float
    memory: float

    def __str__(self) -> str:
        label = f"{self.job.name[:2]} {self.setting.label} ({self.setting.method})"
        return f"{label}: bandwidth {self.bandwidth:g}, time {self.time:.3g}, error {self.error:.4f}"


def best_bandwidth(job: Job, run: Run, effort: Effort) -> float:
    """Search the bandwidth with the least error, to three digits."""
    unit = 0.01 if job.per_revolution else 1.0  # a hundred turns of J3 are as much as a second of J1
    failed: list[Exception] = []

    def log_error(log_bandwidth: float) -> float:
        try:
            return float(np.log(job.error(*run(job, unit * float(np.exp(log_bandwidth))))))
        except REFUSED as error:
            failed.append(error)
            return 10.0

    with contextlib.suppress(*REFUSED):
        run(standard_job(job.name, samples=min(effort.excerpt, job.samples)), unit)  # compiles
    evaluations = effort.search if seconds(lambda: log_error(0.0)) < SLOW_S else effort.slow_search
    bounds = tuple(np.log(BANDWIDTH_HZ))
    found: Any = minimize_scalar(
        log_error, bounds=bounds, method="bounded", options={"xatol": 5e-3, "maxiter": evaluations}
    )
    if found.fun == 10.0:  # noqa: PLR2004  (nothing ran)
        raise failed[0]
    return float(f"{unit * np.exp(found.x):.3g}")


def measure(names: Iterable[JobName], settings: Sequence[Setting], effort: Effort) -> tuple[list[Row], list[str]]:
    """Run every setting on its jobs; return the rows and a sentence for each refusal."""
    rows: list[Row] = []
    refused: dict[str, list[str]] = {}
    for name in names:
        job = standard_job(name, samples=effort.samples)
        widths: dict[str, float] = {}
        for setting in (s for s in settings if name in s.on):
            try:
                if setting.family not in widths:
                    widths[setting.family] = best_bandwidth(job, setting.search, effort)
                rows.append(_measured(job, setting, widths[setting.family], effort, rows))
                print(rows[-1], file=sys.stderr)  # noqa: T201  (a quarter of an hour is long)
            except REFUSED as refusal:
                why = f"{setting.label} ({setting.method}): {type(refusal).__name__}: {refusal}"
                refused.setdefault(why, []).append(name[:2])
    return rows, [f"{', '.join(names)}: {why}" for why, names in refused.items()]


def _check_causal(record: Job, run: Run, bandwidth: float) -> None:
    """Refuse a filter whose outputs change with later samples: it would beat all others for the wrong reason."""
    half = record.samples // 2
    later = np.where(np.arange(record.samples) < half, record.x, 2 - 3 * record.x)
    (one, at), (other, _) = (run(dataclasses.replace(record, x=x), bandwidth) for x in (record.x, later))
    before = np.abs(one - other)[:, at < half]
    if not np.all(before <= 1e-9 * np.abs(one).max()):
        raise ArithmeticError(f"outputs change by up to {before.max():.2g} with samples that come after them")


def _measured(job: Job, setting: Setting, bandwidth: float, effort: Effort, rows: list[Row]) -> Row:
    excerpt = standard_job(job.name, samples=min(effort.excerpt, job.samples))
    short = setting.excerpt_of is not None
    record = excerpt if short else job
    setting.run(excerpt, bandwidth)  # compiles
    if setting.family.startswith("filter"):
        _check_causal(excerpt, setting.run, bandwidth)
    if setting.prepare is not None:
        setting.prepare(record)
    give_back()
    before, answers = resident_mb("VmRSS"), list[Tracks]()
    took = seconds(lambda: answers.append(setting.run(record, bandwidth)))
    memory = np.nan if short else resident_mb("VmHWM") - before
    error = record.error(*answers.pop())
    if short:
        alike = [row.error for row in rows if (row.job.name, row.setting.label) == (job.name, setting.excerpt_of)]
        error = alike[0] if alike else np.nan
    times = time_in_ffts(lambda: setting.run(record, bandwidth), job.x, effort, took=took)
    times *= job.samples / record.samples
    return Row(job=job, setting=setting, bandwidth=bandwidth, time=times, error=error, memory=memory)


def only(rows: Sequence[Row], job: str, **wanted: object) -> list[Row]:
    """Rows of a job (by the start of its name) whose settings have these values."""
    return [
        row
        for row in rows
        if row.job.name.startswith(job) and all(getattr(row.setting, name) == value for name, value in wanted.items())
    ]
