"""What verdicts say of healthy and faulty machines: python benchmarks/verdicts.py [--only PART] [FOLDER].

Writes verdicts.md into FOLDER (default docs/benchmarks). Measured records are those of the folder named in
HUMS_REAL_DATA or by --data; without one only the synthetic part is made.
"""

import argparse
import json
import os
import warnings
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import healthy_library
import numpy as np
import pandas as pd
import xarray as xr
from scipy import io

from data_synth import Scene, simulate
from hums import (
    AnalysisError,
    AnalysisSettings,
    Gearbox,
    NominalSpeed,
    PulseTimes,
    analyze,
    defect_orders,
    findings_table,
    load_gearbox,
    make_record,
    solve_kinematics,
    verdict_table,
)

ROOT = Path(__file__).resolve().parents[1]
RIGS = ROOT / "tests" / "data"
SETTINGS = AnalysisSettings(most_tracks=0)
RACES = {"I": "inner_race", "O": "outer_race", "B": "rolling_element", "n": "", "N": ""}
STATED = 0.01  # false-alarm probability of the settings

NOTE = """\
Made by `python benchmarks/verdicts.py --held-out {held_out} --faulty {faulty}`; automatic envelope band, a false-alarm
probability of {stated}, nothing tracked. A record is *named* if it has a finding, *diagnosed* if a finding is
diagnosed. The gearboxes and drives of the held-out machines are not in the library from which verdicts learn
(`benchmarks/healthy_library.py`). Faults count as *detectable* from {detectable:.0f} dB, whatever their kind; records
not judged are *too short* if they have fewer revolutions or cycles than a verdict requires. The measured records are
cut from their start; all of them had been inspected while the rules were developed, including those of CWRU's load 2
and HIT's 900 rpm, so none is unseen."""

# what is said of a record that holds too few meetings of a fault
TOO_FEW = "cycles of its line|revolutions are too few|revolutions only severe damage shows"
LEVELS_DB = (30.0, 40.0, 50.0, 60.0)
DETECTABLE_DB = 40.0  # matched-filter ratio of fault to noise above which a fault counts as detectable, for all kinds
# Kind of fault -> kind of the finding, and the range of sizes that is drawn, in mm. What changes a whole gear or shaft
# alike (wear, eccentricity, misalignment, imbalance) is judged by limits or a baseline alone, which no record here has.
FAULTS: Mapping[str, tuple[str, tuple[float, float]]] = {
    "inner_race": ("inner_race", (0.3, 4.0)),
    "outer_race": ("outer_race", (0.3, 4.0)),
    "rolling_element": ("rolling_element", (0.3, 4.0)),
    "cage": ("cage", (0.3, 4.0)),
    "tooth_crack": ("tooth", (0.5, 4.0)),
    "chipping": ("tooth", (0.5, 10.0)),
    "missing_tooth": ("tooth", (0.5, 4.0)),
    "spall": ("tooth", (0.5, 4.0)),
    "pitting": ("tooth", (0.05, 0.5)),
}

# A drive of a gearbox without faults, whose load or speed changes strongly.
HEALTHY: dict[str, Any] = {
    "gearbox": "two-stage",
    "rate_hz": 50000,
    "duration_s": 10,
    "fidelity": "kinematic",
    "speed": {"link": "input", "rpm": [[0, 1450], [10, 1500]]},
    "torque": {"link": "output", "nm": [[0, 300]]},
    "tachometer": {"link": "input", "pulses_per_rev": 1},
    "noise": {"rms": 0.05},
    "path": {"frequency_hz": 2600, "damping_ratio": 0.05},
    "excitation": {"meshes": {"stage 1": 0.6, "stage 2": 0.3}, "harmonics": 4},
    "sensor": [{"name": "a", "on": "input bearing", "units": "g"}],
}
STEPPED_SPEED = [[0, 1200], [3, 1200], [3.5, 1500], [6, 1500], [6.5, 1000], [10, 1000]]
DRIVES: Mapping[str, dict[str, Any]] = {
    "speed 450 to 1,800 rpm": {
        "speed": {"link": "input", "rpm": [[0, 450], [10, 1800]]},
        "excitation": HEALTHY["excitation"] | {"speed_exponent": 2},
    },
    "load in ramps, 90 to 500 N m": {
        "torque": {"link": "output", "nm": [[0, 90], [2, 500], [4, 120], [7, 480], [10, 90]]}
    },
    "speed and load in steps": {
        "speed": {"link": "input", "rpm": STEPPED_SPEED},
        "torque": {"link": "output", "steps": [[0, 100], [3, 500], [6, 100]], "rise_s": 0.3},
    },
    "load 100 to 500 N m under noise of 0.6 g": {
        "torque": {"link": "output", "nm": [[0, 100], [10, 500]]},
        "noise": {"rms": 0.6},
    },
    "3 s with one load step": {
        "duration_s": 3,
        "speed": {"link": "input", "rpm": [[0, 1450], [3, 1500]]},
        "torque": {"link": "output", "steps": [[0, 100], [1.5, 500]], "rise_s": 0.2},
    },
    "torque steps under a rising speed": {
        "speed": {"link": "input", "rpm": [[0, 1200], [10, 1500]]},
        "torque": {"link": "output", "steps": [[0, 100], [3, 500], [6, 100]], "rise_s": 0.5},
    },
}


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A measured record: group, name, gearbox, and the kind of the damaged part; empty where none is known."""

    group: str
    name: str
    record: xr.Dataset
    gearbox: Gearbox
    kind: str


def measured(folder: Path, *, seconds: float | None = None) -> Iterator[Measured]:
    """Yield the measured records of a folder, cut to some seconds where asked."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # data sheets whose multiples are rounded
        rigs = {name: load_gearbox(RIGS / f"{name}.toml") for name in ("cwru-rig", "mfpt-rig", "wind-turbine")}

    def made(
        group: str, name: str, x: np.ndarray, rate_hz: float, angle: NominalSpeed | PulseTimes, rig: str, kind: str
    ) -> Measured:
        values = np.asarray(x, dtype=np.float64)[: None if seconds is None else int(seconds * rate_hz)]
        record = make_record({"case": values}, rate_hz=rate_hz, units="g", angle=angle)
        return Measured(group=group, name=name, record=record, gearbox=rigs[rig], kind=kind)

    def steady(rpm: float, rig: str) -> NominalSpeed:
        return NominalSpeed(rpm=rpm, shaft=str(rigs[rig].reference))

    for path in sorted((folder / "cwru").glob("*.mat")):
        data, name = io.loadmat(path), path.stem
        x = next(value for key, value in data.items() if key.endswith("DE_time")).ravel()
        told = [float(value.ravel()[0]) for key, value in data.items() if key.endswith("RPM")]
        rpm = told[0] if told else {"0": 1797.0, "2": 1750.0}[name[-1]]
        hard = name.startswith(("B", "OR014"))
        group = "healthy" if name[0] == "n" else "CWRU, hard" if hard else "CWRU, one race"
        yield made(
            group, name, x, 48000 if name[0] == "n" else 12000, steady(rpm, "cwru-rig"), "cwru-rig", RACES[name[0]]
        )
    for path in sorted((folder / "hit_self_built").glob("*.mat")):
        data, name = io.loadmat(path), path.stem
        x = next(value for key, value in data.items() if not key.startswith("__")).ravel()
        group = "healthy" if name[0] == "N" else "HIT, one race"
        yield made(group, name, x, 51200, steady(float(name.split("_")[1]), "cwru-rig"), "cwru-rig", RACES[name[0]])
    for path in sorted((folder / "mfpt").glob("*.mat")):
        bearing = io.loadmat(path, squeeze_me=True, struct_as_record=False)["bearing"]
        yield made(
            "MFPT", path.stem, bearing.gs, float(bearing.sr), steady(1500, "mfpt-rig"), "mfpt-rig", RACES[path.name[0]]
        )
    for path in sorted((folder / "wt_hss_bearing").glob("*.mat")):
        data = io.loadmat(path)
        times = data["tach"].ravel() if seconds is None else data["tach"].ravel()[data["tach"].ravel() < seconds]
        pulses = PulseTimes(times_s=times, shaft="high speed shaft", pulses_per_rev=2)
        yield made("wind turbine", path.stem, data["vibration"].ravel(), 97656, pulses, "wind-turbine", "inner_race")


def said(analysis: xr.DataTree, kind: str, component: str = "") -> dict[str, Any]:
    """Return what an analysis says of the damaged part, any of its kind if no component is known, and of others."""
    found, every = findings_table(analysis), verdict_table(analysis)
    right, diagnosed = names_part(found, kind, component), (found["verdict"] == "diagnosed").to_numpy()
    own = every[(every["kind"] == kind) & ((every["component"] == component) | (not component))]
    return {
        "named": bool(right.any()),
        "first": bool(right.size and right[0]),
        "wrong first": bool(right.size and not right[0]),
        "diagnosed": bool((right & diagnosed).any()),
        "wrong diagnosed": bool((~right & diagnosed).any()),
        "others": int((~right).sum()),
        "sound": bool(kind) and bool((own["verdict"] == "nothing found").any()),
        "not judged": bool((own["verdict"] == "not judged").any() and not right.any()),
        "too short": bool(own["doubts"].str.contains(TOO_FEW).any() and not right.any()),
        "tooth": bool((found["kind"] == "tooth").any()),
    }


def names_part(found: pd.DataFrame, kind: str, component: str = "") -> np.ndarray:
    """Return which findings name a component, of a tooth also as one that cannot be told from it."""
    return np.array(
        [
            row.kind == kind and (component in {"", row.component} or (kind == "tooth" and component in row.evidence))
            for row in found.itertuples()
        ],
        dtype=bool,
    )


def measured_rows(folder: Path, *, seconds: float | None) -> list[dict[str, Any]]:
    """Return a row for each group of measured records: how many are right, diagnosed, or say more than is true."""
    rows: dict[str, dict[str, Any]] = {}
    for case in measured(folder, seconds=seconds):
        one = said(analyze(case.record, case.gearbox, settings=SETTINGS), case.kind) | {"n": 1}
        row = rows.setdefault(case.group, {"records": case.group} | dict.fromkeys(COLUMNS, 0))
        for column, key in COLUMNS.items():
            row[column] += int(one[key])
    return list(rows.values())


# ---- A stage with planets -------------------------------------------------------------------------------------------

CARRIER_HZ, SECONDS = 4.0, 20  # 80 turns of the carrier

STAGES = {"27/36/99": (27, 36, 99), "20/31/82": (20, 31, 82)}


def planetary(sun: int, planet: int, ring: int) -> dict[str, Any]:
    """Return a stage of three planets and a fixed ring, as `planetary-27-36-99` of the catalogue."""
    return {
        "name": f"planetary {sun}/{planet}/{ring}",
        "frame": "housing",
        "reference": "sun",
        "rigid": [["housing", "ring"]],
        "axes": {
            "main": ["housing", "sun", "ring", "carrier"],
            "planet": {"links": ["carrier", "planet"], "copies": 3},
        },
        "mesh": [
            {"teeth": {"sun": sun, "planet": planet}, "module_mm": 2.0},
            {"teeth": {"planet": planet, "ring": -ring}, "module_mm": 2.0},
        ],
        "bearing": [
            {
                "names": ["carrier front", "carrier rear"],
                "inner_ring": "carrier",
                "outer_ring": "housing",
                "elements": 25,
                "element_diameter_mm": 5,
                "pitch_diameter_mm": 54,
                "contact_angle_deg": 15,
            }
        ],
    }


def planetary_scene(teeth: tuple[int, int, int]) -> dict[str, Any]:
    """Return a scene of 80 carrier turns with a sensor on the ring, without faults."""
    sun, _, ring = teeth
    return {
        "gearbox": planetary(*teeth),
        "rate_hz": 20000,
        "duration_s": SECONDS,
        "fidelity": "kinematic",
        "speed": {"link": "sun", "rpm": 60 * CARRIER_HZ * (sun + ring) / sun},
        "tachometer": {"link": "sun", "pulses_per_rev": 1},
        "planet_pass": {"half_width_deg": 40, "floor": 0.1},
        "noise": {"rms": 0.5},
        "sensor": [{"name": "ring", "on": "ring", "units": "m s-2"}],
    }


# ---- Faults of machines that the library does not hold --------------------------------------------------------------


SIZE_KEYS = {"tooth_crack": "depth_mm"}


def held_out_rows(count: int, *, jobs: int, first: int = 0) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return how many healthy records of held-out machines are named, in all, and by drive and imperfection."""
    strata: dict[str, list[dict[str, Any]]] = {}
    for one in healthy_library.every(range(first, first + count), held_out=True, jobs=jobs):
        for name in ("all", f"drive: {one['drive']}", *(f"with {what}" for what in one["imperfections"])):
            strata.setdefault(name, []).append(one)
    rows = [
        {
            "healthy, held out": name,
            "n": len(found),
            "refused": sum(bool(one["refused"]) for one in found),
            "named": sum(bool(one["named"]) for one in found),
            "diagnosed": sum(any(row[2] == "diagnosed" for row in one["named"]) for one in found),
            "parts not judged": f"{_not_judged(found):.0%}",
        }
        for name, found in sorted(strata.items())
    ]
    return rows[:1], rows[1:]


def _not_judged(found: list[dict[str, Any]]) -> float:
    # shafts are judged by limits or a baseline, which no record of the library has
    judged = [row[3] == "not judged" for one in found for row in one["rows"] if row[0] != "shaft"]
    return sum(judged) / max(1, len(judged))


def faulty_table(number: int) -> tuple[dict[str, Any], str, str]:
    """Return the scene of a held-out machine with one fault as a table, its kind and its component."""
    rng = np.random.default_rng([40, number])
    boxes = len(healthy_library.gearboxes(True))  # each kind on each gearbox, not on those of its own number alone
    kind = list(FAULTS)[(number + number // boxes) % len(FAULTS)]
    finding, (low, high) = FAULTS[kind]
    table, _ = healthy_library.table(number, held_out=True)
    gearbox = table["gearbox"]
    if finding == "tooth":
        gears = [row.component for row in defect_orders(gearbox).itertuples() if row.kind == "tooth"]
        component = str(rng.choice(gears))
    else:
        component = str(rng.choice([name for bearing in gearbox.bearings for name in bearing.names]))
        table["sensor"][0]["on"] = component
    size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    table["fault"] = [{"kind": kind, "component": component, SIZE_KEYS.get(kind, "size_mm"): size}]
    return table, kind, component


def faulty_row(number: int) -> dict[str, Any]:
    """Return what the analysis says of a held-out machine with one fault, and how detectable that is."""
    table, kind, component = faulty_table(number)
    gearbox, finding = table["gearbox"], FAULTS[kind][0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            record = simulate(Scene.from_mapping(table), seed=number, detectability=True)
            analysis = analyze(record, gearbox, settings=SETTINGS)
        except ValueError as error:  # a fault that this drive or gearbox cannot have, or a tachometer beyond repair
            return {"kind": kind, "refused": str(error)}
    level = float(record["truth_fault_detectability_db"].max())
    return {"kind": kind, "refused": "", "detectability_db": level} | said(analysis, finding, component)


def faulty_rows(
    count: int, *, jobs: int, first: int = 0, without: str | None = None
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return how many faults of held-out machines are named, by kind about `DETECTABLE_DB`, and of all by level.

    The records are those from number `first` on; those of one gearbox can be left out `without` it.
    """
    boxes = healthy_library.gearboxes(True)
    numbers = [number for number in range(first, first + count) if boxes[number % len(boxes)].name != without]
    with ProcessPoolExecutor(jobs) as pool:
        made = [row for row in pool.map(faulty_row, numbers, chunksize=4) if not row["refused"]]
    counted = ("named", "first", "wrong diagnosed", "not judged", "too short")

    def row(what: str, level: str, own: list[dict[str, Any]]) -> dict[str, Any]:
        return {"fault": what, "detectability": level, "n": len(own)} | {
            key: sum(one[key] for one in own) for key in counted
        }

    by_kind = []
    for kind in FAULTS:
        for above in (True, False):
            own = [one for one in made if one["kind"] == kind and (one["detectability_db"] >= DETECTABLE_DB) == above]
            by_kind.append(row(kind, f"{'at least' if above else 'below'} {DETECTABLE_DB:.0f} dB", own))
    by_level = []
    for level in LEVELS_DB:
        own = [one for one in made if one["detectability_db"] >= level]
        found = row("all kinds", f"at least {level:.0f} dB", own)
        by_level.append(found | {f"share {key}": _share(found, key) for key in ("first", "not judged")})
    return by_kind, by_level


def _share(row: dict[str, Any], of: str) -> str:
    return f"{row[of] / max(1, row['n']):.0%}"


def drawing_rows(records: int) -> list[dict[str, Any]]:
    """Return how often a record is doubted with its own drawing, and with another machine's."""
    boxes = [box for held in (False, True) for box in healthy_library.gearboxes(held)]
    rows = {of: {"drawing": of, "n": 0, "doubted": 0, "diagnosed": 0} for of in ("its own", "another machine's")}
    for number in range(records):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            record, own, *_ = healthy_library.record(number, held_out=bool(number % 2))
        others = [box for box in boxes if not _shares_a_mesh(box, own)]
        for box in (own, *others[number % 5 :: 5]):
            case = record.copy()
            for variable in case.variables:
                if "shaft" in case[variable].attrs:
                    case[variable].attrs["shaft"] = str(box.reference)
            try:
                analysis = analyze(case, box, settings=SETTINGS)
            except AnalysisError:
                continue  # more degrees of freedom than one speed settles
            row = rows["its own" if box is own else "another machine's"]
            row["n"] += 1
            row["doubted"] += "does not look like this gearbox" in analysis.attrs["notes_json"]
            row["diagnosed"] += bool((findings_table(analysis)["verdict"] == "diagnosed").any())
    return list(rows.values())


def _shares_a_mesh(one: Gearbox, other: Gearbox) -> bool:
    meshes = [
        {round(float(row.order), 4) for row in defect_orders(box).itertuples() if row.kind == "gear_mesh"}
        if box.reference
        else set()
        for box in (one, other)
    ]
    return bool(meshes[0] & meshes[1])


COLUMNS = {
    "n": "n",
    "right part first": "first",
    "right part diagnosed": "diagnosed",
    "right part called sound": "sound",
    "wrong part first": "wrong first",
    "wrong part diagnosed": "wrong diagnosed",
    "other parts named": "others",
    "a tooth named": "tooth",
}


def absent_bearings(seed: int, count: int = 21) -> Iterator[dict[str, Any]]:
    """Yield geometries of bearings that are not there: 7 to 16 elements, ratio 0.15 to 0.35, 0 to 15 degrees."""
    rng = np.random.default_rng(seed)
    while count:
        elements, ratio, angle = int(rng.integers(7, 17)), float(rng.uniform(0.15, 0.35)), float(rng.uniform(0, 15))
        if elements * ratio < 0.95 * np.pi:  # they fit on the pitch circle
            count -= 1
            yield {
                "elements": elements,
                "element_diameter_mm": 40.0 * ratio,
                "pitch_diameter_mm": 40.0,
                "contact_angle_deg": angle,
            }


def _races(gearbox: Gearbox) -> dict[str, float]:
    table = defect_orders(solve_kinematics(gearbox))
    return {row.kind: float(row.order) for row in table.itertuples() if row.component.endswith("bearing")}


def absent_rows(folder: Path) -> list[dict[str, Any]]:
    """Return how often a bearing that is not there is named, on healthy and on faulty records."""
    rows = {of: {"absent bearings on": of, "n": 0, "named": 0, "diagnosed": 0} for of in ("healthy", "faulty")}
    for number, case in enumerate(measured(folder)):
        declared = case.gearbox.bearings[0]
        true = _races(case.gearbox)
        row = rows["faulty" if case.kind else "healthy"]
        for geometry in absent_bearings(number):
            bearing = declared.changed(multiples=None, **geometry)
            gearbox = case.gearbox.changed(bearings=(bearing,))
            orders = _races(gearbox)
            if any(abs(one / other - 1) < 0.02 for one in orders.values() for other in true.values()):  # noqa: PLR2004
                continue
            found = findings_table(analyze(case.record, gearbox, settings=SETTINGS))
            row["n"] += 1
            row["named"] += len(found) > 0
            row["diagnosed"] += bool((found["verdict"] == "diagnosed").any())
    return list(rows.values())


def table_of(rows: list[dict[str, Any]]) -> str:
    """Return rows as a table in Markdown."""
    frame = pd.DataFrame(rows)
    lines = ["| " + " | ".join(frame.columns) + " |", "|" + "---|" * len(frame.columns)]
    lines += ["| " + " | ".join(str(value) for value in row) + " |" for row in frame.itertuples(index=False)]
    return "\n".join(lines)


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", default=ROOT / "docs" / "benchmarks", type=Path)
    parser.add_argument("--held-out", type=int, default=2000, help="healthy records of held-out machines")
    parser.add_argument("--faulty", type=int, default=1000, help="records of held-out machines with one fault")
    parser.add_argument("--first", type=int, default=0, help="number of the first of these")
    parser.add_argument("--without", help="a gearbox to be left out of these, such as one that takes long to simulate")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--data", type=Path, default=os.environ.get("HUMS_REAL_DATA"))
    parser.add_argument("--json", type=Path, help="also write the rows here")
    parser.add_argument("--only", choices=SECTIONS, help="print one section, and leave the page as it is")
    given = parser.parse_args()
    every: dict[str, list[dict[str, Any]]] = {}
    pages = []
    for title, rows in sections(given):
        every[title] = rows
        pages += [*([f"## {title}"] if title else []), table_of(rows)]
    if given.only:
        print("\n\n".join(pages))  # noqa: T201
    else:
        note = NOTE.format(held_out=given.held_out, faulty=given.faulty, stated=STATED, detectable=DETECTABLE_DB)
        (given.folder / "verdicts.md").write_text("\n\n".join(["# Verdicts", note, *pages]) + "\n", encoding="utf-8")
    if given.json:
        given.json.write_text(json.dumps(every, default=float), encoding="utf-8")


SECTIONS = ("healthy", "faulty", "drawings", "measured", "absent")


def sections(given: argparse.Namespace) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield the title, empty where it goes on, and the rows of each table that was asked for."""
    wanted = (given.only,) if given.only else SECTIONS if given.data is not None else SECTIONS[:3]
    if "healthy" in wanted:
        whole, strata = held_out_rows(given.held_out, jobs=given.jobs, first=given.first)
        yield "Healthy held-out machines", whole
        yield "", strata
    if "faulty" in wanted:
        by_kind, by_level = faulty_rows(given.faulty, jobs=given.jobs, first=given.first, without=given.without)
        yield "Faulty held-out machines", by_kind
        yield "", by_level
    if "drawings" in wanted:
        yield "Another machine's drawing", drawing_rows(max(10, given.held_out // 20))
    if "measured" in wanted:
        for seconds in (None, 1.0, 0.5, 0.25):
            title = "Measured records" + (f", cut to {seconds:g} s" if seconds else "")
            yield title, measured_rows(given.data, seconds=seconds)
    if "absent" in wanted:
        yield "Declared bearings that do not exist", absent_rows(given.data)


if __name__ == "__main__":
    main()
