"""Analyses that fleets are made of, and the fleets: one gearbox, healthy and with faults of 13 kinds and all sizes."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

from data_synth import make_dataset
from data_synth.plan import parse_plan
from data_synth.scene.machine_history import History
from hums import open_dataset
from hums.fleet.fleet_analysis import analyze_fleet
from hums.fleet.result_files import read_results
from hums.fleet.series import Series, vector
from hums.jobs import Processes, Serial

Array = NDArray[np.float64]
STATES = ("gain_db", "noise_db", "temperature_k", "load")
_MEASURED_ERROR = 0.1  # of a state's deviation: 0.5 K, and 1 % of the load
RECORDS, MACHINES = 1_000, 47
"""Few records of each machine, whose states are then spread as widely as those of long fleets, and no divisor in common
with the 25 records in which classes take turns, so that each machine shows them all."""

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
share = 12
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
    ("chipping", "chipping", "stage 2/intermediate", "size_mm", 0.1, 10),
    ("missing tooth", "missing_tooth", "stage 1/intermediate", "size_mm", 0.1, 6.7),
    ("spall", "spall", "stage 2/output", "size_mm", 0.1, 3),
    ("pitting", "pitting", "stage 1/pinion", "size_mm", 0.1, 2),
    ("eccentricity", "eccentricity", "stage 1/intermediate", "size_mm", 0.02, 0.7),
    ("misalignment", "misalignment", "stage 2/output", "size_mm", 0.1, 10),
    ("wear", "wear", "stage 1/pinion", "size_mm", 0.02, 1),
    ("imbalance", "imbalance", "input", "size_mm", 0.01, 1),
    ("inner race", "inner_race", "intermediate bearing", "size_mm", 0.1, 3),
    ("outer race", "outer_race", "input bearing", "size_mm", 0.1, 3),
    ("rolling element", "rolling_element", "input bearing", "size_mm", 0.1, 3),
    ("cage", "cage", "intermediate bearing", "size_mm", 0.1, 3),
)


# ---- analyses --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Analyses:
    """Logarithms of the indicators of all records (records, series), and their levels in health.

    Of each record also the class, the size of its fault, the components diagnosed, its states, and its machine.
    """

    series: tuple[Series, ...]
    values: Array
    levels: Array
    kinds: NDArray[np.str_]
    severity_mm: Array
    diagnosed: list[tuple[str, ...]]
    states: Array
    machine: NDArray[np.int64]

    @cached_property
    def healthy(self) -> "Resampled":
        """Fleets made of the healthy records."""
        those = self.kinds == "healthy"
        return Resampled(healthy=self.values[those], states=self.states[those], machine=self.machine[those])


def analyses(folder: Path, *, workers: int) -> Analyses:
    """Return the analyses in the folder; make what is missing."""
    text = PLAN.format(records=RECORDS, machines=MACHINES, seed=1)
    for name, kind, component, size, least, most in SIZES:
        text += FAULT.format(name=name, kind=kind, component=component, size=size, least=least, most=most)
    run = Serial() if workers == 1 else Processes(count=workers)
    make_dataset(parse_plan(text), folder / "set", workers=run)
    analyze_fleet([folder / "set"], "two-stage", folder / "fleet", workers=run)
    names, labels = json.loads((folder / "fleet/records.json").read_text()).values(), open_dataset(folder / "set")
    seen = read_results(folder / "fleet" / "records" / name for name in names)
    kinds = labels["class"].to_numpy().astype(np.str_)
    every = tuple(sorted(set().union(*(one.values.keys for one in seen))))
    values = np.array([vector(one.values, every) for one in seen])
    kept = np.isfinite(values[kinds == "healthy"]).mean(axis=0) >= 0.9  # noqa: PLR2004
    return Analyses(
        series=tuple(key for key, keep in zip(every, kept, strict=True) if keep),
        values=values[:, kept],
        levels=np.nanmedian(values[kinds == "healthy"][:, kept], axis=0),
        kinds=kinds,
        severity_mm=labels["severity_mm"].to_numpy().astype(np.float64),
        diagnosed=[one.diagnosed for one in seen],
        states=np.stack([labels[f"history.{name}"].to_numpy() for name in STATES], axis=1),
        machine=np.arange(RECORDS) % MACHINES,  # they take turns
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


def garrote(slopes: Array, errors: Array, *, by: float = 2.0) -> Array:
    """Return slopes shrunk by their standard errors; those below `by` of them are none."""
    sizes = np.maximum(np.abs(slopes), 1e-12)
    return np.asarray(slopes * np.maximum(0.0, 1 - (by * errors / sizes) ** 2))


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """Series (machines, records, series), and what was measured with the records (machines, records, covariates)."""

    series: Array
    measured: Array


@dataclass(frozen=True, kw_only=True)
class Resampled:
    """Series of long fleets from a few hundred analyses.

    A series is its mean, its slopes on the states that carry over (fitted to the healthy analyses), and a residual
    drawn from them: all series of a record together, so that they depend on each other as they do there. Slopes and
    residuals are about the means of the machines analysed, since each machine has its own baseline. Residuals are drawn
    in standard deviations of their machines, and have those of one machine analysed: drawn as they are, those of a
    machine that scatters more would be outliers of every machine.

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

    @cached_property
    def _scatter(self) -> tuple[Array, Array]:
        """Deviations (machines, series) of the machines analysed, and residuals over them.

        Variances of few records are moderated by those of all machines (Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3,
        article 3).
        """
        left, of = self._fit[1], [self.machine == one for one in range(self.machine.max() + 1)]
        dof = np.array([those.sum() - 1.0 for those in of])[:, None]
        variance = np.array([np.nanmean(left[those] ** 2, axis=0) for those in of])
        excess = np.nanmean(np.nanvar(np.log(variance) - digamma(dof / 2) + np.log(dof / 2), axis=0))
        weights = np.geomspace(1000, 1, 300)  # records, and the variance of logarithms that they leave
        weight = np.interp(excess - polygamma(1, dof / 2).mean(), polygamma(1, weights / 2), weights)
        usual = np.nansum(dof * variance, axis=0) / dof.sum()
        std = np.sqrt((dof * variance + weight * usual) / (dof + weight))
        return std, left / std[self.machine]

    def still(self) -> "Resampled":
        """Return the same without what carries over."""
        return replace(self, healthy=self._fit[1], states=np.random.default_rng(18).standard_normal(self.states.shape))

    @property
    def standard(self) -> Array:
        """States in the deviations that the history declares."""
        return self.standard_of(self.states)

    @staticmethod
    def standard_of(states: Array) -> Array:
        """Return states (records, states) in the deviations that the history declares."""
        declared = History()
        return states / np.array([declared.gain_db, declared.noise_db, declared.temperature_k, declared.load_share])

    def machines(self, count: int, records: int, rng: np.random.Generator, measured: Sequence[str] = ()) -> Fleet:
        """Return series about their means, and what is measured of the states: each with an error of its own."""
        slopes, (std, left) = self._fit[0], self._scatter
        states = standard_states(count, records, rng, History())
        drawn = left[rng.integers(len(left), size=(count, records))]
        spread = std[rng.integers(len(std), size=count), None]
        known = states[..., [STATES.index(name) for name in measured]]
        errors = _MEASURED_ERROR * rng.standard_normal(known.shape)
        return Fleet(series=np.asarray(states @ slopes + spread * drawn), measured=known + errors)


def fault_courses(found: Analyses) -> dict[str, tuple[Array, Array]]:
    """Return, for each fault, sizes in mm and what it adds to every series there: a running mean over five sizes.

    It is about the healthy mean of the same machine, at the states of the record, and shrunk by twice its standard
    error as slopes are: what remains of other differences would be a change of sound components.
    """
    healthy, of = found.healthy, found.kinds == "healthy"
    at_states = found.values - healthy.standard_of(found.states) @ garrote(*healthy.slopes)
    own = np.array([np.nanmean(at_states[of & (found.machine == one)], axis=0) for one in range(MACHINES)])
    shifts, courses = at_states - own[found.machine], {}
    error = np.nanstd(shifts[of], axis=0)
    for name, *_ in SIZES:
        those = np.flatnonzero(found.kinds == name)
        those = those[np.argsort(found.severity_mm[those])]
        windows = [np.nan_to_num(shifts[those[max(0, i - 2) : i + 3]]) for i in range(those.size)]
        course = np.array([garrote(one.mean(axis=0), error / np.sqrt(len(one))) for one in windows])
        courses[name] = (found.severity_mm[those], course)
    return courses


def added(course: tuple[Array, Array], size_mm: Array) -> Array:
    """Return what a fault of some sizes adds (records, series), nothing below the least size analysed."""
    sizes, shifts = course
    place = np.interp(np.log(size_mm), np.log(sizes), np.arange(sizes.size))
    low = np.minimum(place.astype(int), sizes.size - 2)
    mixed = shifts[low] + (place - low)[:, None] * (shifts[low + 1] - shifts[low])
    return np.where((size_mm >= sizes[0])[:, None], mixed, 0.0)
