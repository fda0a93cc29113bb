"""Faults named by this version and an earlier one at the same false alarms: python benchmarks/earlier_verdicts.py TREE.

TREE is a working tree of the earlier version, of commit 0a9bf46 for the page (``git worktree add TREE 0a9bf46``). Both
analyse the same records of `benchmarks/verdicts.py`, healthy held-out machines and faulty ones. The earlier version
ranks its findings by their level above the surroundings; of bearings and of teeth those count that stand above what
its healthy records show, but for as many records as this version names. Prints a table.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import healthy_library
import numpy as np
import verdicts
import xarray as xr

from data_synth import Scene, simulate
from hums import AnalysisError, Gearbox, analyze, findings_table

WITHOUT = "Wolfrom set 20/79/178 - 75/169"  # whose records take ten times as long to simulate

# Run by the earlier version on a folder of records: its findings as JSON.
EARLIER = """
import json, sys, warnings
from pathlib import Path
import numpy as np
import hums
warnings.simplefilter("ignore")
for path in sorted(Path(sys.argv[1]).glob("*.npz")):
    data = np.load(path)
    pulses = hums.PulseTimes(times_s=data["pulses"], shaft=str(data["shaft"]), pulses_per_rev=int(data["per_rev"]))
    record = hums.make_record({"a": data["x"]}, rate_hz=float(data["rate_hz"]), units="g", angle=pulses)
    gearbox = hums.load_gearbox(path.with_suffix(".toml"))
    try:
        table = hums.findings_table(hums.analyze(record, gearbox, settings=hums.AnalysisSettings(most_tracks=0)))
    except ValueError:
        continue
    rows = table[["component", "kind", "verdict", "snr"]].to_numpy().tolist()
    path.with_suffix(".json").write_text(json.dumps(rows, default=float))
"""


def written(path: Path, record: xr.Dataset, gearbox: Gearbox) -> None:
    """Write what the earlier version reads: samples, pulses and the drawing."""
    np.savez(
        path,
        x=record["a"].to_numpy(),
        rate_hz=record.attrs["rate_hz"],
        pulses=record["tachometer"].to_numpy(),
        shaft=record["tachometer"].attrs["shaft"],
        per_rev=record["tachometer"].attrs["pulses_per_rev"],
    )
    path.with_suffix(".toml").write_text(gearbox.to_toml(), encoding="utf-8")


def case(number: int, *, faulty: bool, folder: Path) -> dict[str, Any] | None:
    """Return what this version says of a record, and write it for the earlier one; None where it is refused."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            if faulty:
                table, kind, component = verdicts.faulty_table(number)
                scene = Scene.from_mapping(table)
                record = simulate(scene, seed=number, detectability=True)
                gearbox, db = scene.gearbox, float(record["truth_fault_detectability_db"].max())
            else:
                record, gearbox, *_ = healthy_library.record(number, held_out=True)
                kind, component, db = "", "", 0.0
            found = findings_table(analyze(record, gearbox, settings=verdicts.SETTINGS))
        except (ValueError, AnalysisError):
            return None
    path = folder / f"{'faulty' if faulty else 'healthy'}-{number:04}.npz"
    written(path, record, gearbox)
    rows = [[row.component, row.kind, row.verdict, row.snr, row.evidence] for row in found.itertuples()]
    return {"path": path, "kind": kind, "component": component, "db": db, "now": rows}


def _tooth(row: list[Any]) -> bool:
    return bool(row[1] == "tooth")


def limit(healthy: list[dict[str, Any]], *, tooth: bool) -> float:
    """Return the level that findings of the earlier version exceed in as many healthy records as this one names."""
    now = sum(any(_tooth(row) == tooth for row in one["now"]) for one in healthy)
    highest = sorted(
        (max((row[3] for row in one["then"] if _tooth(row) == tooth), default=0.0) for one in healthy), reverse=True
    )
    return highest[now]


def right(one: Mapping[str, Any], rows: list[list[Any]]) -> bool:
    """Return whether the part with the fault is among some findings."""
    kind = verdicts.FAULTS[one["kind"]][0]
    return any(row[1] == kind and (row[0] == one["component"] or one["component"] in "".join(row[4:])) for row in rows)


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tree", type=Path, help="a working tree of the earlier version")
    parser.add_argument("--faulty", type=int, default=120)
    parser.add_argument("--healthy", type=int, default=100)
    given = parser.parse_args()
    boxes = healthy_library.gearboxes(True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = {
            of: [
                one
                for number in range(getattr(given, of))
                if boxes[number % len(boxes)].name != WITHOUT
                and (one := case(number, faulty=of == "faulty", folder=folder)) is not None
            ]
            for of in ("healthy", "faulty")
        }
        environment = os.environ | {"PYTHONPATH": str(given.tree.resolve())}
        subprocess.run([sys.executable, "-c", EARLIER, name], check=True, env=environment, cwd=name)  # noqa: S603
        for one in (*made["healthy"], *made["faulty"]):
            answer = one["path"].with_suffix(".json")
            one["then"] = json.loads(answer.read_text(encoding="utf-8")) if answer.exists() else []
    limits = {tooth: limit(made["healthy"], tooth=tooth) for tooth in (False, True)}
    rows = [
        {
            "healthy": f"{len(made['healthy'])} records",
            "named now": sum(bool(one["now"]) for one in made["healthy"]),
            "named then": sum(bool(one["then"]) for one in made["healthy"]),
            "above the limits then": sum(
                any(row[3] > limits[_tooth(row)] for row in one["then"]) for one in made["healthy"]
            ),
        }
    ]
    by_kind = []
    for kind in verdicts.FAULTS:
        own = [one for one in made["faulty"] if one["kind"] == kind and one["db"] >= verdicts.DETECTABLE_DB]
        by_kind.append(
            {
                "fault, at least 40 dB": kind,
                "n": len(own),
                "named now": sum(right(one, one["now"]) for one in own),
                "named then": sum(right(one, one["then"]) for one in own),
                "named then at the same false alarms": sum(
                    right(one, [row for row in one["then"] if row[3] > limits[_tooth(row)]]) for one in own
                ),
            }
        )
    print(verdicts.table_of(rows) + "\n\n" + verdicts.table_of(by_kind))  # noqa: T201


if __name__ == "__main__":
    main()
