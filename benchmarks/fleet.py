"""Alarms of healthy and failing fleets: python benchmarks/fleet.py ANALYSES [FOLDER] [--data DATA] [--learn-prior].

Writes fleet.md into FOLDER (default docs/benchmarks). ANALYSES is a folder that keeps what takes long: a dataset of one
gearbox, healthy and with five faults of all sizes, and its analyses by `hums.analyze_fleet`; it is made where it is
missing. Fleets are made from it by resampling (`Resampled`). --learn-prior writes what is usual over healthy machines
into hums/fleet/prior.json, from resampled machines of another seed. --data, or the environment variable HUMS_REAL_DATA,
names the folder of measured records.
"""

import argparse
import gzip
import json
import os
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data_synth import make_dataset
from data_synth.plan import parse_plan
from data_synth.scene.history import History
from hums import open_dataset
from hums.fleet.fleet import analyze_fleet
from hums.fleet.prior import PRIOR_NAME, healthy_scores, prior_of
from hums.fleet.series import Series, layout_of, series_of, vector
from hums.jobs import Processes
from signals.monitoring.alarm_life import AlarmRule
from signals.monitoring.autocorrelation import Correlation, variance_shares
from signals.monitoring.health import Layout, Normal, Prior, learn_normal
from signals.monitoring.limits import ChartLimits, chart_limits

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
STATES = ("gain_db", "noise_db", "temperature_k", "load")
FAULTS = ("crack", "spall", "eccentricity", "inner race", "outer race")
RECORDS = 240
CHUNK = 100  # machines whose series are in memory at a time
BASELINES = (30, 300)
RATES = (1_000.0, 10_000.0)
WATCHED = 300

PLAN = """
scene = "healthy-mill"
records = {records}
seed = 1
sampling = "sobol"
history = {{ machines = 8 }}
[change]
rate_hz = 20000
duration_s = 2
speed = {{ link = "input", rpm = 1200 }}
torque = {{ link = "output", nm = [[-1, 500], [0, 400]] }}
resonance = {{ frequency_hz = 5000, damping_ratio = 0.03 }}
[change.imperfections]
gears = {{}}
imbalance = {{}}
bearings = {{}}
electrical = {{ inverter = {{}}, tachometer = {{}} }}
neighbour = {{}}
noise = {{}}
temperature = {{}}
[[change.sensor]]
name = "input vertical"
on = "input bearing"
direction = [0, 0, 1]
units = "g"
[[change.sensor]]
name = "intermediate vertical"
on = "intermediate bearing"
direction = [0, 0, 1]
units = "g"
[[class]]
name = "healthy"
share = 7
"""
FAULT = """
[[class]]
name = "{name}"
[[class.change.fault]]
kind = "{kind}"
component = "{component}"
{size} = {{ log = [{least}, 3], label = "severity_mm" }}
"""
SIZES = (
    ("crack", "tooth_crack", "stage 1/pinion", "depth_mm", 0.1),
    ("spall", "spall", "stage 2/output", "size_mm", 0.1),
    ("eccentricity", "eccentricity", "stage 1/intermediate", "size_mm", 0.02),
    ("inner race", "inner_race", "intermediate bearing", "size_mm", 0.1),
    ("outer race", "outer_race", "input bearing", "size_mm", 0.1),
)


# ---- analyses --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Analyses:
    """Logarithms of the indicators of all records (records, series), their classes, severities and states."""

    series: tuple[Series, ...]
    values: Array
    kinds: NDArray[np.str_]
    severity_mm: Array
    states: Array
    diagnosed: NDArray[np.bool_]


def analyses(folder: Path, *, workers: int, records: int = RECORDS) -> Analyses:
    """Return the analyses in the folder; make what is missing."""
    text = PLAN.format(records=records)
    for name, kind, component, size, least in SIZES:
        text += FAULT.format(name=name, kind=kind, component=component, size=size, least=least)
    plan = parse_plan(text)
    make_dataset(plan, folder / "set", workers=Processes(count=workers), progress=True)
    analyze_fleet([folder / "set"], "two-stage", folder / "fleet", workers=Processes(count=workers), progress=True)
    paths = [folder / "fleet" / "records" / name for name in json.loads((folder / "fleet/records.json").read_text())]
    rows = [json.loads(gzip.decompress(path.read_bytes())) for path in paths]
    labels = open_dataset(folder / "set")
    found = [series_of(row) for row in rows]
    every = sorted(set().union(*found))
    values = np.array([vector(one, every) for one in found])
    kinds = labels["class"].to_numpy().astype(np.str_)
    kept = np.isfinite(values[kinds == "healthy"]).mean(axis=0) >= 0.9  # noqa: PLR2004
    return Analyses(
        series=tuple(key for key, keep in zip(every, kept, strict=True) if keep),
        values=values[:, kept],
        kinds=kinds,
        severity_mm=np.asarray(labels["severity_mm"].to_numpy(), dtype=np.float64),
        states=np.stack([labels[f"history.{name}"].to_numpy() for name in STATES], axis=1),
        diagnosed=np.array([any(word == "diagnosed" for _, _, word, *_ in row["findings"]) for row in rows]),
    )


# ---- fleets ----------------------------------------------------------------------------------------------------------


def standard_states(machines: int, records: int, rng: np.random.Generator, declared: History) -> Array:
    """Return states (machines, records, states) of variance 1 that carry over as a plan's history declares."""
    shape, share = (machines, len(STATES)), declared.season_share
    found = np.empty((machines, records, len(STATES)))
    decay = np.exp(-1 / np.array([declared.short_records, declared.long_records]))[:, None, None]
    parts, phase = rng.standard_normal((2, *shape)), rng.uniform(0, 2 * np.pi, shape)
    for number in range(records):
        season = np.sqrt(2 * share) * np.sin(2 * np.pi * number / declared.season_records + phase)
        found[:, number] = np.sqrt((1 - share) / 2) * parts.sum(axis=0) + season
        parts = decay * parts + np.sqrt(1 - decay**2) * rng.standard_normal((2, *shape))
    return found


@dataclass(frozen=True, kw_only=True)
class Resampled:
    """Series of long fleets from a few hundred analyses.

    A series is its mean, its slopes on the states that carry over (fitted to the healthy analyses), and a residual
    drawn from them: all series of a record together, so that they depend on each other as they do there. Residuals of
    machines are scaled by a factor of their own, log-normal with a deviation of 20 %.
    """

    healthy: Array
    states: Array

    @cached_property
    def _fit(self) -> tuple[Array, Array]:
        design = np.column_stack([np.ones(len(self.states)), self.standard])
        filled = np.where(np.isfinite(self.healthy), self.healthy, np.nanmedian(self.healthy, axis=0))
        found, *_ = np.linalg.lstsq(design, filled, rcond=None)
        left = self.healthy - design @ found
        return found[1:], left * np.sqrt(len(design) / (len(design) - design.shape[1]))

    @property
    def standard(self) -> Array:
        """States in the deviations that the history declares."""
        declared = History()
        stds = np.array([declared.gain_db, declared.noise_db, declared.temperature_k, declared.load_share])
        return self.states / stds

    def machines(self, count: int, records: int, rng: np.random.Generator) -> Array:
        """Return series (count, records, series) about their means."""
        slopes, left = self._fit
        states = standard_states(count, records, rng, History())
        drawn = left[rng.integers(len(left), size=(count, records))]
        spread = np.exp(0.2 * rng.standard_normal((count, 1, 1)))
        return np.asarray(states @ slopes + spread * drawn)


def fault_courses(found: Analyses, healthy: Array) -> dict[str, tuple[Array, Array]]:
    """Return, for each fault, sizes in mm and what it adds to every series there: a running mean over five sizes."""
    center = np.nanmean(healthy, axis=0)
    courses = {}
    for name in FAULTS:
        those = found.kinds == name
        order = np.argsort(found.severity_mm[those])
        shifts = np.nan_to_num((found.values[those] - center)[order])
        window = np.array([shifts[max(0, i - 2) : i + 3].mean(axis=0) for i in range(len(order))])
        courses[name] = (found.severity_mm[those][order], window)
    return courses


def added(course: tuple[Array, Array], size_mm: Array) -> Array:
    """Return what a fault of some sizes adds (records, series), nothing below the least size analysed."""
    sizes, shifts = course
    place = np.interp(np.log(size_mm), np.log(sizes), np.arange(sizes.size))
    low = np.minimum(place.astype(int), sizes.size - 2)
    mixed = shifts[low] + (place - low)[:, None] * (shifts[low + 1] - shifts[low])
    return np.where((size_mm >= sizes[0])[:, None], mixed, 0.0)


# ---- the chain on arrays ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Watched:
    """Alarms (machines, records, scores) raised, and the health index."""

    raised: NDArray[np.bool_]
    index: NDArray[np.float32]


def watch(series: Array, baseline: int, limits: ChartLimits, layout: Layout, prior: Prior) -> Watched:
    """Return the alarms of machines (machines, records, series), whose first records are the baseline."""
    machines, records = series.shape[:2]
    normal = learn_normal(series[:, :baseline], np.zeros((machines, baseline, 0)), layout, prior)
    rule, nothing, recent = AlarmRule(), np.zeros((machines, 0)), None
    charts, alarm = limits.charts.start((machines, layout.scores)), rule.start((machines, layout.scores))
    raised = np.zeros((machines, records - baseline, layout.scores), dtype=np.bool_)
    index = np.zeros(raised.shape, dtype=np.float32)
    for number in range(baseline, records):
        reading = normal.read(series[:, number], nothing, recent)
        recent = reading.recent
        charts = limits.charts.step(charts, reading.scores)
        index[:, number - baseline] = limits.index(charts)
        alarm, raised[:, number - baseline] = rule.step(alarm, index[:, number - baseline])
    return Watched(raised=raised, index=index)


def score_series(series: Array, baseline: int, layout: Layout, prior: Prior) -> tuple[Array, Normal]:
    """Return the scores (records, machines, scores) of machines against their baselines, and those."""
    machines, records = series.shape[:2]
    normal = learn_normal(series[:, :baseline], np.zeros((machines, baseline, 0)), layout, prior)
    nothing, recent, scores = np.zeros((machines, 0)), None, []
    for number in range(baseline, records):
        reading = normal.read(series[:, number], nothing, recent)
        recent = reading.recent
        scores.append(reading.scores)
    return np.array(scores), normal


# ---- the prior -------------------------------------------------------------------------------------------------------


def learn_prior(found: Analyses, resampled: Resampled) -> dict[str, object]:
    """Return what is usual over healthy machines: of twelve resampled ones with 2,000 records each."""
    rng = np.random.default_rng(11)
    series = resampled.machines(12, 2_000, rng)
    deviations: dict[str, list[float]] = {}
    for key, std in zip(found.series, np.median(np.nanstd(series, axis=1), axis=0), strict=True):
        deviations.setdefault(key.indicator, []).append(float(std))
    log_std = {name: round(float(np.median(stds)), 3) for name, stds in sorted(deviations.items())}
    _, _, layout = layout_of(found.series)
    usual = np.array([log_std[key.indicator] for key in found.series])
    loose = Prior(series=usual, score=1.0, level=0.1, dof=0.01)
    scores, normal = score_series(series, 1_000, layout, loose)
    components = len(layout.components)
    own = normal.score_scale.ravel()
    shares = [
        variance_shares(scores[:, machine, place], Correlation())
        for machine in range(scores.shape[1])
        for place in range(components + len(layout.channels))
    ]
    white = np.diff(scores[:, :, :components], axis=0).ravel() / np.sqrt(2)
    standard = scores[:, :, :components] - scores[:, :, :components].mean(axis=0)
    standard = standard / standard.std(axis=0)
    del white
    variances = own**2 / np.median(own) ** 2
    return {
        "what": "Usual over healthy machines: deviations of logarithms, and how scores depend on the records before.",
        "made_by": "python benchmarks/fleet.py ANALYSES --learn-prior",
        "log_std": log_std,
        "score_std": round(float(np.median(own)), 3),
        "level_std": round(float(np.median(normal.level_scale)), 3),
        "dof": round(float(min(2 / np.var(np.log(variances)), 50.0)), 1),
        "shares": [[round(float(x), 3) for x in row] for row in shares],
        "quantiles": [round(float(x), 3) for x in np.quantile(standard, np.linspace(0, 1, 201))],
    }


# ---- measurements ----------------------------------------------------------------------------------------------------


def healthy_fleet(
    resampled: Resampled, found: Analyses, *, machines: int, baseline: int, every: float, seed: int
) -> tuple[int, int, Array]:
    """Return alarms, machine records watched, and alarms by machine."""
    _, _, layout = layout_of(found.series)
    prior = prior_of(found.series)
    limits = chart_limits(baseline, every * layout.scores, healthy_scores())
    counts = []
    for start in range(0, machines, CHUNK):
        rng = np.random.default_rng([seed, start])
        series = resampled.machines(min(CHUNK, machines - start), baseline + WATCHED, rng)
        counts.append(watch(series, baseline, limits, layout, prior).raised.sum(axis=1))
    by_score = np.concatenate(counts)
    return int(by_score.sum()), machines * WATCHED, by_score


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("analyses", type=Path)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "docs" / "benchmarks")
    parser.add_argument("--data", type=Path, default=os.environ.get("HUMS_REAL_DATA"))
    parser.add_argument("--learn-prior", action="store_true")
    parser.add_argument("--machines", type=int, default=4_000)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    found = analyses(given.analyses, workers=given.workers)
    healthy = found.kinds == "healthy"
    resampled = Resampled(healthy=found.values[healthy], states=found.states[healthy])
    if given.learn_prior:
        text = json.dumps(learn_prior(found, resampled), indent=1)
        (ROOT / "hums" / "fleet" / PRIOR_NAME).write_text(text + "\n", encoding="utf-8")
        return
    for baseline in BASELINES:
        for every in RATES:
            begin = time.perf_counter()
            alarms, watched, by_score = healthy_fleet(
                resampled, found, machines=given.machines, baseline=baseline, every=every, seed=5
            )
            print(baseline, every, alarms, watched / every, by_score.sum(axis=0), time.perf_counter() - begin)  # noqa: T201


if __name__ == "__main__":
    main()
