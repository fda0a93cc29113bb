"""What is asked of the trackers, and what was reached."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import peers
from jobs import Job

from tracking.measuring import Row, only
from tracking.settings import DECIMATED, Run

SETTLED = 3_000  # samples after which two filters whose priors differ in rounding agree


@dataclass(frozen=True, kw_only=True)
class Target:
    """What was to be reached, and what was."""

    what: str
    needed: str
    measured: str
    passed: bool


def difference(job: Job, one: Run, other: Run, bandwidth: float, *, after: int = 0) -> float:
    """Root of the mean square difference of two answers over that of the second, from some sample on."""
    (mine, at), (theirs, _) = one(job, bandwidth), other(job, bandwidth)
    late = at >= after
    return float(np.linalg.norm(mine[:, late] - theirs[:, late]) / np.linalg.norm(theirs[:, late]))


def targets(rows: Sequence[Row]) -> list[Target]:
    """Compare the rows with what is asked of the trackers; of the smoothers, those with two poles."""
    found = []
    for job, error, most in (("J1", 0.0155, 4), ("J2", 0.0150, 4), ("J3", 0.0176, 3)):
        mine = only(rows, job, estimator="smoother", poles=2, outputs=f"every {DECIMATED}")
        good = [row for row in mine if row.error <= error] or mine
        if good:
            best = min(good, key=lambda row: row.time)
            passed = best.error <= error and best.time <= most
            needed = f"error {error:g}, time {most}"
            found.append(_target(f"{job} smoother, 2 poles, outputs every {DECIMATED}", needed, best, passed=passed))
    found += _dense_smoother_targets(rows) + _exact_filter_targets(rows)
    return found + _settled_filter_targets(rows) + _two_pole_targets(rows)


def _target(what: str, needed: str, row: Row, *, passed: bool, more: str = "") -> Target:
    measured = f"error {row.error:.5f}, time {row.time:.3g} ({row.setting.method}){more}"
    return Target(what=what, needed=needed, measured=measured, passed=passed)


def _dense_smoother_targets(rows: Sequence[Row]) -> list[Target]:
    """Judge the smoother that gives J1 at every sample, beside the same at fewer outputs."""
    same = {"estimator": "smoother", "method": "fast", "poles": 2}
    dense, sparse = (only(rows, "J1", outputs=outputs, **same) for outputs in ("all", f"every {DECIMATED}"))
    if not dense or not sparse:
        return []
    apart = abs(dense[0].error / sparse[0].error - 1)
    passed = apart <= 1e-3 and dense[0].time <= 8  # noqa: PLR2004
    needed = f"error within 0.001 of that with outputs every {DECIMATED}, time 8"
    what = "J1 smoother, 2 poles, all outputs"
    return [_target(what, needed, dense[0], passed=passed, more=f", {apart:.1e} apart")]


def _exact_filter_targets(rows: Sequence[Row]) -> list[Target]:
    """Judge the exact one-pole filter on J1, beside the covariance filter that shares no code with ours."""
    mine = only(rows, "J1", estimator="filter", method="exact", poles=1)
    if not mine:
        return []
    best = min(mine, key=lambda row: row.time)
    apart = difference(best.job, best.setting.run, peers.compiled_filter, best.bandwidth, after=SETTLED)
    passed = apart <= 1e-6 and best.error <= 0.0486 and best.time <= 35  # noqa: PLR2004
    return [
        _target(
            "J1 causal, 1 pole, all outputs",
            f"within 1e-6 of a textbook covariance filter (numba) after sample {SETTLED:,}, error 0.0486, time 35",
            best,
            passed=passed,
            more=f", {apart:.1e} from it",
        )
    ]


def _settled_filter_targets(rows: Sequence[Row]) -> list[Target]:
    """Judge the quickest one-pole filter on J3, beside the exact one."""
    exact, settled = (only(rows, "J3", estimator="filter", method=method, poles=1) for method in ("exact", "fast"))
    if not exact:
        return []
    best = min([*exact, *settled], key=lambda row: row.time)
    apart = abs(best.error / exact[0].error - 1)
    passed = apart <= 0.01 and best.time <= 8  # noqa: PLR2004
    needed = "error within 1 % of that of exact, time 8"
    return [_target("J3 causal, 1 pole, all outputs", needed, best, passed=passed, more=f", {apart:.1e} apart")]


def _two_pole_targets(rows: Sequence[Row]) -> list[Target]:
    """Judge the error of two poles by that of one."""
    single, double = (only(rows, "J1", estimator="filter", poles=poles) for poles in (1, 2))
    if not single or not double:
        return []
    best, bound = min(double, key=lambda row: row.error), min(row.error for row in single)
    needed = f"error below that with 1 pole, {bound:.5f}"
    return [_target("J1 causal, 2 poles, all outputs", needed, best, passed=best.error < bound)]
