"""Machines that are watched record by record, healthy at first; in some a fault grows."""

import tempfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from board.sections import Effort, Section, Task
from board.table import Figure, Row, averaged, count_row
from data_synth import load_scene, simulate
from hums import AnalysisSettings, MonitorSettings, analyze, watch
from hums.fleet.series import component_parts

BASELINE, HEALTHY, GROWING = 10, 5, 9  # records: learned from, judged before the fault begins, and with it
SIZES_MM = np.geomspace(0.1, 3.0, GROWING)
FAULTS: Mapping[str, dict[str, str]] = {
    "inner race": {"kind": "inner_race", "component": "intermediate bearing", "size": "size_mm"},
    "outer race": {"kind": "outer_race", "component": "input bearing", "size": "size_mm"},
    "crack": {"kind": "tooth_crack", "component": "stage 1/pinion", "size": "depth_mm"},
}
DAY = datetime(2026, 1, 1, tzinfo=UTC)


def watched(fault: str, seed: int) -> tuple[int, float, list[bool]]:
    """Return false alarms, the size of the fault when its part alarms first, and of the alarms since whether they do.

    The size is infinite where there is none. Speed and load change from record to record; an alarm counts for a fault
    where it names the damaged part, or for a tooth its gear or mesh.
    """
    rng = np.random.default_rng([92, seed])
    base = load_scene("demo").changed(
        rate_hz=20_000,
        duration_s=2.0,
        faults=(),
        resonance={"frequency_hz": 5000, "damping_ratio": 0.03},
        sensors=({"name": "a", "on": "input bearing", "units": "g"},),
    )
    own = FAULTS.get(fault)
    false, size, named = 0, np.inf, list[bool]()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(BASELINE + HEALTHY + GROWING):
            grown = number - BASELINE - HEALTHY
            changed: dict[str, Any] = {
                "speed": {"link": "input", "rpm": float(1400 * (1 + 0.02 * rng.standard_normal()))},
                "torque": {"link": "output", "nm": float(450 * (1 + 0.05 * rng.standard_normal()))},
            }
            if own is not None and grown >= 0:
                part = {"kind": own["kind"], "component": own["component"], own["size"]: float(SIZES_MM[grown])}
                changed["faults"] = (part,)
            record = simulate(base.changed(**changed), seed=1000 * (1 + seed) + number)
            analysis = analyze(record, base.gearbox, settings=AnalysisSettings(most_tracks=0, pictures=False))
            when = (DAY + timedelta(days=number)).isoformat()
            analysis.attrs |= {"machine": fault, "record": str(number), "recorded_at": when}
            settings = MonitorSettings(baseline_records=BASELINE)
            for alarm in watch(analysis, Path(folder) / "a.state", settings=settings).alarms:
                parts = component_parts(alarm["component"])
                right = own is not None and grown >= 0 and any(one.startswith(own["component"][:7]) for one in parts)
                size = min(size, float(SIZES_MM[grown])) if right else size
                named += [right] if own is not None and grown >= 0 else []
                false += grown < 0 or own is None
    return false, size, named


def tasks(effort: Effort) -> list[Task]:
    """Return a task for each machine."""
    return [partial(watched, name, seed) for name in (*FAULTS, "healthy") for seed in effort.numbers(1, 4, 75)]


def figures(found: Sequence[tuple[int, float, list[bool]]]) -> dict[str, Figure]:
    """Return faults found, their size then, where their alarms are, and machines with false alarms."""
    faulty = found[: len(found) * len(FAULTS) // (len(FAULTS) + 1)]
    onset = [size for _, size, _ in faulty if np.isfinite(size)]
    return {
        "fleet: found": Figure.share([bool(np.isfinite(size)) for _, size, _ in faulty]),
        "fleet: size": Figure.mean(
            [min(size, 2 * float(SIZES_MM[-1])) for _, size, _ in faulty] if onset else [np.inf]
        ),
        "fleet: located": Figure.share([named[0] for _, _, named in faulty if named]),
        "fleet: alarms": Figure.mean([len(named) for _, _, named in faulty if named]),
        "fleet: false alarms": Figure.share([alarms > 0 for alarms, *_ in found]),
    }


SECTION = Section(
    name="fleets",
    rows=(
        count_row("fleet: found", "machines whose growing fault raises an alarm for its part", "more"),
        Row(name="fleet: size", what="size of the fault at the first such alarm, mm", limit=averaged("less")),
        Row(
            name="fleet: located",
            what="growing faults whose first alarm names the part",
            limit=lambda now, _: 0.8 * (now.of or 0),
            better="more",
        ),
        Row(name="fleet: alarms", what="alarms per machine with one growing fault", limit=averaged("less")),
        count_row("fleet: false alarms", "machines with a false alarm in 5 or 14 records", "less"),
    ),
    tasks=tasks,
    figures=figures,
)
