"""Alarms of healthy and failing fleets: python benchmarks/fleet.py ANALYSES [FOLDER] [--data DATA] [--learn-prior].

Writes fleet.md into FOLDER (default docs/benchmarks). ANALYSES is a folder that keeps what takes long: a dataset of one
gearbox, healthy and with five faults of all sizes, and its analyses by `hums.analyze_fleet`; it is made where it is
missing. Fleets are made from it by resampling (`Resampled`). --learn-prior writes what is usual over healthy machines
into hums/fleet/prior.json, from the analyses of every other machine; the page is measured on those of the others.
--data, or the environment variable HUMS_REAL_DATA, names the folder of measured records.
"""

import argparse
import gzip
import json
import math
import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_synth import make_dataset
from data_synth.plan import parse_plan
from data_synth.scene.history import History
from hums import AnalysisSettings, NominalSpeed, analyze, load_gearbox, make_record, open_dataset
from hums.fleet.fleet import _tables, analyze_fleet
from hums.fleet.monitor import MachineState, MonitorSettings, update
from hums.fleet.observation import Observation, observation
from hums.fleet.prior import PRIOR_NAME, healthy_scores, prior_of
from hums.fleet.results import results
from hums.fleet.series import Series, layout_of, series_of, vector
from hums.gearbox.orders import BEARING_KINDS
from hums.jobs import Processes
from hums.readers import convert
from signals.monitoring.alarm_life import AlarmRule, Life
from signals.monitoring.autocorrelation import Correlation, variance_shares
from signals.monitoring.forecast import local_trend, time_until
from signals.monitoring.health import Layout, Normal, Prior, learn_normal
from signals.monitoring.limits import ChartLimits, chart_limits, tail_quantiles

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
STATES = ("gain_db", "noise_db", "temperature_k", "load")
FAULTS = ("crack", "spall", "eccentricity", "inner race", "outer race")
RECORDS, MACHINES = 480, 8
CHUNK = 100  # machines whose series are in memory at a time
BASELINES = (30, 300)
RATES = (1_000.0, 10_000.0)
WATCHED = 300
MOST_DOF = 10.0  # real machines differ more than resampled ones: deviations by 22 % (our choice)

PLAN = """
scene = "healthy-mill"
records = {records}
seed = 1
sampling = "sobol"
history = {{ machines = {machines} }}
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

    def resampled(self, half: int, *, without: int | None = None, only: int | None = None) -> "Resampled":
        """Return the fleets of the healthy records of every other machine: half 0 is learned from, 1 measured on.

        Without one of its machines, or with residuals of one only.
        """
        machine = np.arange(self.kinds.size) % MACHINES  # records take turns
        those = (self.kinds == "healthy") & (machine % 2 == half) & (machine != without)
        drawn = machine[those] == only if only is not None else np.ones(those.sum(), dtype=np.bool_)
        return Resampled(healthy=self.values[those], states=self.states[those], drawn=drawn)


def analyses(folder: Path, *, workers: int, records: int = RECORDS) -> Analyses:
    """Return the analyses in the folder; make what is missing."""
    text = PLAN.format(records=records, machines=MACHINES)
    for name, kind, component, size, least in SIZES:
        text += FAULT.format(name=name, kind=kind, component=component, size=size, least=least)
    plan = parse_plan(text)
    make_dataset(plan, folder / "set", workers=Processes(count=workers), progress=True)
    analyze_fleet([folder / "set"], "two-stage", folder / "fleet", workers=Processes(count=workers), progress=True)
    paths = [folder / "fleet" / "records" / name for name in json.loads((folder / "fleet/records.json").read_text())]
    rows = [json.loads(gzip.decompress(path.read_bytes())) for path in paths]
    labels = open_dataset(folder / "set")
    found = [series_of(row) for row in rows]
    every = tuple(sorted(set().union(*found)))
    values = np.array([vector(one, every) for one in found])
    kinds = labels["class"].to_numpy().astype(np.str_)
    kept = np.isfinite(values[kinds == "healthy"]).mean(axis=0) >= 0.9  # noqa: PLR2004
    return Analyses(
        series=tuple(key for key, keep in zip(every, kept, strict=True) if keep),
        values=values[:, kept],
        kinds=kinds,
        severity_mm=np.asarray(labels["severity_mm"].to_numpy(), dtype=np.float64),
        states=np.stack([labels[f"history.{name}"].to_numpy() for name in STATES], axis=1),
        diagnosed=np.array([_diagnosed(row, str(kind)) for row, kind in zip(rows, kinds, strict=True)]),
    )


def _diagnosed(row: dict[str, Any], name: str) -> bool:
    """Return whether the fault of a record's class is diagnosed: that kind of defect, of that component."""
    parts = {fault: (component, kind) for fault, kind, component, *_ in SIZES}
    component, kind = parts.get(name, ("", ""))
    kind = kind if kind in BEARING_KINDS else "tooth"
    return any((one, of, word) == (component, kind, "diagnosed") for one, of, word, *_ in row["findings"])


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
    machines are scaled by a factor of their own, log-normal with a deviation of 20 %. Residuals are those
    of the records ``drawn``.
    """

    healthy: Array
    states: Array
    drawn: NDArray[np.bool_]

    @cached_property
    def _fit(self) -> tuple[Array, Array]:
        design = np.column_stack([np.ones(len(self.states)), self.standard])
        filled = np.where(np.isfinite(self.healthy), self.healthy, np.nanmedian(self.healthy, axis=0))
        found, *_ = np.linalg.lstsq(design, filled, rcond=None)
        left = self.healthy - design @ found
        return found[1:], left[self.drawn] * np.sqrt(len(design) / (len(design) - design.shape[1]))

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


def watch(
    series: Array, baseline: int, limits: Sequence[ChartLimits], layout: Layout, prior: Prior
) -> tuple[Watched, ...]:
    """Return, for each of the limits, alarms of machines (machines, records, series), whose first are a baseline."""
    machines, records = series.shape[:2]
    normal = learn_normal(series[:, :baseline], np.zeros((machines, baseline, 0)), layout, prior)
    rule, nothing, recent = AlarmRule(), np.zeros((machines, 0)), None
    own = np.array([normal.read(series[:, number], nothing).scores for number in range(baseline)])
    headrooms = [one.headroom(own, rule) for one in limits]
    charts = [one.charts.start((machines, layout.scores)) for one in limits]
    alarms = [rule.start((machines, layout.scores)) for _ in limits]
    shape = (machines, records - baseline, layout.scores)
    found = tuple(Watched(raised=np.zeros(shape, np.bool_), index=np.zeros(shape, np.float32)) for _ in limits)
    for number in range(baseline, records):
        reading = normal.read(series[:, number], nothing, recent)
        recent = reading.recent
        for place, (one, seen) in enumerate(zip(limits, found, strict=True)):
            charts[place] = one.charts.step(charts[place], reading.scores)
            index = one.index(charts[place]) / headrooms[place]
            alarms[place], seen.raised[:, number - baseline] = rule.step(alarms[place], index)
            seen.index[:, number - baseline] = index
    return found


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
    own, sizes = normal.score_scale, layout.sizes
    power, offset = np.polyfit(np.log(sizes), np.log(np.median(own, axis=0)), 1)
    left = np.log(own) - offset - power * np.log(sizes)
    standard = (scores - scores.mean(axis=0)) / scores.std(axis=0)
    machines, places = range(scores.shape[1]), range(scores.shape[2])
    shares = [
        np.mean([variance_shares(scores[:, machine, place], Correlation()) for machine in machines], axis=0)
        for place in places
    ]
    quantiles = [tail_quantiles(standard[:, :, place].ravel()) for place in places]
    return {
        "what": "Usual over healthy machines: deviations of logarithms, and how scores depend on the records before.",
        "made_by": "python benchmarks/fleet.py ANALYSES --learn-prior",
        "log_std": log_std,
        "score_std": round(float(np.exp(offset)), 3),
        "score_power": round(float(power), 3),
        "level_std": round(float(np.median(normal.level_scale)), 3),
        "dof": round(float(np.clip(1 / (2 * np.mean(left**2)), 2, MOST_DOF)), 1),  # log s has the variance 1 / (2 dof)
        "shares": [[round(float(x), 3) for x in row] for row in shares],
        "quantiles": [[round(float(x), 2) for x in row] for row in quantiles],
        "widening": [],
    }


def widening(found: Analyses, *, machines: int) -> list[list[float]]:
    """Return by how much limits have to be wider than the model's for each rate, on machines it was not learned on.

    Each machine of the half that the prior is learned on is left out in turn: a prior of the others makes the limits of
    fleets with its residuals, and the factor is the one at which all fleets together raise the stated number of alarms.
    What a prior lacks of a machine that it has not seen is then in the limits (cross-validation; Stone 1974, J. R.
    Stat. Soc. B 36(2), 111-147).
    """
    _, _, layout = layout_of(found.series)
    folds = range(0, MACHINES, 2)
    sizes = {2: 2 * machines, 10: 2 * machines, 30: 2 * machines, 300: machines}  # by their cost
    peaks: dict[tuple[int, float], list[Array]] = {}
    for left in folds:
        learned = learn_prior(found, found.resampled(0, without=left))
        prior, model = prior_of(found.series, layout, learned), healthy_scores(learned)
        unseen = found.resampled(0, only=left)
        for baseline, count in sizes.items():
            limits = [chart_limits(baseline, rate * layout.scores, model) for rate in RATES]
            for start in range(0, count // len(folds), CHUNK):
                rng = np.random.default_rng([12, left, start])
                seen = watch(unseen.machines(CHUNK, baseline + WATCHED, rng), baseline, limits, layout, prior)
                for rate, one in zip(RATES, seen, strict=True):
                    three = np.sort(np.stack([one.index[:, 2:], one.index[:, 1:-1], one.index[:, :-2]]), axis=0)
                    peak = np.minimum(three[1], one.index[:, 2:]).max(axis=1)  # two of three, the last one of them
                    peaks.setdefault((baseline, rate), []).append(peak.ravel())
    factors = []
    for (baseline, rate), those in peaks.items():
        largest = np.sort(np.concatenate(those))[::-1]
        watched = largest.size // layout.scores * WATCHED
        factors.append([baseline, rate * layout.scores, round(float(largest[round(watched / rate)]), 3)])
    return factors


# ---- measurements ----------------------------------------------------------------------------------------------------


def healthy_fleet(
    resampled: Resampled, found: Analyses, *, machines: int, baseline: int, seed: int
) -> tuple[Array, ...]:
    """Return the alarms of each machine, for each of `RATES`."""
    _, _, layout = layout_of(found.series)
    prior = prior_of(found.series, layout)
    limits = [chart_limits(baseline, every * layout.scores, healthy_scores()) for every in RATES]
    counts = []
    for start in range(0, machines, CHUNK):
        rng = np.random.default_rng([seed, start])
        series = resampled.machines(min(CHUNK, machines - start), baseline + WATCHED, rng)
        counts.append([one.raised.sum(axis=(1, 2)) for one in watch(series, baseline, limits, layout, prior)])
    return tuple(np.concatenate(those) for those in zip(*counts, strict=True))


def bootstrapped(by_machine: Array) -> tuple[float, float]:
    """Return the 95 % interval of the number of alarms of as many machines, by drawing them again."""
    rng = np.random.default_rng(16)
    sums = [by_machine[rng.integers(by_machine.size, size=by_machine.size)].sum() for _ in range(4_000)]
    low, high = np.quantile(sums, (0.025, 0.975))
    return float(low), float(high)


def severities(
    resampled: Resampled, found: Analyses, name: str, course: tuple[Array, Array], layout: Layout, *, machines: int
) -> Array:
    """Return the size in mm of a growing fault when each machine raises its first alarm, infinite where none is.

    After a baseline of 30 records and 60 healthy ones the fault grows exponentially over 240 records, from the least to
    the largest size analysed. A machine with an alarm before that is left out. Verdicts, which the fused index alone
    takes in, are those of an analysed record of one of the three nearest sizes.
    """
    baseline, sizes = BASELINES[0], course[0]
    limits = chart_limits(baseline, RATES[1] * layout.scores, healthy_scores())
    grown = np.geomspace(sizes[0], sizes[-1], WATCHED - 60)
    series = resampled.machines(machines, baseline + WATCHED, np.random.default_rng(6))
    series[:, baseline + 60 :] += added(course, grown)
    (seen,) = watch(series, baseline, (limits,), layout, prior_of(found.series, layout))
    raised = seen.raised.any(axis=2)
    if np.any(layout.sizes > 1):
        raised[:, 60:] |= _by_verdicts(found, name, grown, machines)
    first = np.where(raised.any(axis=1), raised.argmax(axis=1), WATCHED)
    kept = first[first >= 60]  # noqa: PLR2004
    return np.where(kept < WATCHED, np.append(grown, np.inf)[np.minimum(kept - 60, grown.size)], np.inf)


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


def coverage(count: int) -> tuple[float, float, float, float]:
    """Return the share of forecasts given, of those the share that hold, and their median width and time that remains.

    Scores grow linearly, exponentially, with the square of time and, which the model lacks, by steps; a forecast is
    made at a time drawn between 40 and 80 % of the way to the limit.
    """
    rng = np.random.default_rng(8)
    given, inside, widths, remaining = 0, 0, [], []
    for number in range(count):
        total = int(rng.integers(60, 200))
        time_ = np.arange(total + 1) / total
        rate = rng.uniform(2, 5)
        laws = (time_, np.expm1(rate * time_) / np.expm1(rate), time_**2, np.floor(time_ * 6) / 6)
        level = 10 * laws[number % len(laws)]
        now = int(total * rng.uniform(0.4, 0.8))
        seen = level[:now] + rng.standard_normal(now)
        found = time_until(10.0, local_trend(seen, np.arange(now, dtype=float)), span=float(now), seed=number)
        if found.reason:
            continue
        true = float(np.flatnonzero(level >= 10.0 - 1e-9)[0] - (now - 1))
        given += 1
        inside += found.low <= true <= found.high
        widths.append(found.high - found.low)
        remaining.append(true)
    return given / count, inside / max(given, 1), float(np.median(widths)), float(np.median(remaining))


# ---- PRONOSTIA -------------------------------------------------------------------------------------------------------


BANDS_HZ = ((20, 500), (500, 2_000), (2_000, 5_000), (5_000, 12_800))
RATE_HZ = 25_600.0
DAY = datetime(2020, 1, 1, tzinfo=UTC)  # of the first snapshot; one every 10 s


def snapshot(accelerations: Array) -> dict[Series, float]:
    """Return logarithms of plain indicators of a snapshot (2, samples) in g."""
    found = {}
    for channel, raw in zip(("horizontal", "vertical"), accelerations, strict=True):
        x = raw - raw.mean()
        rms, lines = x.std(), np.fft.rfft(x)
        hz = np.fft.rfftfreq(x.size, 1 / RATE_HZ)
        numbers = {
            ("rms", "g"): rms,
            ("peak", "g"): np.abs(x).max(),
            ("kurtosis", "1"): np.mean(x**4) / rms**4,
            ("crest_factor", "1"): np.abs(x).max() / rms,
        }
        for low, high in BANDS_HZ:
            inside = (hz >= low) & (hz < high)
            analytic = np.zeros(x.size, dtype=complex)
            analytic[: hz.size] = np.where(inside, 2 * lines, 0)
            envelope = np.abs(np.fft.ifft(analytic))
            numbers[f"rms {low} to {high} Hz", "g"] = np.sqrt(np.mean(envelope**2) / 2)
            numbers[f"envelope variation {low} to {high} Hz", "1"] = envelope.std() / envelope.mean()
        for (name, unit), value in numbers.items():
            key = Series(channel=channel, component="record", kind="channel", indicator=name, unit=unit)
            found[key] = float(np.log(value))
    return found


def run_to_failure(path: Path) -> tuple[int, float, str, bool]:
    """Return snapshots, share of life at the first alarm of a component, its indicators, and whether it stands."""
    with np.load(path) as kept:
        runs = kept["milli_g"] / 1000.0
        times = [(DAY + timedelta(seconds=10.0 * float(number))).isoformat() for number in kept["snapshot"]]
    settings = MonitorSettings(baseline_records=max(10, len(runs) // 10))
    state, first, what = MachineState(machine=path.stem, settings=settings), math.inf, ""
    for number, accelerations in enumerate(runs):
        seen = Observation(
            machine=path.stem, record=str(number), recorded_at=times[number], values=snapshot(accelerations)
        )
        for alarm in update(state, seen).alarms:
            if not alarm["component"].startswith("sensor") and not what:
                first, what = number / len(runs), alarm["indicator"]
    return len(runs), first, what, any(alarm["state"] == "raised" for alarm in state.open.values())


# ---- the wind turbine ------------------------------------------------------------------------------------------------


def turbine(folder: Path) -> Iterator[tuple[str, float, str, bool]]:
    """Yield time, largest health index, its component, and whether it has an alarm, of a turbine's later records."""
    gearbox = load_gearbox(ROOT / "tests" / "data" / "wind-turbine.toml")
    state = MachineState(machine="turbine", settings=MonitorSettings(baseline_records=2))
    for path in sorted(folder.glob("*.mat")):
        when = datetime.strptime(path.stem, "data-%Y%m%dT%H%M%SZ").replace(tzinfo=UTC).isoformat()
        record = convert(
            path,
            channels=["vibration"],
            rate_hz=97_656,
            units="g",
            tach_times="tach",
            pulses_per_rev=2,
            shaft="high speed shaft",
        )
        analysis = analyze(record, gearbox, settings=AnalysisSettings(most_tracks=0))
        row = results(analysis) | {"record": path.stem, "machine": "turbine", "recorded_at": when}
        found = update(state, observation(row))
        if found.judged:
            worst = max(found.index, key=lambda name: found.index[name])
            yield when, found.index[worst], worst, state.alarms[worst].life == Life.RAISED


# ---- cost ------------------------------------------------------------------------------------------------------------


def table_seconds(folder: Path, *, machines: int = 20, records: int = 500) -> float:
    """Return the CPU seconds for all tables, alarms and the page of machines with daily records."""
    names = json.loads((folder / "fleet/records.json").read_text())
    rows = [json.loads(gzip.decompress((folder / "fleet/records" / name).read_bytes())) for name in names]
    rng, room = np.random.default_rng(14), Path(tempfile.mkdtemp())
    paths = []
    for machine in range(machines):
        for day, chosen in enumerate(rng.integers(len(rows), size=records)):
            named = {"record": f"{machine}/{day}.h5", "machine": f"mill {machine}"}
            row = rows[chosen] | named | {"recorded_at": (DAY + timedelta(days=day)).isoformat()}
            paths.append(room / f"{machine} {day}.json.gz")
            paths[-1].write_bytes(gzip.compress(json.dumps(row).encode(), compresslevel=1))
    start = time.process_time()
    _tables(paths, room, MonitorSettings(), (), append=False)
    spent = time.process_time() - start
    shutil.rmtree(room)
    return spent


def record_seconds(*, seconds: float, rate_hz: float, sensors: int = 1, count: int = 20) -> float:
    """Return the CPU seconds for the analysis of a record of noise, the mean of `count` after one to warm up."""
    rng, gearbox = np.random.default_rng(15), load_gearbox("two-stage")
    record = make_record(
        {f"sensor {number}": rng.normal(size=int(seconds * rate_hz)) for number in range(sensors)},
        rate_hz=rate_hz,
        units="g",
        angle=NominalSpeed(rpm=1200, shaft="input"),
    )
    start = 0.0
    for number in range(count + 1):
        if number == 1:
            start = time.process_time()
        results(analyze(record, gearbox, settings=AnalysisSettings(most_tracks=0)))
    return (time.process_time() - start) / count


# ---- the page --------------------------------------------------------------------------------------------------------


INTRO = """# Fleet: alarms of healthy and failing machines

Made by one run of `python benchmarks/fleet.py ANALYSES --machines {machines} --forecasts {forecasts}`. Fleets are
resampled from {records} analyses of one gearbox ({healthy} healthy): each series of indicators is its mean, its slopes
on gain, noise, temperature and load, which carry over as `data_synth.scene.history` declares (5 and 50 records, a
season of 365), and a residual drawn together for all series. The load is not measured, so it is no covariate. The
healthy analyses are split by machine: the prior (`hums/fleet/prior.json`) was learned on one half (`--learn-prior`
`--machines 1600`), each of whose machines was left out in turn to find how much wider limits have to be for a machine
that a prior has not seen; all that follows is measured on the other half. Both halves are of one gearbox and one plan.
Nothing is tuned to measured records.
"""


def page(given: argparse.Namespace, found: Analyses, resampled: Resampled) -> str:
    """Return the page of all measurements."""
    healthy = int((found.kinds == "healthy").sum())
    text = [INTRO.format(machines=given.machines, forecasts=given.forecasts, records=len(found.kinds), healthy=healthy)]
    text += ["## False alarms of healthy machines\n"]
    text.append(
        f"{given.machines} machines, {WATCHED} records watched of each. An alarm stands until somebody acknowledges "
        "it, so that a component raises one at most; some machines raise several, which the interval counts.\n"
    )
    text += ["| baseline, records | stated: one in | alarms | expected | alarms, 95 % over machines | within |"]
    text += ["|---|---|---|---|---|---|"]
    for baseline in BASELINES:
        fleets = healthy_fleet(resampled, found, machines=given.machines, baseline=baseline, seed=5)
        for every, by_machine in zip(RATES, fleets, strict=True):
            expected = given.machines * WATCHED / every
            low, high = bootstrapped(by_machine)
            cells = (baseline, f"{every:,.0f}", by_machine.sum(), f"{expected:.0f}", f"{low:.0f} to {high:.0f}")
            text.append(f"| {' | '.join(map(str, cells))} | {'yes' if low <= expected <= high else 'no'} |")
    text.append(
        "\nThe interval is over the machines measured on; how few analyses the prior was learned from is not in it, "
        "and machines with larger residuals than those raise more alarms than stated."
    )
    text += ["\n## Faults that grow\n"]
    text.append(
        "Exponential growth over 240 records from the least to the largest size analysed; a baseline of 30 records, "
        "one false alarm in 10,000; median size in mm at the first alarm, and share of machines with one.\n"
    )
    text += [
        "| fault | sizes | fused, with verdicts | RMS | kurtosis | diagnosed from one record from |",
        "|---|---|---|---|---|---|",
    ]
    _, _, layout = layout_of(found.series)
    layouts = (layout, single(found.series, "rms"), single(found.series, "kurtosis"))
    for name, course in fault_courses(found, found.values[found.kinds == "healthy"]).items():
        cells = []
        for one in layouts:
            sizes = severities(resampled, found, name, course, one, machines=min(given.machines, CHUNK))
            cells.append(f"{np.median(sizes):.2g} ({np.isfinite(sizes).mean():.0%})")
        ends = f"{course[0][0]:.2g} to {course[0][-1]:.2g}"
        single_record = diagnosed_size(found, name)
        text.append(f"| {name} | {ends} | {' | '.join(cells)} | {single_record:.2g} |")
    text += [
        "\n`inf`: half of the machines raise no alarm, or half of the records are not diagnosed, up to the largest.\n"
    ]
    share, inside, width, remains = coverage(given.forecasts)
    text += ["## Time until a limit\n"]
    text.append(
        f"{given.forecasts} forecasts: {share:.0%} given, the others declined; 90 % intervals hold "
        f"{inside:.0%} of the true times; median width {width:.3g} records, where a median of {remains:.3g} "
        "remain. Growth is linear, exponential, quadratic, and by steps, which the model lacks.\n"
    )
    if given.data:
        text += ["## PRONOSTIA\n", "Baseline: the first tenth of each run; plain indicators of snapshots of 0.1 s.\n"]
        text += [
            "| run | snapshots | first alarm, share of life | what drove it | stands at the end |",
            "|---|---|---|---|---|",
        ]
        for path in sorted((Path(given.data) / "pronostia").glob("*.npz")):
            count, first, what, stands = run_to_failure(path)
            text.append(f"| {path.stem} | {count} | {first:.2f} | {what} | {'yes' if stands else 'no'} |")
        text += ["\n## Wind turbine\n", "Four records, a baseline of the first two.\n"]
        text += ["| recorded | largest health index | component | alarm |", "|---|---|---|---|"]
        for when, index, component, raised in turbine(Path(given.data) / "wt_hss_bearing"):
            text.append(f"| {when[:10]} | {index:.2f} | {component} | {'yes' if raised else 'no'} |")
    text += ["\n## Cost\n", "| what | CPU time on one core |", "|---|---|"]
    text.append(f"| tables, alarms and page of 10,000 rows, 20 machines | {table_seconds(given.analyses):.1f} s |")
    short = record_seconds(seconds=0.1, rate_hz=25_600)
    text.append(f"| a record of 0.1 s at 25.6 kHz | {1e3 * short:.0f} ms |")
    text.append(f"| a record of 1 s at 50 kHz | {1e3 * record_seconds(seconds=1, rate_hz=50_000):.0f} ms |")
    return "\n".join(text) + "\n"


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("analyses", type=Path)
    parser.add_argument("folder", type=Path, nargs="?", default=ROOT / "docs" / "benchmarks")
    parser.add_argument("--data", type=Path, default=os.environ.get("HUMS_REAL_DATA"))
    parser.add_argument("--learn-prior", action="store_true")
    parser.add_argument("--machines", type=int, default=4_000)
    parser.add_argument("--forecasts", type=int, default=300)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    found = analyses(given.analyses, workers=given.workers)
    if given.learn_prior:
        path, learned = ROOT / "hums" / "fleet" / PRIOR_NAME, learn_prior(found, found.resampled(0))
        learned["widening"] = widening(found, machines=given.machines)
        path.write_text(json.dumps(learned) + "\n", encoding="utf-8")
        return
    (given.folder / "fleet.md").write_text(page(given, found, found.resampled(1)), encoding="utf-8")


if __name__ == "__main__":
    main()
