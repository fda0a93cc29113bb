"""What is said of damaged and of sound gears: python benchmarks/gear_damage.py [--records N] [--data DATA].

Prints tables in Markdown. Measured records are those of HUMS_REAL_DATA or of --data; without one only synthetic records
are judged. A gear is named where its probability, over all gears of the record, is at most 0.01.
"""

import argparse
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import xarray as xr
from verdicts import DRIVES, HEALTHY, STAGES, measured, planetary_scene, table_of

from data_synth import Scene, load_scene, simulate
from hums import AnalysisSettings, Gearbox
from hums.analysis.gear_damage import GearJudgement, gear_damage
from hums.analysis.segments import segmented

STATED = 0.01
IMPERFECT: Mapping[str, Any] = {
    "imperfections": {
        "gears": {},
        "bearings": {},
        "knocks": {},
        "noise": {},
        "neighbour": {},
        "electrical": {"tachometer": {}},
    }
}
MODULES = {"dynamics": {"meshes": {"stage 1": {"module_mm": 3}, "stage 2": {"module_mm": 4}}}}


def judgements(record: xr.Dataset, gearbox: Gearbox) -> list[GearJudgement]:
    """Return the judgement of every gear in every channel, named ones first."""
    channels = segmented(record, gearbox, AnalysisSettings()).channels
    rows = [
        row
        for channel in channels.values()
        for segment in channel.segments
        for row in gear_damage(segment, false_alarm_probability=STATED, channels=len(channels))
    ]
    return sorted(rows, key=lambda row: (row.probability > STATED or bool(row.explained_by), row.local))


def named(rows: list[GearJudgement]) -> list[GearJudgement]:
    """Return the judgements that name a gear."""
    return [row for row in rows if row.probability <= STATED and not row.explained_by]


def faulty_row(what: str, table: Mapping[str, Any], component: str, seeds: range) -> dict[str, Any]:
    """Return how often the right gear, and the right component, comes first, and others are named."""
    scene = Scene.from_mapping(table)
    row = {"fault": what, "n": 0, "gear first": 0, "component first": 0, "other gear named": 0, "dB": 0.0, "p": 0.0}
    for seed in seeds:
        record = simulate(scene, seed=seed, detectability=seed == seeds[0])
        if seed == seeds[0]:
            row["dB"] = round(float(record["truth_fault_detectability_db"].max()), 1)
        found = named(judgements(record, scene.gearbox))
        row["n"] += 1
        if found:
            row["gear first"] += component in (found[0].component, *found[0].also)
            row["component first"] += component == found[0].component
            row["p"] = max(row["p"], found[0].probability)
        row["other gear named"] += any(component not in (one.component, *one.also) for one in found)
    return row


def planetary_rows(records: int, *, imperfect: bool) -> Iterator[dict[str, Any]]:
    """Yield a row for a crack of 2 mm in each gear of each stage."""
    for stage, teeth in STAGES.items():
        for component in ("sun-planet/sun", "planet-ring/planet", "planet-ring/ring"):
            fault = {"fault": [{"kind": "tooth_crack", "component": component, "depth_mm": 2.0}]}
            table = planetary_scene(teeth) | fault | (IMPERFECT if imperfect else {})
            what = f"{stage}, crack of 2 mm, {component}" + (", imperfections" if imperfect else "")
            yield faulty_row(what, table, component, range(1, records + 1))


SIZES = {"tooth_crack": (0.05, 0.2, 1.0), "chipping": (0.05, 0.2, 1.0), "spall": (0.05, 0.2), "missing_tooth": (5.0,)}


def fixed_rows(records: int, *, imperfect: bool) -> Iterator[dict[str, Any]]:
    """Yield a row for each fault, size and gear of two stages on fixed axes."""
    for component in ("stage 1/pinion", "stage 1/intermediate", "stage 2/intermediate", "stage 2/output"):
        for kind, sizes in SIZES.items():
            for size in sizes:
                fault = {
                    "kind": kind,
                    "component": component,
                    ("depth_mm" if kind == "tooth_crack" else "size_mm"): size,
                }
                table = HEALTHY | {"fault": [fault]} | (MODULES | IMPERFECT if imperfect else {})
                what = f"{kind} of {size:g} mm, {component}" + (", imperfections" if imperfect else "")
                yield faulty_row(what, table, component, range(1, records + 1))


def healthy_scenes(*, imperfect: bool) -> Iterator[tuple[str, Scene]]:
    """Yield the scenes of sound gears."""
    more = MODULES | IMPERFECT if imperfect else {}
    tail = ", imperfections" if imperfect else ""
    for what, change in DRIVES.items():
        yield what + tail, Scene.from_mapping(HEALTHY | change | more)
    for stage, teeth in STAGES.items():
        yield stage + tail, Scene.from_mapping(planetary_scene(teeth) | (IMPERFECT if imperfect else {}))
    yield ("`healthy-mill`", load_scene("healthy-mill")) if imperfect else ("`run-up`", load_scene("run-up"))


def healthy_rows(records: int, *, imperfect: bool) -> Iterator[dict[str, Any]]:
    """Yield how often a gear is named, for each drive of sound gears."""
    for what, scene in healthy_scenes(imperfect=imperfect):
        every = [judgements(simulate(scene, seed=seed), scene.gearbox) for seed in range(1, records + 1)]
        yield {
            "sound": what,
            "n": len(every),
            "named": sum(bool(named(rows)) for rows in every),
            "smallest p": f"{min(row.probability for rows in every for row in rows):.2g}",
            "gears not judged": sum(not row.judgeable for rows in every for row in rows),
        }


def turbine_rows(folder: Path) -> Iterator[dict[str, Any]]:
    """Yield what is said of the measured wind turbine, of which no gear is known to be damaged."""
    for case in measured(folder):
        if case.group == "wind turbine":
            rows = judgements(case.record, case.gearbox)
            best = rows[0]
            yield {
                "measured": case.name,
                "named": len(named(rows)),
                "smallest p": f"{best.probability:.2g}",
                "local": f"{best.local:.2g}",
                "repeats": f"{best.repeats:.2g}",
                "gear": best.component,
                "not judged": sum(not row.judgeable for row in rows),
            }


def main() -> None:
    """Measure, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=10, help="seeds of each scene")
    parser.add_argument("--data", type=Path, default=os.environ.get("HUMS_REAL_DATA"))
    parser.add_argument("--only", choices=("planetary", "fixed", "healthy", "turbine"))
    parser.add_argument("--perfect", action="store_true", help="leave out the scenes with imperfections")
    given = parser.parse_args()
    parts = {"planetary": planetary_rows, "fixed": fixed_rows, "healthy": healthy_rows}
    for part, rows in parts.items():
        if given.only in (None, part):
            for imperfect in (False,) if given.perfect else (False, True):
                sys.stdout.write(table_of(list(rows(given.records, imperfect=imperfect))) + "\n")
    if given.data is not None and given.only in (None, "turbine"):
        sys.stdout.write(table_of(list(turbine_rows(Path(given.data)))) + "\n")


if __name__ == "__main__":
    main()
