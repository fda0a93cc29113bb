"""Analyses that fleets are made of, and the fleets: one gearbox, healthy and with five faults of all sizes."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from data_synth import make_dataset
from data_synth.plan import parse_plan
from data_synth.scene.machine_history import History
from hums import open_dataset
from hums.fleet.fleet_analysis import analyze_fleet
from hums.fleet.result_files import read_row
from hums.fleet.series import Series, series_of, vector
from hums.gearbox.defect_orders import BEARING_KINDS
from hums.jobs import Processes

Array = NDArray[np.float64]
STATES = ("gain_db", "noise_db", "temperature_k", "load")
FAULTS = ("crack", "spall", "eccentricity", "inner race", "outer race")
_MEASURED_ERROR = 0.1  # of a state's deviation: 0.5 K, and 1 % of the load
RECORDS, MACHINES = 960, 41
"""Of the dataset with faults: few records of each machine, whose states are then spread as widely as those of long
fleets, and no divisor in common with the 12 records in which classes take turns, so that each shows them all."""
UNSEEN_SEED, UNSEEN_RECORDS, UNSEEN_MACHINES = 5, 1_000, 125  # of the analyses that fleets are measured on

PLAN = """
scene = "healthy-mill"
records = {records}
seed = {seed}
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
{size} = {{ log = [{least}, {most}], label = "severity_mm" }}
"""
SIZES = (
    ("crack", "tooth_crack", "stage 1/pinion", "depth_mm", 0.1, 3),
    ("spall", "spall", "stage 2/output", "size_mm", 0.1, 3),
    ("eccentricity", "eccentricity", "stage 1/intermediate", "size_mm", 0.02, 0.7),
    ("inner race", "inner_race", "intermediate bearing", "size_mm", 0.1, 3),
    ("outer race", "outer_race", "input bearing", "size_mm", 0.1, 3),
)


# ---- analyses --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Analyses:
    """Logarithms of the indicators of all records (records, series), their levels in health, classes and severities."""

    series: tuple[Series, ...]
    values: Array
    levels: Array
    kinds: NDArray[np.str_]
    severity_mm: Array
    diagnosed: NDArray[np.bool_]


def analyses(folder: Path, *, workers: int, records: int = RECORDS) -> Analyses:
    """Return the analyses in the folder that faults are learned from; make what is missing."""
    text = PLAN.format(records=records, machines=MACHINES, seed=1)
    for name, kind, component, size, least, most in SIZES:
        text += FAULT.format(name=name, kind=kind, component=component, size=size, least=least, most=most)
    rows, labels = _analysed(folder, text, workers)
    kinds = [str(kind) for kind in labels["class"].to_numpy()]
    found, classes = [series_of(row) for row in rows], np.array(kinds)
    every = tuple(sorted(set().union(*(one.keys for one in found))))
    values = np.array([vector(one, every) for one in found])
    kept = np.isfinite(values[classes == "healthy"]).mean(axis=0) >= 0.9  # noqa: PLR2004
    return Analyses(
        series=tuple(key for key, keep in zip(every, kept, strict=True) if keep),
        values=values[:, kept],
        levels=np.nanmedian(values[classes == "healthy"][:, kept], axis=0),
        kinds=classes,
        severity_mm=labels["severity_mm"].to_numpy().astype(np.float64),
        diagnosed=np.array([_diagnosed(row, kind) for row, kind in zip(rows, kinds, strict=True)]),
    )


def unseen(folder: Path, series: tuple[Series, ...], *, workers: int) -> "Resampled":
    """Return the fleets that are made of machines of another seed, from which nothing is learned."""
    rows, labels = _healthy(folder, UNSEEN_SEED, UNSEEN_RECORDS, UNSEEN_MACHINES, workers)
    return Resampled(
        healthy=np.array([vector(series_of(row), series) for row in rows]),
        states=_states(labels),
        machine=np.arange(UNSEEN_RECORDS) % UNSEEN_MACHINES,  # records take turns
    )


def _healthy(
    folder: Path, seed: int, records: int, machines: int, workers: int
) -> tuple[list[dict[str, Any]], xr.Dataset]:
    """Return the results of healthy records of machines of a seed, and their labels."""
    return _analysed(folder / f"seed {seed}", PLAN.format(records=records, machines=machines, seed=seed), workers)


def _analysed(folder: Path, text: str, workers: int) -> tuple[list[dict[str, Any]], xr.Dataset]:
    """Return the results of the records of a plan, and their labels."""
    make_dataset(parse_plan(text), folder / "set", workers=Processes(count=workers), progress=True)
    analyze_fleet([folder / "set"], "two-stage", folder / "fleet", workers=Processes(count=workers), progress=True)
    names = json.loads((folder / "fleet/records.json").read_text()).values()
    return [read_row(folder / "fleet" / "records" / name) for name in names], open_dataset(folder / "set")


def _states(labels: xr.Dataset) -> Array:
    return np.stack([labels[f"history.{name}"].to_numpy() for name in STATES], axis=1)


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


def garrote(slopes: Array, errors: Array, *, by: float = 2.0) -> Array:
    """Return slopes shrunk by their standard errors; those below `by` of them are none."""
    sizes = np.maximum(np.abs(slopes), 1e-12)
    return np.asarray(slopes * np.maximum(0.0, 1 - (by * errors / sizes) ** 2))


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """Series (machines, records, series), and what was measured with the records (machines, records, covariates)."""

    series: Array
    measured: Array

    def of(self, those: NDArray[np.bool_]) -> "Fleet":
        """Return some of the machines."""
        return Fleet(series=self.series[those], measured=self.measured[those])


@dataclass(frozen=True, kw_only=True)
class Resampled:
    """Series of long fleets from a few hundred analyses.

    A series is its mean, its slopes on the states that carry over (fitted to the healthy analyses), and a residual
    drawn from them: all series of a record together, so that they depend on each other as they do there. Slopes and
    residuals are about the means of the machines analysed, since each machine has its own baseline. Residuals of
    machines are scaled by a factor of their own, log-normal with a deviation of 20 %.

    A slope that is the error of its fit alone would make every machine drift where none does. Slopes b of standard
    error s are therefore shrunk to b max(0, 1 - (2 s / b)^2) (nonnegative garrote; Breiman 1995, Technometrics 37(4),
    373-384).
    """

    healthy: Array
    states: Array
    machine: NDArray[np.int64]

    def _within(self, values: Array) -> Array:
        """Return values (records, ...) about the means of their machines."""
        means = [np.nanmean(values[self.machine == one], axis=0) for one in range(self.machine.max() + 1)]
        return np.asarray(values - np.array(means)[self.machine])

    @cached_property
    def slopes(self) -> tuple[Array, Array]:
        """Slopes (states, series) as they are fitted, and their standard errors."""
        filled = np.where(np.isfinite(self.healthy), self.healthy, np.nanmedian(self.healthy, axis=0))
        design, values = self._within(self.standard), self._within(filled)
        found, *_ = np.linalg.lstsq(design, values, rcond=None)
        freedom = len(filled) - len(np.unique(self.machine)) - len(found)
        std = np.sqrt(((values - design @ found) ** 2).sum(axis=0) / freedom)
        return found, np.sqrt(np.diag(np.linalg.inv(design.T @ design)))[:, None] * std

    @cached_property
    def _fit(self) -> tuple[Array, Array]:
        slopes = garrote(*self.slopes)
        left = self._within(self.healthy - self.standard @ slopes)
        return slopes, left / np.sqrt(1 - 1 / np.bincount(self.machine)[self.machine, None])

    def still(self) -> "Resampled":
        """Return the same without what carries over."""
        return replace(self, healthy=self._fit[1], states=np.random.default_rng(18).standard_normal(self.states.shape))

    @property
    def standard(self) -> Array:
        """States in the deviations that the history declares."""
        declared = History()
        stds = np.array([declared.gain_db, declared.noise_db, declared.temperature_k, declared.load_share])
        return self.states / stds

    def machines(self, count: int, records: int, rng: np.random.Generator, measured: Sequence[str] = ()) -> Fleet:
        """Return series about their means, and what is measured of the states: each with an error of its own."""
        slopes, left = self._fit
        states = standard_states(count, records, rng, History())
        drawn = left[rng.integers(len(left), size=(count, records))]
        spread = np.exp(0.2 * rng.standard_normal((count, 1, 1)))
        known = states[..., [STATES.index(name) for name in measured]]
        errors = _MEASURED_ERROR * rng.standard_normal(known.shape)
        return Fleet(series=np.asarray(states @ slopes + spread * drawn), measured=known + errors)


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
