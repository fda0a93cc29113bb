"""Healthy synthetic machines: the library from which verdicts learn what health looks like, and those that score.

    python benchmarks/healthy_library.py --records 2000 --deviations 3600 --jobs 2

writes `hums/analysis/healthy_machines.json`: the strengths of evidence that healthy records show, of bearings, and of
teeth. Teeth, and bearings whose line stands at a multiple of a shaft, learn from other records, whose gears all have
pitch deviations: the only thing in health that makes such lines, or teeth that differ.
The even half of the gearboxes and two thirds of the drives are in the library; the others are held out for
`benchmarks/verdicts.py`. Records are synthetic; no measured one teaches anything.
"""

import argparse
import json
import math
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from data_synth import Scene, simulate
from hums import AnalysisError, AnalysisSettings, analyze, findings_table, summary
from hums.analysis.result import group
from hums.gearbox.components import Bearing, frozen
from hums.gearbox.defect_orders import BEARING_KINDS
from hums.gearbox.model import Gearbox, load_gearbox

ROOT = Path(__file__).resolve().parents[1]
SHIPPED = ROOT / "hums" / "analysis" / "healthy_machines.json"
SETTINGS = AnalysisSettings(most_tracks=0)
KEPT = 400  # strengths, the largest: many times those that decide at one in a hundred of some thousand records
FITTED = (10, 15, 20, 25, 30)  # largest strengths whose excesses make a tail; that of the largest bound is taken
FEWEST_EXCESSES = 3
RESAMPLED = 1000  # sets of gearboxes
BOUND = 0.95  # quantile of their tails
TAIL = np.linspace(1, 6, 21)  # times the largest strength of the library

# Link of the catalogue's gearboxes whose speed is driven, and links on the frame's axes that get bearings.
CATALOGUE: Mapping[str, tuple[str, ...]] = {
    "two-stage": (),
    "wind-turbine-3-stage": ("high speed shaft", "intermediate gear", "main shaft"),
    "planetary-27-36-99": (),
    "oh-58": ("input", "bevel gear", "carrier"),
    "alouette-iii": ("input", "main shaft", "tail"),
    "wolfrom": ("sun", "carrier", "output ring"),
    "glinsky-idler": (),
    "glinsky-compound": (),
}
DRAWN = 12  # spur gearboxes of one to three stages, drawn
MODULES_MM = (2.0, 2.5, 3.0, 4.0, 5.0, 6.0)  # series I of ISO 54
RATIOS = {1: (1.6, 4.5), 2: (1.6, 4.0), 3: (1.5, 3.2)}  # of a stage, by the number of stages
IMPERFECTIONS = (
    "gears",
    "planets",
    "imbalance",
    "bearings",
    "electrical",
    "neighbour",
    "knocks",
    "noise",
    "mounts",
    "temperature",
)
SHARE = 0.25  # of the records with an imperfection: each is one of several that a machine may have
DEVIATIONS = 0.5  # share of the numbers with pitch deviations where only those are used
GRADES = (5, 6, 7, 8)  # of their gears, ISO 1328-1: industrial ones; all others have the generator's own
SOUND_NEIGHBOURS = 0.8  # of the library's neighbours: a damaged one beside a sound machine is rare
LENGTHS_S = (1.0, 3.0, 6.0, 10.0)


@cache
def gearboxes(held_out: bool) -> tuple[Gearbox, ...]:
    """Return the gearboxes of the library, or those held out, all with bearings."""
    found = []
    for number, (name, links) in enumerate(CATALOGUE.items()):
        if (number % 2 == 1) == held_out:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # planets that need profile shift
                gearbox = load_gearbox(name)
            found.append(_with_bearings(gearbox, links, np.random.default_rng([7, number])))
    drawn = range(1 if held_out else 0, DRAWN, 2)
    found += [_drawn(f"drawn {number}", 1 + number % 3, np.random.default_rng([8, number])) for number in drawn]
    return tuple(found)


def _drawn(name: str, stages: int, rng: np.random.Generator) -> Gearbox:
    """Return a spur gearbox of teeth without a common factor, its shafts in bearings."""
    between = ["intermediate"] if stages == 2 else [f"intermediate {number}" for number in range(1, stages)]  # noqa: PLR2004
    links = ["input", *between, "output"]
    size, meshes, through = int(rng.integers(0, len(MODULES_MM) - stages)), [], [np.zeros(2)]
    for number in range(stages):
        pinion = int(rng.integers(18, 30))
        wheel = round(pinion * rng.uniform(*RATIOS[stages]))
        while math.gcd(pinion, wheel) > 1:
            wheel += 1
        module_mm = MODULES_MM[size + number]
        meshes.append(
            {
                "name": f"stage {number + 1}",
                "teeth": {links[number]: pinion, links[number + 1]: wheel},
                "module_mm": module_mm,
                "face_width_mm": float(round(rng.uniform(3, 5) * math.pi * module_mm)),
                "pressure_angle_deg": 20.0,
            }
        )
    rng.uniform()  # of the load, which this library does not need
    for mesh, angle_deg in zip(meshes, np.round(rng.uniform(-60, 60, stages), 1), strict=True):
        centre_mm, angle = mesh["module_mm"] * sum(mesh["teeth"].values()) / 2, math.radians(angle_deg)
        through.append(through[-1] + centre_mm * np.array([math.cos(angle), math.sin(angle)]))
    rng.uniform()  # of the top speed
    axes = {
        link: {"links": ["housing", link], "through": [0.0, *map(float, at)]}
        for link, at in zip(links, through, strict=True)
    }
    declared = {"name": name, "frame": "housing", "reference": "input", "axes": axes, "mesh": meshes}
    bearings = [_bearing(link, "housing", rng) for link in links]
    return Gearbox.model_validate(frozen(declared | {"bearing": bearings}))


def _bearing(link: str, frame: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return a bearing of a geometry within what the ball bearings of the catalogue span."""
    share, pitch_mm = rng.uniform(0.115, 0.24), rng.uniform(28, 72)
    elements = round(rng.uniform(0.55, 0.61) * math.pi / share)
    return {
        "names": (f"{link} bearing",),
        "inner_ring": link,
        "outer_ring": frame,
        "elements": elements,
        "element_diameter_mm": float(round(share * pitch_mm, 2)),
        "pitch_diameter_mm": float(round(pitch_mm, 2)),
        "contact_angle_deg": float(rng.choice((0.0, 0.0, 0.0, 15.0))),
    }


def _with_bearings(gearbox: Gearbox, links: tuple[str, ...], rng: np.random.Generator) -> Gearbox:
    """Return a gearbox with a bearing of a drawn geometry between each link and the frame."""
    if gearbox.bearings:
        return gearbox
    on_frame = (
        links
        or tuple(
            link
            for axis in gearbox.axes
            for link in axis.links
            if gearbox.frame in axis.links and link != gearbox.frame
        )[:3]
    )
    made = [_bearing(link, gearbox.frame, rng) for link in on_frame]
    return gearbox.changed(bearings=tuple(Bearing.model_validate(one) for one in made))


def _constant(top: float, load: float, _: float, rng: np.random.Generator) -> dict[str, Any]:
    return {"rpm": [[0, top * rng.uniform(0.5, 1)]], "nm": [[0, load * rng.uniform(0.2, 1)]]}


def _drift(top: float, load: float, t: float, rng: np.random.Generator) -> dict[str, Any]:
    start = top * rng.uniform(0.6, 0.9)
    return {"rpm": [[0, start], [t, start * rng.uniform(1.02, 1.1)]], "nm": [[0, load * rng.uniform(0.2, 1)]]}


def _run_up(top: float, load: float, t: float, rng: np.random.Generator) -> dict[str, Any]:
    return {"rpm": [[0, top / 4], [t, top]], "nm": [[0, load * rng.uniform(0.2, 1)]], "exponent": 2.0}


def _coast_down(top: float, load: float, t: float, rng: np.random.Generator) -> dict[str, Any]:
    return {"rpm": [[0, top], [t, top / 4]], "nm": [[0, load * rng.uniform(0.2, 1)]]}


def _speed_steps(top: float, load: float, t: float, rng: np.random.Generator) -> dict[str, Any]:
    levels = top * rng.uniform(0.5, 1, 3)
    rows = [[0, levels[0]], [0.3 * t, levels[0]], [0.37 * t, levels[1]], [0.65 * t, levels[1]], [0.72 * t, levels[2]]]
    return {"rpm": [*rows, [t, levels[2]]], "nm": [[0, load * rng.uniform(0.2, 1)]]}


def _load_ramps(top: float, load: float, t: float, rng: np.random.Generator) -> dict[str, Any]:
    at = np.linspace(0, t, 5)
    return {"rpm": [[0, top * rng.uniform(0.5, 1)]], "nm": [[s, load * rng.uniform(0.2, 1)] for s in at]}


def _load_steps(top: float, load: float, t: float, rng: np.random.Generator) -> dict[str, Any]:
    steps = [[0, load * 0.2], [0.35 * t, load], [0.65 * t, load * rng.uniform(0.2, 0.5)]]
    start = top * rng.uniform(0.5, 0.9)
    return {"rpm": [[0, start], [t, 1.1 * start]], "steps": steps, "rise_s": 0.05 * t}


def _turbulence(top: float, load: float, _: float, rng: np.random.Generator) -> dict[str, Any]:
    return {"rpm": [[0, top * rng.uniform(0.5, 0.9)]], "nm": [[0, 0.6 * load]], "turbulence": 0.2 * load}


def _start_stop(top: float, load: float, t: float, rng: np.random.Generator) -> dict[str, Any]:
    high = top * rng.uniform(0.5, 1)
    rows = [[0, 0.2 * high], [0.25 * t, high], [0.75 * t, high], [t, 0.2 * high]]
    return {"rpm": rows, "nm": [[0, load * rng.uniform(0.2, 1)]], "exponent": 1.0}


Drive = Callable[[float, float, float, np.random.Generator], dict[str, Any]]
LEARNED: Mapping[str, Drive] = {
    "constant": _constant,
    "ramp 1:4": _run_up,
    "speed steps": _speed_steps,
    "load ramps": _load_ramps,
    "turbulence": _turbulence,
    "start and stop": _start_stop,
}
HELD_OUT: Mapping[str, Drive] = {"drift": _drift, "coast down 4:1": _coast_down, "load steps": _load_steps}


def table(number: int, *, held_out: bool, deviations: bool = False) -> tuple[dict[str, Any], str]:
    """Return the scene of a healthy machine as a table, and its drive's name; half have `deviations` of some grade."""
    rng = np.random.default_rng([20 + held_out, number])
    boxes = gearboxes(held_out)
    gearbox = boxes[number % len(boxes)]
    drives = HELD_OUT if held_out else LEARNED
    name = list(drives)[int(rng.integers(len(drives)))]
    seconds = float(rng.choice(LENGTHS_S, p=(0.15, 0.25, 0.35, 0.25)))
    top = float(rng.uniform(900, 3000))
    drive = drives[name](top, 500.0, seconds, rng)
    rate_hz = float(rng.choice([20000, 25600]))
    link = str(gearbox.reference)
    torque: dict[str, Any] = {"link": link}
    if "steps" in drive:
        torque |= {"steps": drive["steps"], "rise_s": drive["rise_s"]}
    else:
        torque |= {"nm": drive["nm"]}
    if "turbulence" in drive:
        torque["turbulence"] = {"rms": drive["turbulence"], "time_scale_s": 1.0}
    mesh = float(rng.uniform(0.1, 1.0))
    on = [one for bearing in gearbox.bearings for one in bearing.names]
    scene = {
        "gearbox": gearbox,
        "rate_hz": rate_hz,
        "duration_s": seconds,
        "fidelity": "kinematic",
        "speed": {"link": link, "rpm": drive["rpm"]},
        "torque": torque,
        "tachometer": {"link": link, "pulses_per_rev": int(rng.choice([1, 2, 60]))},
        "noise": {"rms": float(10 ** rng.uniform(-2, -0.2))},
        "path": {"frequency_hz": float(rng.uniform(1200, 5000)), "damping_ratio": float(rng.uniform(0.02, 0.1))},
        "resonance": {"frequency_hz": float(rng.uniform(4000, 0.4 * rate_hz)), "damping_ratio": 0.03},
        "excitation": {
            "mesh_amplitude": mesh,
            "shaft_amplitude": float(rng.uniform(0.01, 0.2)),
            "harmonics": int(rng.integers(2, 6)),
            "speed_exponent": drive.get("exponent", 0.0),
        },
        "dynamics": {
            "housing_kg": 20.0,
            "meshes": {mesh.name: {"module_mm": 3.0, "face_width_mm": 30.0} for mesh in gearbox.meshes},
        },
        "imperfections": {
            key: {} for key in IMPERFECTIONS if rng.uniform() < (DEVIATIONS if deviations and key == "gears" else SHARE)
        },
        "sensor": [{"name": "a", "on": str(rng.choice(on)), "units": "g"}],
    }
    if any("planet 2" in link for link in gearbox.links):
        scene["planet_pass"] = {"half_width_deg": float(rng.uniform(20, 60))}
    else:
        scene["imperfections"].pop("planets", None)
    if "neighbour" in scene["imperfections"] and not held_out and rng.uniform() < SOUND_NEIGHBOURS:
        scene["imperfections"]["neighbour"] = {"impact_m_s2": 0.0}
    if deviations and "gears" in scene["imperfections"]:
        scene["imperfections"]["gears"] = {"grade": int(rng.choice(GRADES))}
    return scene, name


def record(
    number: int, *, held_out: bool, deviations: bool = False
) -> tuple[xr.Dataset, Gearbox, str, tuple[str, ...]]:
    """Return a healthy record, its gearbox, the drive's name, and the imperfections it has."""
    made, drive = table(number, held_out=held_out, deviations=deviations)
    scene = Scene.from_mapping(made)
    return simulate(scene, seed=number), scene.gearbox, drive, tuple(made["imperfections"])


def strengths(number: int, *, held_out: bool, deviations: bool = False) -> dict[str, Any]:
    """Return what the analysis of a healthy record says: strengths of all parts, and who is named."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data, gearbox, drive, imperfections = record(number, held_out=held_out, deviations=deviations)
        of = {
            "number": number,
            "gearbox": gearbox.name,
            "drive": drive,
            "imperfections": imperfections,
            "duration_s": float(data.sizes["time"]) / float(data.attrs["rate_hz"]),
        }
        try:
            analysis = analyze(data, gearbox, settings=SETTINGS)
        except AnalysisError as error:
            return of | {"rows": [], "named": [], "notes": [], "refused": str(error)}
    rows = [
        (str(kind), max(0.0, float(score)) if kind in BEARING_KINDS else float(strength), str(hidden), str(verdict))
        for name in ("findings", "verdicts")
        for kind, strength, score, hidden, verdict in zip(
            *(group(analysis, name)[key].to_numpy() for key in ("kind", "strength", "score", "doubts", "verdict")),
            strict=True,
        )
        if math.isfinite(strength) or kind not in BEARING_KINDS
    ]
    named = findings_table(analysis)
    return of | {
        "rows": rows,
        "named": named[["component", "kind", "verdict", "evidence"]].to_numpy().tolist(),
        "notes": summary(analysis)["notes"],
        "refused": "",
    }


def every(numbers: Iterable[int], *, held_out: bool, jobs: int, deviations: bool = False) -> Iterator[dict[str, Any]]:
    """Yield `strengths` of many records."""
    run = partial(strengths, held_out=held_out, deviations=deviations)
    if jobs == 1:
        yield from map(run, numbers)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(run, numbers, chunksize=4)


def judged(records: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the records that were not refused."""
    found = []
    for one in records:
        if not one["refused"]:
            found.append(one)
            if len(found) % 50 == 0:
                sys.stderr.write(f"{len(found)} records\n")
    return found


def distribution(shown: list[dict[str, Any]], of: Callable[[str], bool]) -> dict[str, Any]:
    """Return the number of records and parts of some kinds that were judged, and the largest of their strengths.

    Parts whose line may have another source are left out.
    """
    rows = [[row for row in one["rows"] if of(row[0]) and np.isfinite(row[1])] for one in shown]

    parts: dict[str, int] = {}
    values: dict[str, list[float]] = {}
    for one, own in zip(shown, rows, strict=True):
        parts[one["gearbox"]] = parts.get(one["gearbox"], 0) + len(own)
        strong = [round(row[1], 5) for row in own if row[1] > 0 and not row[2].startswith("the line may ")]
        values.setdefault(one["gearbox"], []).extend(strong)
    largest = sorted((value for own in values.values() for value in own), reverse=True)[:KEPT]
    at = largest[0] * TAIL
    return {
        "records": sum(bool(own) for own in rows),
        "parts": sum(parts.values()),
        "strengths": largest,
        "tail_strengths": [float(f"{value:.5g}") for value in at],
        "tail_bounds": [float(f"{value:.3g}") for value in tail_bounds(at, values, parts)],
    }


def tail_bounds(
    at: NDArray[np.float64], values: Mapping[str, list[float]], parts: Mapping[str, int]
) -> NDArray[np.float64]:
    """Return the upper bound of the probability that a part is as strong `at` each strength.

    The tail is exponential: a score is a logarithm of odds, and that of a tooth's strength falls faster. Parts of
    one gearbox are not independent, so that gearboxes are resampled. Of the bounds over all thresholds the largest is
    taken.
    """
    largest = np.sort(np.concatenate(list(values.values())))[::-1]
    bounds = []
    for count in FITTED:
        rng, threshold, found = np.random.default_rng(0), largest[count], []
        for _ in range(RESAMPLED):
            drawn = rng.choice(list(values), len(values))
            excess = np.concatenate([values[name] for name in drawn]) - threshold
            excess = excess[excess > 0]
            if excess.size >= FEWEST_EXCESSES:
                share = excess.size / sum(parts[name] for name in drawn)
                found.append(share * np.exp((threshold - at) / excess.mean()))
        bounds.append(np.quantile(found, BOUND, axis=0))
        said = ", ".join(
            f"{bound:.2g} at {strength:.3g}" for strength, bound in zip(at[::5], bounds[-1][::5], strict=True)
        )
        sys.stderr.write(f"{count} largest, over {threshold:.4f}: {said}\n")
    return np.max(bounds, axis=0)


def main() -> None:
    """Make the library and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=1000)
    parser.add_argument("--deviations", type=int, default=900, help="records of which half have pitch deviations, or 0")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path, help="also write what every record showed here")
    given = parser.parse_args()
    learned = json.loads(SHIPPED.read_text(encoding="utf-8"))
    shown = judged(every(range(given.records), held_out=False, jobs=given.jobs))
    if shown:
        learned["bearings"] = distribution(shown, lambda kind: kind != "tooth")
    numbers = [
        number
        for number in range(given.deviations)
        if "gears" in table(number, held_out=False, deviations=True)[0]["imperfections"]
    ]
    deviating = judged(every(numbers, held_out=False, jobs=given.jobs, deviations=True))
    if deviating:
        learned["teeth"] = distribution(deviating, lambda kind: kind == "tooth")
    SHIPPED.write_text(json.dumps(learned) + "\n", encoding="utf-8")
    if given.json:
        given.json.write_text(json.dumps([*shown, *deviating]), encoding="utf-8")


if __name__ == "__main__":
    main()
