"""Alarms of healthy and failing fleets: python benchmarks/fleet.py ANALYSES [FOLDER] [--data DATA] [--only SECTION].

Writes fleet.md into FOLDER (default docs/benchmarks), or one SECTION of it anew (--only cost). ANALYSES is a folder
that keeps what takes long: a dataset of one gearbox, healthy and with five faults of all sizes, and its analyses by
`hums.analyze_fleet`; it is made where it is missing, a record in 0.6 s of CPU. Fleets are made from it by resampling
(`fleet_analyses`); healthy machines are made of further analyses, of machines of another seed. --data, or the
environment variable HUMS_REAL_DATA, names the folder of measured records.
"""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from fleet_analyses import (
    RECORDS,
    UNSEEN_MACHINES,
    Analyses,
    Array,
    Resampled,
    added,
    analyses,
    fault_courses,
    unseen,
)
from fleet_chain import CHUNK, RATES, WATCHED, at_rate, largest, two_of_three, watch
from fleet_cost import cost_rows
from fleet_forecasts import LAWS, coverage
from fleet_measured import run_to_failure, turbine
from numpy.typing import NDArray

from hums.fleet.series import Series, layout_of, prior_of
from signals.monitoring.health import Layout

if TYPE_CHECKING:
    from collections.abc import Callable

ROOT = Path(__file__).resolve().parents[1]
BASELINES = (30, 300)
ONSET = 60  # healthy records between the baseline and the start of a fault
FAILING = 100  # machines of each fault
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
) -> tuple[list[Array], list[float]]:
    """Return the records until each machine's first alarm, for each of `RATES`, and factors that make the rate exact.

    Factors are on limits.
    """
    prior = prior_of(found.series, layout, found.levels)
    until: list[list[Array]] = [[] for _ in RATES]
    highest: list[list[NDArray[np.float32]]] = [[] for _ in RATES]
    for start in range(0, machines, CHUNK):
        rng = np.random.default_rng([seed, start])
        fleet = resampled.machines(min(CHUNK, machines - start), baseline + WATCHED, rng, measured)
        for place, one in enumerate(watch(fleet, baseline, RATES, layout, prior)):
            until[place].append(one.until_alarm)
            highest[place].append(largest(one.index, layout))
    factors = [at_rate(np.concatenate(those), every) for those, every in zip(highest, RATES, strict=True)]
    return [np.concatenate(those) for those in until], factors


def run_lengths(until: Array) -> tuple[int, int, float, float]:
    """Return alarms, records until them, and the 95 % interval of records per alarm, by drawing machines again.

    Half an alarm is added, so that none has a run length, too.
    """
    alarmed, records = np.isfinite(until), np.minimum(until, WATCHED)
    drawn = np.random.default_rng(16).integers(until.size, size=(4_000, until.size))
    low, high = np.quantile(records[drawn].sum(axis=1) / (alarmed[drawn].sum(axis=1) + 0.5), (0.025, 0.975))
    return int(alarmed.sum()), int(records.sum()), float(low), float(high)


def false_alarms(given: argparse.Namespace, found: Analyses, resampled: Resampled) -> str:
    """Return how many alarms healthy machines raise, and how many are stated."""
    _, _, layout = layout_of(found.series)
    words = (
        f"{given.machines} machines, {WATCHED} monitored records each; a tenth as many with temperature and load "
        "measured with each record. The stated run length is the mean number of records of a machine from a state "
        "without alarms to the first alarm of any of its components and sensors; what follows while that stands is not "
        "counted. It is measured as all records up to the first alarms over the number of these.\n"
    )
    text = [
        words,
        "| baseline, records | measured | stated: one in | alarms | in records | one in | 95% of that | within |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for baseline in BASELINES:
        for measured, machines in (((), given.machines), (MEASURED_STATES, given.machines // 10)):
            fleets, _ = healthy_fleet(
                resampled, found, layout, machines=machines, baseline=baseline, seed=5, measured=measured
            )
            for every, until in zip(RATES, fleets, strict=True):
                alarms, records, low, high = run_lengths(until)
                within = "yes" if low <= every <= high else "no, fewer" if low > every else "no"
                cells = (
                    baseline,
                    "temperature, load" if measured else "nothing",
                    f"{every:,.0f}",
                    alarms,
                    f"{records:,}",
                    f"{records / max(alarms, 1):,.0f}",
                    f"{low:,.0f} to {high:,.0f}",
                )
                text.append(f"| {' | '.join(map(str, cells))} | {within} |")
                sys.stdout.write(f"{text[-1]}\n")
                sys.stdout.flush()
    still, few = resampled.still(), given.machines // 40
    until = healthy_fleet(still, found, layout, machines=few, baseline=BASELINES[0], seed=5)[0][0]
    alarms, records, *_ = run_lengths(until)
    text.append(
        f"\nThe interval is over machines from the same {len(resampled.healthy)} analyses. Nearly all alarms are due "
        f"to slow changes that are not measured: without these (nothing measured, baseline of {BASELINES[0]}), {few} "
        f"machines raise {alarms} in {records:,} records where one in {RATES[0]:,.0f} is stated."
    )
    return "\n".join(text)


# ---- faults that grow ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Detected:
    """First alarms of machines with a growing fault: sizes in mm, records since the onset; infinite where none is."""

    sizes_mm: Array
    delays: Array

    def __str__(self) -> str:
        share = np.isfinite(self.sizes_mm).mean()
        if share < 0.5:  # noqa: PLR2004
            return f"none ({share:.0%})"
        return f"{np.median(self.sizes_mm):.2g} mm, {np.median(self.delays):.0f} ({share:.0%})"


def detected(
    resampled: Resampled,
    found: Analyses,
    name: str,
    course: tuple[Array, Array],
    layout: Layout,
    *,
    machines: int,
    factor: float,
) -> Detected:
    """Return when machines with a growing fault raise their first alarm, with limits wider by a factor.

    After a baseline of 30 records and 60 healthy ones the fault grows exponentially over 240 records, from the least to
    the largest size analysed. A machine with an alarm before that is left out. Verdicts, which the fused index alone
    takes in, are those of an analysed record of one of the three nearest sizes.
    """
    baseline, sizes = BASELINES[0], course[0]
    grown = np.geomspace(sizes[0], sizes[-1], WATCHED - ONSET)
    fleet = resampled.machines(machines, baseline + WATCHED, np.random.default_rng(6))
    fleet.series[:, baseline + ONSET :] += added(course, grown)
    (seen,) = watch(fleet, baseline, RATES[1:], layout, prior_of(found.series, layout, found.levels))
    raised = (two_of_three(seen.index) >= factor).any(axis=2)
    if np.any(layout.sizes > 1):
        raised[:, ONSET:] |= _by_verdicts(found, name, grown, machines)
    first = np.where(raised.any(axis=1), raised.argmax(axis=1), WATCHED)
    kept = first[first >= ONSET]
    there = kept < WATCHED
    return Detected(
        sizes_mm=np.where(there, np.append(grown, np.inf)[np.minimum(kept - ONSET, grown.size)], np.inf),
        delays=np.where(there, kept - ONSET, np.inf),
    )


def _by_verdicts(found: Analyses, name: str, grown: Array, machines: int) -> NDArray[np.bool_]:
    """Return where two of the latest three records (machines, records) are diagnosed, as `Epoch` takes them in."""
    those = np.flatnonzero(found.kinds == name)
    those = those[np.argsort(found.severity_mm[those])]
    nearest = np.abs(np.log(grown)[:, None] - np.log(found.severity_mm[those])).argmin(axis=1)
    jitter = np.random.default_rng(17).integers(-1, 2, size=(machines, grown.size))
    shown = found.diagnosed[those][np.clip(nearest + jitter, 0, those.size - 1)].astype(int)
    padded = np.pad(shown, ((0, 0), (2, 0)))
    return np.asarray((padded[:, 2:] == 1) & (padded[:, 2:] + padded[:, 1:-1] + padded[:, :-2] >= 2))  # noqa: PLR2004


def single(series: tuple[Series, ...], indicator: str) -> Layout:
    """Return the layout of one indicator of the raw signal, each channel by itself."""
    those = [i for i, key in enumerate(series) if key.component == "record" and key.indicator == indicator]
    return Layout(components=tuple((np.array([i]),) for i in those), powers=np.zeros(len(series)))


def diagnosed_size(found: Analyses, name: str) -> float:
    """Return the least size from which at least half of the larger ones are diagnosed from one record alone."""
    those = np.flatnonzero(found.kinds == name)
    those = those[np.argsort(found.severity_mm[those])]
    for number in range(len(those)):
        if found.diagnosed[those[number]] and found.diagnosed[those[number:]].mean() >= 0.5:  # noqa: PLR2004
            return float(found.severity_mm[those[number]])
    return math.inf


def usually_diagnosed_size(found: Analyses, name: str, *, among: int = 9) -> float:
    """Return the least size at which half of the records of about that size, nine, are diagnosed alone."""
    those = np.flatnonzero(found.kinds == name)
    those = those[np.argsort(found.severity_mm[those])]
    share = np.convolve(found.diagnosed[those], np.full(among, 1 / among), mode="valid")
    usual = np.flatnonzero(share >= 0.5)  # noqa: PLR2004
    return float(found.severity_mm[those[usual[0] + among // 2]]) if usual.size else math.inf


def growing_faults(given: argparse.Namespace, found: Analyses, resampled: Resampled) -> str:
    """Return when growing faults are detected, fused and by single indicators at the same measured run length."""
    _, _, fused = layout_of(found.series)
    layouts = (fused, single(found.series, "rms"), single(found.series, "kurtosis"))
    factors = [
        healthy_fleet(resampled, found, one, machines=given.machines, baseline=BASELINES[0], seed=7)[1][1]
        for one in layouts
    ]
    words = (
        f"Exponential growth over {WATCHED - ONSET} records from the smallest to the largest size analysed, after a "
        f"baseline of {BASELINES[0]} records and {ONSET} healthy ones. The limits of all three are scaled so that "
        f"{given.machines} healthy machines raise one alarm in 10,000 records, as counted (fused "
        f"{factors[0]:.2f}, RMS {factors[1]:.2f}, kurtosis {factors[2]:.2f}). Median size and median delay since "
        "onset, in records, at the first alarm, and share of machines with an alarm before the largest size.\n"
    )
    text = [
        words,
        "| fault | sizes, mm | fused, with verdicts | RMS | kurtosis | one diagnosed from | alarm before | half from |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, course in fault_courses(found, found.values[found.kinds == "healthy"]).items():
        seen = [
            detected(resampled, found, name, course, one, machines=min(given.machines, FAILING), factor=factor)
            for one, factor in zip(layouts, factors, strict=True)
        ]
        alone, size = diagnosed_size(found, name), float(np.median(seen[0].sizes_mm))
        before = "yes" if size < alone else "neither" if math.isinf(size) and math.isinf(alone) else "no"
        cells = [f"{course[0][0]:.2g} to {course[0][-1]:.2g}", *map(str, seen)]
        usual = usually_diagnosed_size(found, name)
        cells += [_mm(alone), before, _mm(usual)]
        text.append(f"| {name} | {' | '.join(cells)} |")
    text.append(
        "\n`none`: to the end, half of the machines raise no alarm, or half of the records are not diagnosed. One "
        "diagnosed from: the first size at which a record was diagnosed, if half of the larger ones were; this is "
        "the minimum of many. Half from: the size at which half of nine records of about that size are diagnosed."
    )
    return "\n".join(text)


def _mm(size: float) -> str:
    return "none" if math.isinf(size) else f"{size:.2g} mm"


# ---- forecasts -------------------------------------------------------------------------------------------------------


def forecasts(given: argparse.Namespace) -> str:
    """Return how often the true time lies in the interval of a forecast, for each law of growth."""
    text = [
        "| growth | given | 90% intervals hold | median width, records | median remaining time |",
        "|---|---|---|---|---|",
    ]
    for law in LAWS:
        inside, width, remains = coverage(law, given.forecasts)
        cells = f"{inside.size / given.forecasts:.0%} | {inside.mean():.0%} | {np.median(width):.0f}"
        text.append(f"| {law} | {cells} | {np.median(remains):.0f} |")
    return "\n".join(text)


# ---- the page --------------------------------------------------------------------------------------------------------


INTRO = """# Fleet: alarms of healthy and failing machines

Made by `python benchmarks/fleet.py ANALYSES`, or section by section with `--only`: alarms with `--machines 4000`,
faults with `--machines 1000`, forecasts with `--forecasts 300`, cost with `--run-records 1000`.

**Fleets** are resampled from analyses of one gearbox: each series of indicators is the sum of its mean, its slopes on
gain, noise, temperature and load, which are correlated as in `data_synth.scene.machine_history` (over 5 and 50 records,
with a season of 365), and a residual drawn jointly for all series. Slopes and residuals are about the mean of each
machine analysed. A slope due only to the error of its fit would add drift that is not there, so slopes are shrunk by
twice their standard errors (nonnegative garrote; Breiman 1995). Temperature and load are measured where a table says
so, with an error of a tenth of their standard deviations.

**The prior** (`hums/fleet/prior.json`) contains standard deviations of indicators, and the limits at which healthy
machines with baselines of 2 to 1,000 records raise the stated number of alarms, for bearing evidence and for all other
scores; they come from a simulated model of such scores. The healthy fleets below consist of analyses of
{unseen_machines} other machines with a separate seed, from which nothing is learned. All have the same gearbox and
plan. Nothing is tuned to measured records.
"""


def pronostia(given: argparse.Namespace) -> str:
    """Return when bearings that ran to failure raised their alarms."""
    text = [
        "Baseline: the first tenth of each run; indicators of single snapshots of 0.1 s.\n",
        "| run | snapshots | first alarm, share of life | indicators | active at the end |",
        "|---|---|---|---|---|",
    ]
    for path in sorted((Path(given.data) / "pronostia").glob("*.npz")):
        count, first, what, stands = run_to_failure(path)
        text.append(f"| {path.stem} | {count} | {first:.2f} | {what} | {'yes' if stands else 'no'} |")
    return "\n".join(text)


def wind_turbine(given: argparse.Namespace) -> str:
    """Return the health of a wind turbine's gearbox in its last two records."""
    text = [
        "Four records, with the first two as baseline, the second of which is already diagnosed.\n",
        "| recorded | largest condition index | deviation | component | alarm |",
    ]
    text += ["|---|---|---|---|---|"]
    for when, index, change, component, alarm in turbine(Path(given.data) / "wt_hss_bearing"):
        text.append(f"| {when[:10]} | {index:.2f} | {change} | {component} | {alarm or 'no'} |")
    return "\n".join(text)


def cost(given: argparse.Namespace) -> str:
    """Return what a fleet costs."""
    rows = cost_rows(given.analyses, records=given.run_records)
    return "\n".join(["| case | measured | target |", "|---|---|---|", *(f"| {' | '.join(row)} |" for row in rows)])


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("analyses", type=Path)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "docs" / "benchmarks")
    parser.add_argument("--data", type=Path, default=os.environ.get("HUMS_REAL_DATA"))
    parser.add_argument("--only", choices=("alarms", "faults", "forecasts", "pronostia", "turbine", "cost"))
    parser.add_argument("--machines", type=int, default=4_000)
    parser.add_argument("--records", type=int, default=RECORDS, help="of the dataset, where it is made")
    parser.add_argument("--forecasts", type=int, default=150)
    parser.add_argument("--run-records", type=int, default=100, help="of the whole run that is timed")
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_intermixed_args()
    page = given.folder / "fleet.md"
    text = page.read_text(encoding="utf-8") if given.only else ""
    intro, *there = text.split("\n## ")
    written = {section.partition("\n")[0]: section.partition("\n")[2].strip() for section in there}
    if given.only in (None, "alarms", "faults"):
        found = analyses(given.analyses, workers=given.workers, records=given.records)
        healthy = unseen(given.analyses, found.series, workers=given.workers)
        intro = INTRO.format(unseen_machines=UNSEEN_MACHINES)
    sections: dict[str, tuple[str, Callable[[], str]]] = {
        "alarms": ("False alarms of healthy machines", lambda: false_alarms(given, found, healthy)),
        "faults": ("Growing faults", lambda: growing_faults(given, found, healthy)),
        "forecasts": ("Time until a limit", lambda: forecasts(given)),
    }
    if given.data:
        sections |= {
            "pronostia": ("PRONOSTIA", lambda: pronostia(given)),
            "turbine": ("Wind turbine", lambda: wind_turbine(given)),
        }
    sections["cost"] = ("Cost", lambda: cost(given))
    for name, (title, make) in sections.items():
        if given.only in (None, name):
            written[title] = make()
    parts = [intro.strip(), *(f"## {title}\n\n{section}" for title, section in written.items())]
    page.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
