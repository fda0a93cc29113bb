"""Speeds: declared ones that are off, and those of records without a tachometer."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from tracking.coverage import WITHIN

from board import speed_records
from board.sections import Effort, Section, Task
from board.table import Figure, Row, averaged, count_row
from signals import refine_declared_speed

OFF = (-0.018, -0.01, -0.005, 0.005, 0.01, 0.018)  # of the true speed, all within the tolerance
TOLERANCE = 0.02
LAWS = {"constant": ("constant", 0.001), "wandering": ("constant with turbulence", 0.002)}  # and how near is right


def refined(gearbox: str, law: str, number: int, *, quick: bool = False) -> list[tuple[bool, bool]]:
    """Return, for each declaration of one record, whether it was refined to the true speed, and whether to another."""
    drive, near = LAWS[law]
    record = speed_records.made(gearbox, drive, number)
    true, found = float(record.speed_hz.mean()), []
    for off in OFF[::2] if quick else OFF:
        shown = refine_declared_speed(
            record.samples,
            rate_hz=speed_records.RATE_HZ,
            speed_hz=true * (1 + off),
            orders=record.orders,
            tolerance=TOLERANCE,
        )
        right = abs(shown.speed_hz / true - 1) < near
        found.append((shown.refined and right, shown.refined and not right))
    return found


def declared_tasks(effort: Effort) -> list[Task]:
    """Return a task for each record: three of each gearbox make 72 declarations."""
    run = partial(refined, quick=effort.size == "quick")
    numbers = effort.numbers(1, 3, 50)
    return [partial(run, box, law, 50_000 + n) for law in LAWS for box in speed_records.GEARBOXES for n in numbers]


def declared_figures(found: Sequence[list[tuple[bool, bool]]]) -> dict[str, Figure]:
    """Return how many are refined rightly and wrongly."""
    half, figures = len(found) // 2, {}
    for law, part in zip(LAWS, (found[:half], found[half:]), strict=True):
        every = [one for record in part for one in record]
        figures[f"declared speed, {law}: right"] = Figure.share([right for right, _ in every])
        figures[f"declared speed, {law}: wrong"] = Figure.share([wrong for _, wrong in every])
    return figures


DECLARED = Section(
    name="declared speeds",
    rows=tuple(
        count_row(f"declared speed, {law}: {key}", f"{what} 0.5 to 1.8 % off, {words}", better)
        for law, what in (("constant", "speeds"), ("wandering", "speeds that wander by 0.2 %,"))
        for key, words, better in (
            ("right", "refined to the mean within 0.1 %, or 0.2 % if it varies", "more"),
            ("wrong", "refined to a wrong one", "less"),
        )
    ),
    tasks=declared_tasks,
    figures=declared_figures,
)


def estimated(drive: str, number: int) -> dict[str, float]:
    """Return what is said of the speed of one record without a tachometer, and how it is off where it is known."""
    record = speed_records.made(speed_records.GEARBOXES[number % len(speed_records.GEARBOXES)], drive, number)
    found, ok = speed_records.estimate(record), False
    seen = {"clear": float(speed_records.clear_lines(record) >= 2), "ok": 0.0, "wrong": 0.0}  # noqa: PLR2004
    if found.status == "ok":
        ok = not speed_records.is_wrong(found, record)
        seen |= {"ok": 1.0, "wrong": float(not ok)}
    if ok:
        true = np.interp(found.times_s, np.arange(record.speed_hz.size) / speed_records.RATE_HZ, record.speed_hz)
        given = np.isfinite(found.speed_hz)
        off = np.abs(found.speed_hz - true)[given]
        seen["within"] = float(np.mean(off < WITHIN * found.std_hz[given]))
        seen["error"] = float(100 * np.median(off / true[given]))
    return seen


def estimated_figures(found: Sequence[dict[str, float]]) -> dict[str, Figure]:
    """Return the counts, and errors of those that are right."""
    return {
        "no tachometer: found": Figure.share([bool(one["ok"]) for one in found if one["clear"]]),
        "no tachometer: wrong": Figure.share([bool(one["wrong"]) for one in found]),
        "no tachometer: error": Figure.mean([one["error"] for one in found if "error" in one]),
        "no tachometer: within": Figure.mean([one["within"] for one in found if "within" in one]),
    }


ESTIMATED = Section(
    name="speeds without tachometer",
    rows=(
        count_row("no tachometer: found", "records with two clear lines whose speed is stated", "more"),
        count_row("no tachometer: wrong", "records whose stated speed is wrong", "less"),
        Row(name="no tachometer: error", what="median error of stated speeds, %", limit=averaged("less")),
        Row(
            name="no tachometer: within",
            what="share of stated speeds within their nominal 90 % intervals",
            better="more",
            limit=averaged("more"),
        ),
    ),
    tasks=lambda effort: [
        partial(estimated, drive, 90_000 + n) for drive in speed_records.VARYING for n in effort.numbers(4, 25, 250)
    ],
    figures=estimated_figures,
)
SECTIONS = (DECLARED, ESTIMATED)
