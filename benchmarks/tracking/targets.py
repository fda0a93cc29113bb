"""What is asked of the trackers, and what was reached."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jobs import Job

from tracking.measuring import Row, only
from tracking.settings import DECIMATED, Run


@dataclass(frozen=True, kw_only=True)
class Target:
    """What was to be reached, and what was."""

    what: str
    needed: str
    measured: str
    passed: bool


def difference(job: Job, one: Run, other: Run, bandwidth: float) -> float:
    """Root of the mean square difference of two answers over that of the second, second half of the outputs."""
    (mine, at), (theirs, _) = one(job, bandwidth), other(job, bandwidth)
    late = slice(at.size // 2, None)
    return float(np.linalg.norm(mine[:, late] - theirs[:, late]) / np.linalg.norm(theirs[:, late]))


def _within(value: float, bound: float, digits: int = 3) -> bool:
    """Whether a value is at most the bound as printed with so many digits."""
    return float(f"{value:.{digits}g}") <= bound


def targets(rows: Sequence[Row]) -> list[Target]:
    """Compare the rows with what is asked of the trackers."""
    found = []
    for job, error, most in (("J1", 0.0155, 4), ("J2", 0.0150, 4), ("J3", 0.0176, 3)):
        mine = only(rows, job, kind="smoother", outputs=f"every {DECIMATED}")
        good = [row for row in mine if _within(row.error, error)] or mine
        if good:
            best = min(good, key=lambda row: row.time)
            passed = _within(best.error, error) and _within(best.time, most)
            needed = f"error {error:g}, time {most}"
            found.append(_target(f"{job} smoother, outputs every {DECIMATED}", needed, best, passed=passed))
    found += _dense_smoother_targets(rows) + _causal_targets(rows)
    return found


def _target(what: str, needed: str, row: Row, *, passed: bool, more: str = "") -> Target:
    measured = f"error {row.error:.4f}, time {row.time:.3g} ({row.setting.method}, poles {row.setting.poles}){more}"
    return Target(what=what, needed=needed, measured=measured, passed=passed)


def _dense_smoother_targets(rows: Sequence[Row]) -> list[Target]:
    """Judge the quickest that gives J1 at every sample, beside the same at fewer outputs."""
    dense = only(rows, "J1", kind="smoother", outputs="all")
    if not dense:
        return []
    best = min(dense, key=lambda row: row.time)
    same = {"kind": "smoother", "outputs": f"every {DECIMATED}", "poles": best.setting.poles, "method": "fast"}
    apart = max((abs(best.error / sparse.error - 1) for sparse in only(rows, "J1", **same)), default=np.nan)
    passed = apart <= 1e-3 and _within(best.time, 8)  # noqa: PLR2004
    needed = f"error within 0.001 of that with outputs every {DECIMATED}, time 8"
    return [_target("J1 smoother, all outputs", needed, best, passed=passed, more=f", {apart:.1e} apart")]


def _causal_targets(rows: Sequence[Row]) -> list[Target]:
    found = []
    for name, most in (("J1", 12), ("J3", 3)):
        exact = only(rows, name, kind="filter", method="exact", poles=1)
        both = [*exact, *only(rows, name, kind="filter", method="fast", poles=1)]
        if not exact:
            continue
        best, reference = min(both, key=lambda row: row.time), exact[0]
        what = f"{name} causal, 1 pole, all outputs"
        if name == "J1":
            apart = difference(best.job, best.setting.run, reference.setting.run, best.bandwidth)
            passed = apart <= 1e-6 and _within(best.error, 0.0486) and _within(best.time, most)  # noqa: PLR2004
            needed = f"within 1e-6 of exact, error 0.0486, time {most}"
            found.append(_target(what, needed, best, passed=passed, more=f", {apart:.1e} from exact"))
        else:
            apart = abs(best.error / reference.error - 1)
            passed = apart <= 0.01 and _within(best.time, most)  # noqa: PLR2004
            needed = f"error within 1 % of that of exact, time {most}"
            found.append(_target(what, needed, best, passed=passed, more=f", {apart:.1e} apart"))
    single, double = (only(rows, "J1", kind="filter", poles=poles) for poles in (1, 2))
    if single and double:
        best, bound = min(double, key=lambda row: row.error), min(row.error for row in single)
        needed = f"error below that with 1 pole, {bound:.4f}"
        found.append(_target("J1 causal, 2 poles, all outputs", needed, best, passed=best.error < bound))
    return found
