"""Alarms of healthy and failing fleets: python benchmarks/fleet.py ANALYSES [FOLDER] [--data DATA] [--only SECTION].

Writes fleet.md into FOLDER (default docs/benchmarks), or one SECTION of it anew (--only cost). ANALYSES is a folder
that keeps what takes long: a dataset of one gearbox, healthy and with 13 kinds of faults of all sizes, and its analyses
by `hums.analyze_fleet`; it is made where it is missing, a record in 1 s of CPU. Fleets are made from it by resampling
(`fleet_analyses`). --data, or the environment variable HUMS_REAL_DATA, names the folder of measured records.
"""

import argparse
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from itertools import compress, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from fleet_analyses import (
    MACHINES,
    SIZES,
    Analyses,
    Array,
    Resampled,
    added,
    analyses,
    fault_courses,
)
from fleet_chain import CHUNK, RATES, WATCHED, at_rate, largest, two_of_three, watch
from fleet_cost import cost_rows
from fleet_forecasts import LAWS, coverage
from fleet_measured import run_to_failure, turbine
from page_files import table
from scipy.stats import gamma

from hums.fleet.monitor import MachineState, update
from hums.fleet.observation import MonitorSettings, Observation
from hums.fleet.series import Numbers, Series, component_parts, layout_of, prior_of, shared
from signals.monitoring.health import Layout

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parents[1]
BASELINES = (30, 300)
ONSET = 60  # healthy records between the baseline and the start of a fault
HEALTHY, FAILING = 400, 24  # machines, healthy and of each fault
FORECASTS, TIMED = 300, 1_000  # of each law, and records of the whole run that is timed
DAY = datetime(2020, 1, 1, tzinfo=UTC)
MEASURED_STATES = ("temperature_k", "load")


# ---- false alarms ----------------------------------------------------------------------------------------------------


def healthy_fleet(
    resampled: Resampled,
    found: Analyses,
    layout: Layout,
    *,
    machines: int,
    baseline: int,
    seed: int,
    measured: Sequence[str] = (),
) -> tuple[list[Array], list[Array]]:
    """Return the records until each machine's first alarm, and its largest index, for each of `RATES`."""
    prior = prior_of(found.series, layout, found.levels)
    until: list[list[Array]] = [[] for _ in RATES]
    highest: list[list[Array]] = [[] for _ in RATES]
    for start in range(0, machines, CHUNK):
        rng = np.random.default_rng([seed, start])
        fleet = resampled.machines(min(CHUNK, machines - start), baseline + WATCHED, rng, measured)
        for place, one in enumerate(watch(fleet, baseline, RATES, layout, prior)):
            until[place].append(one.until_alarm)
            highest[place].append(largest(one.index, layout))
    return [np.concatenate(those) for those in until], [np.concatenate(those) for those in highest]


def run_lengths(until: Array) -> tuple[int, int, float, float]:
    """Return alarms, records until them, and the 95 % interval of records per alarm, infinite above without alarms.

    The interval is that of a Poisson number (Garwood 1936, Biometrika 28, 437-442): a machine has one alarm at most, so
    that the number scatters no more than that even if some machines raise theirs sooner than others.
    """
    alarms, records = int(np.isfinite(until).sum()), np.minimum(until, WATCHED).sum()
    fewest, most = gamma.ppf(0.025, alarms) if alarms else 0.0, gamma.ppf(0.975, alarms + 1)
    return alarms, int(records), records / most, records / fewest if alarms else np.inf


def false_alarms(found: Analyses, resampled: Resampled) -> str:
    """Return how many alarms healthy machines raise, and how many are stated."""
    _, _, layout = layout_of(found.series)
    words = (
        f"{HEALTHY} machines, {WATCHED} monitored records each; a tenth as many with temperature and load "
        "measured with each record. The stated run length is the mean number of records of a machine from a state "
        "without alarms to the first alarm of any of its components and sensors; what follows while that stands is not "
        "counted. It is measured as all records up to the first alarms over the number of these; nine in ten machines "
        "reach the number of records in the last column but one.\n"
    )
    counts = ("stated: one in", "alarms", "in records", "one in", "95% of that", "nine in ten", "within")
    rows: list[tuple[object, ...]] = []
    for baseline in BASELINES:
        for measured, machines in (((), HEALTHY), (MEASURED_STATES, HEALTHY // 10)):
            fleets, _ = healthy_fleet(
                resampled, found, layout, machines=machines, baseline=baseline, seed=5, measured=measured
            )
            for every, until in zip(RATES, fleets, strict=True):
                alarms, records, low, high = run_lengths(until)
                tenth = np.quantile(until, 0.1, method="lower")
                within = "yes" if low <= every <= high else "no, fewer" if low > every else "no"
                cells = (
                    baseline,
                    "temperature, load" if measured else "nothing",
                    f"{every:,.0f}",
                    alarms,
                    f"{records:,}",
                    f"{records / alarms:,.0f}" if alarms else f"over {records:,}",
                    f"{low:,.0f} to {high:,.0f}" if alarms else f"over {low:,.0f}",
                    f"{tenth:.0f}" if tenth < np.inf else f"over {WATCHED}",
                    within,
                )
                rows.append(cells)
                print(*cells, flush=True)  # noqa: T201
    still, few = resampled.still(), HEALTHY // 4
    until = healthy_fleet(still, found, layout, machines=few, baseline=BASELINES[0], seed=5)[0][0]
    alarms, records, *_ = run_lengths(until)
    note = (
        f"The interval is that of a Poisson number, of machines from the same {len(resampled.healthy)} analyses. "
        "Nearly all alarms are due to slow changes that are not measured: without these (nothing measured, baseline of "
        f"{BASELINES[0]}), {few} machines raise {alarms} in {records:,} records where one in {RATES[0]:,.0f} is stated."
    )
    return "\n".join([words, *table(("baseline", "measured", *counts), rows), note])


# ---- faults that grow ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Detected:
    """First alarms after the onset of machines with a growing fault.

    Sizes in mm and records since the onset, infinite without an alarm, and the component that it names.
    """

    sizes_mm: Array
    delays: Array
    named: tuple[str, ...] = ()

    def __str__(self) -> str:
        share = np.isfinite(self.sizes_mm).mean()
        if share < 0.5:  # noqa: PLR2004
            return f"none ({share:.0%})"
        return f"{np.median(self.sizes_mm):.2g} mm, {np.median(self.delays):.0f} ({share:.0%})"


def first_alarms(first: Sequence[int], grown: Array, named: Sequence[str] = ()) -> Detected:
    """Return the alarms of machines from their first alarmed records; one before the onset leaves a machine out."""
    kept = [(number - ONSET, name) for number, name in zip_longest(first, named, fillvalue="") if number >= ONSET]
    since = np.array([number for number, _ in kept], dtype=np.int64)
    sizes_mm, there = np.append(grown, np.inf)[since], since < grown.size
    return Detected(
        sizes_mm=sizes_mm,
        delays=np.where(there, since, np.inf),
        named=tuple(name for (_, name), raised in zip(kept, there, strict=True) if raised),
    )


def monitored(found: Analyses, series: Array, diagnosed: Sequence[tuple[str, ...]]) -> tuple[int, str]:
    """Return the first record after the baseline that raises an alarm, and its component; `WATCHED` without one."""
    state, baseline = (
        MachineState(machine="mill", settings=MonitorSettings(baseline_records=BASELINES[0])),
        BASELINES[0],
    )
    for number, (values, names) in enumerate(zip(series, diagnosed, strict=True)):
        known, when = np.isfinite(values), (DAY + timedelta(days=number)).isoformat()
        numbers = Numbers(keys=shared(tuple(compress(found.series, known))), values=values[known])
        seen = Observation(machine="mill", record=str(number), recorded_at=when, values=numbers, diagnosed=names)
        if (alarms := update(state, seen).alarms) and number >= baseline:
            return number - baseline, str(alarms[0]["component"])
    return WATCHED, ""


def verdicts(found: Analyses, name: str, grown: Array, rng: np.random.Generator) -> list[tuple[str, ...]]:
    """Return what verdicts name in each record of a machine: those of a healthy one, or of one of the nearest sizes."""
    healthy, those = np.flatnonzero(found.kinds == "healthy"), np.flatnonzero(found.kinds == name)
    those = those[np.argsort(found.severity_mm[those])]
    nearest = np.abs(np.log(grown)[:, None] - np.log(found.severity_mm[those])).argmin(axis=1)
    near = those[np.clip(nearest + rng.integers(-1, 2, size=grown.size), 0, those.size - 1)]
    return [found.diagnosed[i] for i in (*rng.choice(healthy, BASELINES[0] + ONSET), *near)]


def credit(named: str, part: str) -> float:
    """Return 1 if an alarm names a part or its mesh, 1 / n if it names n that cannot be told apart, it among them."""
    parts = component_parts(named)[1:] or (named,)
    return (part in parts or part.partition("/")[0] in parts) / len(parts)


def single(series: tuple[Series, ...], indicator: str) -> Layout:
    """Return the layout of one indicator of the raw signal, each channel by itself."""
    those = [i for i, key in enumerate(series) if key.component == "record" and key.indicator == indicator]
    return Layout(components=tuple((np.array([i]),) for i in those), powers=np.zeros(len(series)))


def growing_faults(found: Analyses, resampled: Resampled) -> str:
    """Return when growing faults are detected, and whether the part is right; by RMS at the same run length, too."""
    baseline, rms = BASELINES[0], single(found.series, "rms")
    fleet = partial(healthy_fleet, resampled, found, machines=HEALTHY, baseline=baseline, seed=7)
    alarms, records, *_ = run_lengths(fleet(layout_of(found.series)[2])[0][1])
    every = records / max(alarms, 1)
    factor = at_rate(fleet(rms)[1][1], every)
    courses, right, rows = fault_courses(found), [], []
    for number, (name, _, part, *_) in enumerate(SIZES):
        course, rng = courses[name], np.random.default_rng([6, number])
        grown = np.geomspace(course[0][0], course[0][-1], WATCHED - ONSET)
        machines = resampled.machines(FAILING, baseline + WATCHED, rng)
        machines.series[:, baseline + ONSET :] += added(course, grown)
        (seen,) = watch(machines, baseline, RATES[1:], rms, prior_of(found.series, rms, found.levels))
        raised = (two_of_three(seen.index) >= factor).any(axis=2)
        by_rms = first_alarms(np.where(raised.any(axis=1), raised.argmax(axis=1), WATCHED).tolist(), grown)
        watched = [monitored(found, one + found.levels, verdicts(found, name, grown, rng)) for one in machines.series]
        by_all = first_alarms([first for first, _ in watched], grown, [one for _, one in watched])
        right.append([credit(one, part) for one in by_all.named])
        wrong = Counter(one for one in by_all.named if not credit(one, part)).most_common(2)
        share = f"{sum(right[-1]):.3g} of {len(right[-1])}"
        others = ", ".join(f"{one} ({count})" for one, count in wrong)
        rows.append((name, part, f"{grown[0]:.2g} to {grown[-1]:.2g}", by_all, by_rms, share, others))
        print(*rows[-1], flush=True)  # noqa: T201
    shares = [np.mean(one) for one in right if len(one) * 2 >= FAILING]
    words = (
        f"{FAILING} machines of each fault. Exponential growth over {WATCHED - ONSET} records from the smallest to the "
        f"largest size analysed, after a baseline of {baseline} records and {ONSET} healthy ones. All components and "
        "sensors with verdicts, as monitored, against the EWMAs of RMS, whose limits are those at which "
        f"{HEALTHY} healthy machines raise as many alarms: one in {every:,.0f} records (times {factor:.2f}). "
        "Median size and median delay since onset, in records, at the first alarm, and share of machines with one. "
        "The part is right if the alarm names it or its mesh, by 1/n if it names n that cannot be told apart; averaged "
        f"over kinds of which half of the machines raise one, {np.mean(shares):.0%} of the alarms name the right "
        "part.\n"
    )
    head = ("fault", "component", "sizes, mm", "all, with verdicts", "RMS", "right part", "wrong parts")
    none = "`none`: half of the machines raise no alarm before the largest size."
    return "\n".join([words, *table(head, rows), none])


# ---- forecasts -------------------------------------------------------------------------------------------------------


def forecasts() -> str:
    """Return how often the true time lies in the interval of a forecast, for each law of growth."""
    rows = []
    for law in LAWS:
        inside, width, remains = coverage(law, FORECASTS)
        shares = f"{inside.size / FORECASTS:.0%}", f"{inside.mean():.0%}"
        rows.append((law, *shares, f"{np.median(width):.0f}", f"{np.median(remains):.0f}"))
    head = ("growth", "given", "90% intervals hold", "median width, records", "median remaining time")
    return "\n".join(table(head, rows))


# ---- the page --------------------------------------------------------------------------------------------------------


INTRO = """# Fleet: alarms of healthy and failing machines

Made by `python benchmarks/fleet.py ANALYSES`, or section by section with `--only`.

**Fleets** are resampled from analyses of one gearbox: each series of indicators is the sum of its mean, its slopes on
gain, noise, temperature and load, which are correlated as in `data_synth.scene.machine_history` (over 5 and 50 records,
with a season of 365), and a residual drawn jointly for all series. Slopes and residuals are about the mean of each
machine analysed. A slope due only to the error of its fit would add drift that is not there, so slopes are shrunk by
twice their standard errors (nonnegative garrote; Breiman 1995). Temperature and load are measured where a table says
so, with an error of a tenth of their standard deviations.

**The prior** (`hums/fleet/prior.json`) contains standard deviations of indicators, and the limits at which healthy
machines with baselines of 2 to 1,000 records raise the stated number of alarms, for bearing evidence and for all other
scores; they come from a simulated model of such scores, learned from other analyses. The healthy fleets below are
resampled from healthy records of {machines} machines of one gearbox and plan. What a fault adds to each series is the
running mean of five records of successive sizes about the healthy mean of the same machine, shrunk as slopes are.
Nothing is tuned to measured records.
"""


def pronostia(given: argparse.Namespace) -> str:
    """Return when bearings that ran to failure raised their alarms."""
    rows = []
    for path in sorted((Path(given.data) / "pronostia").glob("*.npz")):
        count, first, what, stands = run_to_failure(path)
        rows.append((path.stem, count, f"{first:.2f}", what, "yes" if stands else "no"))
    head = ("run", "snapshots", "first alarm, share of life", "indicators", "active at the end")
    words = "Baseline: the first tenth of each run; indicators of single snapshots of 0.1 s.\n"
    return "\n".join([words, *table(head, rows)])


def wind_turbine(given: argparse.Namespace) -> str:
    """Return the health of a wind turbine's gearbox in its last two records."""
    rows = (
        (when[:10], f"{index:.2f}", change, component, alarm or "no")
        for when, index, change, component, alarm in turbine(Path(given.data) / "wt_hss_bearing")
    )
    words = "Four records, with the first two as baseline, the second of which is already diagnosed.\n"
    return "\n".join([words, *table(("recorded", "condition index", "deviation", "component", "alarm"), rows)])


def cost(given: argparse.Namespace) -> str:
    """Return what a fleet costs."""
    rows = table(("case", "measured", "target"), cost_rows(given.analyses, records=TIMED))
    load = (
        f"The load average of the last fifteen minutes was {os.getloadavg()[2]:.1f} on {os.cpu_count()} CPUs; this "
        "script adds up to 2. What exceeds the number of CPUs lengthens elapsed times in proportion."
    )
    return "\n".join([*rows, load])


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("analyses", type=Path)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "docs" / "benchmarks")
    parser.add_argument("--data", type=Path, default=os.environ.get("HUMS_REAL_DATA"))
    parser.add_argument("--only", choices=("alarms", "faults", "forecasts", "pronostia", "turbine", "cost"))
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_intermixed_args()
    page = given.folder / "fleet.md"
    text = page.read_text(encoding="utf-8") if given.only else ""
    intro, *there = text.split("\n## ")
    written = {section.partition("\n")[0]: section.partition("\n")[2].strip() for section in there}
    if given.only in (None, "alarms", "faults"):
        found = analyses(given.analyses, workers=given.workers)
        intro = INTRO.format(machines=MACHINES)
    sections: dict[str, tuple[str, Callable[[], str]]] = {
        "alarms": ("False alarms of healthy machines", lambda: false_alarms(found, found.healthy)),
        "faults": ("Growing faults", lambda: growing_faults(found, found.healthy)),
        "forecasts": ("Time until a limit", forecasts),
    }
    if given.data:
        sections |= {
            "pronostia": ("PRONOSTIA", lambda: pronostia(given)),
            "turbine": ("Wind turbine", lambda: wind_turbine(given)),
        }
    sections["cost"] = ("Cost", lambda: cost(given))
    for name, (title, make) in sections.items():
        if given.only in (None, name):
            written[title] = make().strip()
    parts = [intro.strip(), *(f"## {title}\n\n{section}" for title, section in written.items())]
    page.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
