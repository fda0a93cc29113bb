"""The causal one-pole filters against those of other packages, sample by sample."""

from collections.abc import Sequence
from functools import partial

from jobs import Job, JobName, standard_job

from tracking.clock import Effort, seconds_a_call
from tracking.measuring import Row, only
from tracking.tables import table
from tracking.targets import Target, difference

NEEDED = {"filterpy": 300, "statsmodels": 60}  # times as fast
JOBS: tuple[JobName, ...] = ("J1 run-up", "J3 angle")


def speedups(rows: Sequence[Row], effort: Effort) -> tuple[list[str], list[Target]]:
    """Compare seconds a call, on the same samples and with the same outputs."""
    lines, found = [], []
    for name in JOBS:
        excerpt = standard_job(name, samples=effort.excerpt)
        mine = only(rows, name, estimator="filter", poles=1, outputs="all")
        for theirs in (row for row in rows if row.job.name == name and row.setting.label in NEEDED):
            ratios = [_on_excerpt(excerpt, theirs, row, effort) for row in mine]
            for row, ratio in zip(mine, ratios, strict=True):
                apart = difference(excerpt, row.setting.run, theirs.setting.run, row.bandwidth)
                lines.append((name, theirs.setting.label, row.setting.method, f"{ratio:.3g}", f"{apart:.1e}"))
            if mine:
                found.append(_target(theirs, max(ratios), excerpt.samples))
    head = ("job", "peer", "our method", f"times as fast, both on {effort.excerpt:,} samples", "difference")
    return table(head, lines), found


def _on_excerpt(job: Job, theirs: Row, mine: Row, effort: Effort) -> float:
    """How many times as fast ours is on one and the same record."""
    slow, quick = (seconds_a_call(partial(row.setting.run, job, mine.bandwidth), effort) for row in (theirs, mine))
    return slow / quick


def _target(theirs: Row, ratio: float, samples: int) -> Target:
    """Judge times on one and the same excerpt: a whole job would take a peer too long."""
    peer, needed = theirs.setting.label, NEEDED[theirs.setting.label]
    return Target(
        what=f"{theirs.job.name[:2]} causal, 1 pole, against {peer}, both on {samples:,} samples",
        needed=f"{needed} times as fast",
        measured=f"{ratio:.3g} times as fast",
        passed=ratio >= needed,
    )
