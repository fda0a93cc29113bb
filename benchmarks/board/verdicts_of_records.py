"""Verdicts: on measured records, on healthy and faulty synthetic machines, and on stages with planets."""

import re
import tomllib
import warnings
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import healthy_library
import numpy as np
import second_simulator
import verdicts
from scipy.stats import binom

from board.sections import Effort, Section, Task
from board.table import Figure, Miss, Row, averaged, count_row, same
from data_synth import Scene, simulate
from hums import Gearbox, NominalSpeed, analyze, findings_table, load_gearbox, make_record

# notes that doubt what was declared
DOUBTED = re.compile("does not look like this gearbox|contradict|spread over|do not confirm|of the record indicate")
SETS = {
    "CWRU": "CWRU, one race",
    "HIT": "HIT, one race",
    "MFPT": "MFPT",
    "wind turbine": "wind turbine",
    "UESTC": "UESTC, one race",
    "MFS": "MFS",
    "hard": "balls, and OR014 of CWRU",
}
HARD = ("CWRU, hard", "UESTC, ball")
UNSEEN = ("UESTC, one race", "UESTC, ball", "MFS")
MISSED = {
    ("wind turbine", "first"): Miss(3, "the single line of the first day, 5 % deep, one in 64 healthy machines shows"),
    ("wind turbine", "diagnosed"): Miss(2, "that of the second has no sidebands, and is indicated"),
}
SLOW = "Wolfrom"  # whose records take ten times as long to simulate


# ---- measured records ------------------------------------------------------------------------------------------------


def unseen_rigs(effort: Effort) -> Iterator[verdicts.Measured]:
    """Yield the records of two rigs whose speed is declared as the names say: 0.5 to 8 % off, without a tachometer."""
    assert effort.data is not None  # noqa: S101 - asked for where there is data
    for folder, drawing, rate_hz in (("uestc_uc204", "uc204", 20_000.0), ("mfs_er10k", "mb-er-10k", 25_600.0)):
        place = effort.data / folder
        gearbox = Gearbox.model_validate(tomllib.loads((place / f"{drawing}.toml").read_text(encoding="utf-8")))
        for path in sorted(place.glob("*.npz")):
            letter, _, rest = path.stem.partition("_")
            kind = {"I": "inner_race", "O": "outer_race", "B": "rolling_element"}.get(letter[0], "")
            rpm = float(rest.split("_")[0]) if rest else 2400.0
            with np.load(path) as held:
                x = np.asarray(held["vib"], dtype=np.float64)
            angle = NominalSpeed(rpm=rpm, shaft=str(gearbox.reference))
            record = make_record({"case": x}, rate_hz=rate_hz, units="g", angle=angle)
            of = "MFS" if folder.startswith("mfs") else "UESTC, ball" if letter == "B" else "UESTC, one race"
            group = of if kind else "healthy"
            yield verdicts.Measured(group=group, name=path.stem, record=record, gearbox=gearbox, kind=kind)


def judged(case: verdicts.Measured) -> dict[str, Any]:
    """Return what is said of a measured record."""
    return {"group": case.group} | verdicts.said(
        analyze(case.record, case.gearbox, settings=verdicts.SETTINGS), case.kind
    )


def measured_tasks(effort: Effort) -> list[Task]:
    """Return a task for each measured record."""
    if effort.data is None:
        return []
    return [partial(judged, case) for case in (*verdicts.measured(effort.data), *unseen_rigs(effort))]


def measured_figures(found: Sequence[dict[str, Any]]) -> dict[str, Figure]:
    """Return the counts by set."""
    if not found:
        return {}
    figures = {}
    for name, group in SETS.items():
        own = [one for one in found if one["group"] == group or (name == "hard" and one["group"] in HARD)]
        figures[f"measured, {name}: first"] = Figure.share([one["first"] for one in own])
        figures[f"measured, {name}: diagnosed"] = Figure.share([one["diagnosed"] for one in own])
    faulty = [one for one in found if one["group"] != "healthy"]
    figures["measured: wrong diagnosed"] = Figure.share([one["wrong diagnosed"] for one in faulty])
    unseen = [one["group"] in UNSEEN for one in faulty]
    for row, where in (("measured: others named", False), ("measured, unseen rigs: others named", True)):
        own = [one for one, at in zip(faulty, unseen, strict=True) if at == where]
        figures[row] = Figure(value=sum(one["others"] for one in own))
    figures["measured: called sound"] = Figure.share([one["sound"] for one in faulty])
    healthy = [one for one in found if one["group"] == "healthy"]
    figures["measured: healthy named"] = Figure.share([one["others"] > 0 for one in healthy])
    return figures


MEASURED = Section(
    name="measured records",
    rows=(
        *(
            Row(
                name=f"measured, {name}: {key}",
                what=f"{of}: damaged part {words}",
                better="more",
                limit=same,
                missed=MISSED.get((name, key)),
            )
            for name, of in SETS.items()
            for key, words in (("first", "named first"), ("diagnosed", "diagnosed"))
        ),
        Row(name="measured: wrong diagnosed", what="faulty records with a wrong part diagnosed", limit=same),
        Row(
            name="measured: others named",
            what="parts named besides the right one, rigs of known speed",
            limit=same,
            missed=Miss(3, "the inner race of CWRU's B007_2, whose ball is damaged"),
        ),
        Row(name="measured, unseen rigs: others named", what="as above, UESTC and MFS, whose speeds deviate"),
        Row(name="measured: called sound", what='damaged parts that read "nothing found"', limit=same),
        Row(name="measured: healthy named", what="healthy records with a part named", limit=same),
    ),
    tasks=measured_tasks,
    figures=measured_figures,
)


# ---- synthetic machines ----------------------------------------------------------------------------------------------


def held_out(numbers: range, effort: Effort) -> list[int]:
    """Return the numbers of held-out machines; but at the full size without the gearbox that takes long."""
    boxes = healthy_library.gearboxes(True)
    return [n for n in numbers if effort.size == "full" or SLOW not in boxes[n % len(boxes)].name]


def healthy_tasks(effort: Effort) -> list[Task]:
    """Return a task for each healthy held-out machine."""
    numbers = held_out(effort.numbers(30, 120, 2000), effort)
    return [partial(healthy_library.strengths, number, held_out=True) for number in numbers]


def healthy_figures(found: Sequence[dict[str, Any]]) -> dict[str, Figure]:
    """Return how many are named, doubted, and how many parts are not judged."""
    judgements = [row[3] == "not judged" for one in found for row in one["rows"] if row[0] != "shaft"]
    unjudged = [
        sum(row[3] == "not judged" for row in one["rows"] if row[0] != "shaft") / max(1, len(one["rows"]))
        for one in found
    ]
    return {
        "healthy: named": Figure.share([bool(one["named"]) for one in found]),
        "healthy: diagnosed": Figure.share([any(row[2] == "diagnosed" for row in one["named"]) for one in found]),
        "healthy: doubted": Figure.share([any(map(DOUBTED.search, one["notes"])) for one in found]),
        "healthy: not judged": Figure(value=sum(judgements) / len(judgements), spread=Figure.mean(unjudged).spread),
    }


HEALTHY = Section(
    name="healthy synthetic machines",
    rows=(
        count_row("healthy: named", "held-out healthy machines with a part named, at a stated 0.01", "less"),
        count_row("healthy: diagnosed", "of these, with a part diagnosed", "less"),
        count_row("healthy: doubted", "of these, with correct declarations doubted", "less"),
        Row(name="healthy: not judged", what="share of their parts not judged, without shafts", limit=averaged("less")),
    ),
    tasks=healthy_tasks,
    figures=healthy_figures,
)


def faulty_tasks(effort: Effort) -> list[Task]:
    """Return a task for each faulty held-out machine."""
    return [partial(verdicts.faulty_row, number) for number in held_out(effort.numbers(40, 160, 1000), effort)]


def faulty_figures(found: Sequence[dict[str, Any]]) -> dict[str, Figure]:
    """Return the counts for bearing parts and for teeth, from 40 dB on."""
    made = [one for one in found if not one["refused"]]
    figures = {}
    for name, tooth in (("bearing parts", False), ("teeth", True)):
        clear = [one for one in made if one["detectability_db"] >= verdicts.DETECTABLE_DB]
        own = [one for one in clear if (verdicts.FAULTS[one["kind"]][0] == "tooth") == tooth]
        for key in ("first", "diagnosed", "sound"):
            figures[f"faulty, {name}: {key}"] = Figure.share([one[key] for one in own])
    return figures | {"faulty: wrong diagnosed": Figure.share([one["wrong diagnosed"] for one in made])}


FAULTY = Section(
    name="faulty synthetic machines",
    rows=(
        *(
            count_row(f"faulty, {name}: {key}", f"{name} from 40 dB on {words}", better)
            for name in ("bearing parts", "teeth")
            for key, words, better in (
                ("first", "named first", "more"),
                ("diagnosed", "diagnosed", "more"),
                ("sound", 'that read "nothing found"', "less"),
            )
        ),
        count_row("faulty: wrong diagnosed", "records with a wrong part diagnosed, at any level", "less"),
    ),
    tasks=faulty_tasks,
    figures=faulty_figures,
)


def planet_case(component: str, seed: int) -> dict[str, Any]:
    """Return what is said of a crack in a stage with planets."""
    fault = {"kind": "tooth_crack", "component": component, "depth_mm": 2.0}
    scene = Scene.from_mapping(verdicts.planetary_scene(verdicts.STAGES["27/36/99"]) | {"fault": [fault]})
    analysis = analyze(simulate(scene, seed=seed), scene.gearbox, settings=verdicts.SETTINGS)
    return verdicts.said(analysis, "tooth", component)


def planet_tasks(effort: Effort) -> list[Task]:
    """Return a task for each crack in the sun, a planet and the ring."""
    components = ("sun-planet/sun", "planet-ring/planet", "planet-ring/ring")
    return [partial(planet_case, part, 1 + seed) for seed in effort.numbers(1, 6, 100) for part in components]


PLANETS = Section(
    name="stages with planets",
    rows=(
        count_row("planets: first", "cracks of 2 mm in sun, planet or ring named first", "more"),
        count_row("planets: wrong diagnosed", "of these records, with a wrong part diagnosed", "less"),
    ),
    tasks=planet_tasks,
    figures=lambda found: {
        f"planets: {key}": Figure.share([one[key] for one in found]) for key in ("first", "wrong diagnosed")
    },
)


def strong_drive(name: str, seed: int) -> bool:
    """Return whether a healthy gearbox under a strong drive has a part named."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = Scene.from_mapping(verdicts.HEALTHY | verdicts.DRIVES[name])
        found = findings_table(
            analyze(simulate(scene, seed=seed), load_gearbox("two-stage"), settings=verdicts.SETTINGS)
        )
    return len(found) > 0


DRIVES = Section(
    name="strong drives",
    rows=(count_row("drives: named", "healthy records with varying speed and load, with a part named", "less"),),
    tasks=lambda effort: [
        partial(strong_drive, name, 1 + seed) for name in verdicts.DRIVES for seed in effort.numbers(1, 6, 40)
    ],
    figures=lambda found: {"drives: named": Figure.share(found)},
)
# ---- machines of a second simulator ----------------------------------------------------------------------------------


def second_case(number: int, *, faulty: bool) -> dict[str, Any]:
    """Return what is said of a machine of the simulator that shares nothing with `data_synth`."""
    case = second_simulator.case(number, faulty=faulty)
    kind = "tooth" if case.kind in second_simulator.TEETH else case.kind
    analysis = analyze(case.record, case.gearbox, settings=verdicts.SETTINGS)
    doubts = findings_table(analysis)["doubts"]
    knocks = doubts.map(lambda said: any(f"loose part on {shaft} " in said for shaft in case.knocks))
    return verdicts.said(analysis, kind, case.component) | {
        "of": "healthy" if not faulty else "teeth" if kind == "tooth" else "bearing parts",
        "clear": case.level_db >= verdicts.DETECTABLE_DB,
        "accused": bool((~knocks).any()) if len(doubts) else False,
        "knock": bool(knocks.any()),
    }


def second_tasks(effort: Effort) -> list[Task]:
    """Return a task for each machine, sound and faulty."""
    return [partial(second_case, n, faulty=faulty) for faulty in (False, True) for n in effort.numbers(40, 160, 400)]


def second_figures(found: Sequence[dict[str, Any]]) -> dict[str, Figure]:
    """Return the counts of healthy machines, and of bearing parts and teeth, from 40 dB on but for wrong ones."""
    healthy = [one for one in found if one["of"] == "healthy"]
    faulty = [one for one in found if one["of"] != "healthy"]
    figures = {
        "second: healthy named": Figure.share([one["accused"] for one in healthy]),
        "second: knocks": Figure.share([one["knock"] for one in healthy]),
    }
    for name in ("bearing parts", "teeth"):
        clear = [one for one in faulty if one["of"] == name and one["clear"]]
        figures |= {f"second, {name}: {key}": Figure.share([one[key] for one in clear]) for key in ("first", "sound")}
    return figures | {f"second: {key}": Figure.share([one[key] for one in faulty]) for key in WRONG}


CHANCE = 0.975  # that a true hundredth passes
WRONG = ("wrong first", "wrong diagnosed")
SECOND = Section(
    name="second simulator",
    rows=(
        Row(
            name="second: healthy named",
            what="healthy machines of another simulator with a part named, at a stated 0.01, without the next row",
            limit=lambda now, _: float(binom.ppf(CHANCE, now.of or 0, verdicts.STATED)),
        ),
        Row(name="second: knocks", what="of these, with a knock identified as such, or a tooth of its shaft named"),
        *(
            count_row(f"second, {name}: {key}", f"its {name} from 40 dB on {words}", better)
            for name in ("bearing parts", "teeth")
            for key, words, better in (
                ("first", "named first", "more"),
                ("sound", 'that read "nothing found"', "less"),
            )
        ),
        *(
            count_row(f"second: {key}", f"its faulty machines, any level: another part {key[6:]}", "less")
            for key in WRONG
        ),
    ),
    tasks=second_tasks,
    figures=second_figures,
)
SECTIONS = (MEASURED, HEALTHY, FAULTY, PLANETS, DRIVES, SECOND)
