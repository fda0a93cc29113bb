"""Table of the results of many records, one row per record, as HDF5 and CSV, and the trends of its series."""

import csv
import gzip
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.fleet.observation import seconds_since_1970
from hums.records.store import atomic_write, write_tree

__all__ = ["SIGNIFICANCE", "WrittenTables", "adjusted_p_values", "read_row", "trend", "write_tables"]


# ---- Trend of a series: Kendall's rank correlation test and the Theil-Sen slope --------------------------------------


Array = NDArray[np.floating]
MIN_POINTS = 5  # five in order have p = 2 / 5! = 1/60; fewer are never significant
_MAX_SLOPE_POINTS = 400  # of the Theil-Sen slope, whose cost grows with the square
CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Trend:
    """Trend of one series over time.

    Attributes
    ----------
    points : int
        Number of finite values.
    median : float
        Median of the values.
    slope, slope_low, slope_high : float
        Median slope of all pairs (Theil 1950, Sen 1968, J. Am. Stat. Assoc. 63, 1379-1389) and the ends of its 95 %
        confidence interval, in units of the values per unit of time. Above 400 values, the pairs are those of the
        medians of 400 consecutive groups.
    tau : float
        Kendall's rank correlation of value and time (tau-b): 1 for a series that rises throughout.
    p_value : float
        Probability of a tau at least this far from zero if the values are exchangeable in time.
    """

    points: int
    median: float
    slope: float
    slope_low: float
    slope_high: float
    tau: float
    p_value: float


def trend(values: Array, times: Array) -> Trend | None:
    """Return the trend of the finite `values` (n,) over `times` (n,); None for fewer than 5, or all equal ones."""
    from scipy.stats import kendalltau, theilslopes  # noqa: PLC0415 - heavy

    known = np.isfinite(values) & np.isfinite(times)
    x, y = times[known], np.asarray(values[known], dtype=np.float64)
    if x.size < MIN_POINTS or np.ptp(x) == 0 or np.ptp(y) == 0:
        return None
    order = np.argsort(x, kind="stable")
    rank = kendalltau(x, y)
    groups = np.array_split(order, min(x.size, _MAX_SLOPE_POINTS))
    medians = np.array([[np.median(x[group]), np.median(y[group])] for group in groups])
    slope = theilslopes(medians[:, 1], medians[:, 0], alpha=CONFIDENCE)
    return Trend(
        points=x.size,
        median=float(np.median(y)),
        slope=float(slope.slope),
        slope_low=float(slope.low_slope),
        slope_high=float(slope.high_slope),
        tau=float(rank.statistic),
        p_value=float(rank.pvalue),
    )


def adjusted_p_values(p_values: Array) -> Array:
    """Return p values (n,) adjusted for the false discovery rate among tests that may depend on each other.

    Benjamini and Yekutieli (2001), Ann. Stat. 29(4), 1165-1188.
    """
    from scipy.stats import false_discovery_control  # noqa: PLC0415 - heavy

    return np.asarray(false_discovery_control(p_values, method="by")) if p_values.size else p_values


# ---- Table -----------------------------------------------------------------------------------------------------------


SIGNIFICANCE = 0.01
"""Adjusted p value below which a trend is called rising or falling."""

VERDICTS = ("none", "indicated", "diagnosed")
_LINE = ("channel", "spectrum", "component", "kind", "harmonic", "sideband", "units")
_INDICATOR = ("channel", "component", "kind", "indicator", "units")
_CONDITION = ("component", "kind")
_FACTS = ("record", "machine", "recorded_at", "error")
_DAY_S = 86400.0
Key = tuple[Any, ...]
Row = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class WrittenTables:
    """Errors of the failed records by name, and the reason why there are no trends, or an empty string."""

    errors: Mapping[str, str]
    no_trends: str


def write_tables(
    results: Sequence[Path], folder: Path, *, health: Mapping[str, Mapping[str, Any]] | None = None
) -> WrittenTables:
    """Write ``fleet.h5``, ``fleet.csv`` and ``trends.csv`` from the result files of the records.

    `health` has, by the name of a record, why it was not judged and the health indices of its components.

    Memory holds the table, with 9 bytes per line, 4 per indicator and 1 per condition of each record, and one record.
    """
    columns = _Columns()
    for path in results:
        columns.add(read_row(path))
    table = _with_health(_table(results, columns), health or {})
    write_tree(xr.DataTree(table), folder / "fleet.h5")
    with atomic_write(folder / "fleet.csv") as part, part.open("w", encoding="utf-8", newline="") as stream:
        _write_csv(table, stream)
    with atomic_write(folder / "trends.csv") as part, part.open("w", encoding="utf-8", newline="") as stream:
        rows = list(_series_trends(table))
        _write_trends(rows, stream)
    failed = table["error"].to_numpy() != ""
    names, errors = table["record"].to_numpy()[failed], table["error"].to_numpy()[failed]
    return WrittenTables(
        errors=dict(zip(names.tolist(), errors.tolist(), strict=True)),
        no_trends="" if rows else _reason_for_no_trends(table.isel(record=~failed)),
    )


def read_row(path: Path) -> dict[str, Any]:
    """Return the results of one record."""
    row: dict[str, Any] = json.loads(gzip.decompress(path.read_bytes()))
    return row


class _Columns:
    """Columns of the table, numbered in the order in which the records first fill them."""

    def __init__(self) -> None:
        self.lines: dict[Key, int] = {}
        self.indicators: dict[Key, int] = {}
        self.conditions: dict[Key, int] = {}
        self.orders: dict[Key, float] = {}

    def add(self, row: Row) -> None:
        for line in row.get("lines", ()):
            key = tuple(line[: len(_LINE)])
            self.lines.setdefault(key, len(self.lines))
            self.orders.setdefault(key, line[len(_LINE)])
        for indicator in row.get("indicators", ()):
            self.indicators.setdefault(tuple(indicator[: len(_INDICATOR)]), len(self.indicators))
        for finding in row.get("findings", ()):
            self.conditions.setdefault(tuple(finding[: len(_CONDITION)]), len(self.conditions))


def _table(results: Sequence[Path], columns: _Columns) -> xr.Dataset:
    """Return the table of all records, NaN where a record lacks a column."""
    count = len(results)
    facts: dict[str, list[str]] = {name: [] for name in _FACTS}
    speed = np.full(count, np.nan)
    amplitude = np.full((count, len(columns.lines)), np.nan, dtype=np.float32)
    snr, claimed = np.full_like(amplitude, np.nan), np.zeros(amplitude.shape, dtype=np.int8)
    value = np.full((count, len(columns.indicators)), np.nan, dtype=np.float32)
    verdict = np.zeros((count, len(columns.conditions)), dtype=np.int8)
    for number, path in enumerate(results):
        row = read_row(path)
        for name in _FACTS:
            facts[name].append(row[name])
        speed[number] = row.get("speed_hz", np.nan)
        for *key, _, line_amplitude, line_snr, line_claimed in row.get("lines", ()):
            at = number, columns.lines[tuple(key)]
            amplitude[at], snr[at], claimed[at] = line_amplitude, line_snr, line_claimed
        for *key, indicator in row.get("indicators", ()):
            value[number, columns.indicators[tuple(key)]] = indicator
        for component, kind, word, *_ in row.get("findings", ()):
            verdict[number, columns.conditions[component, kind]] = VERDICTS.index(word)
    return xr.Dataset(
        {
            **{name: ("record", np.array(texts, dtype=np.str_)) for name, texts in facts.items() if name != "record"},
            "speed_hz": ("record", speed, {"units": "rev s-1", "long_name": "mean speed of the reference"}),
            "amplitude": (("record", "line"), amplitude, {"long_name": "peak amplitude"}),
            "snr": (("record", "line"), snr, {"units": "1", "long_name": "amplitude over its surroundings"}),
            "claimed": (("record", "line"), claimed, {"long_name": "1 where the line is real"}),
            "value": (("record", "indicator"), value),
            "verdict": (
                ("record", "condition"),
                verdict,
                {"flag_values": [0, 1, 2], "flag_meanings": " ".join(VERDICTS)},
            ),
            "order": ("line", np.array(list(columns.orders.values()), dtype=np.float64)),
        },
        coords={
            "record": np.array(facts["record"], dtype=np.str_),
            **_coordinates("line", _LINE, columns.lines),
            **_coordinates("indicator", _INDICATOR, columns.indicators),
            **_coordinates("condition", _CONDITION, columns.conditions),
        },
        attrs={"schema": "hums-fleet/1"},
    )


def _with_health(table: xr.Dataset, health: Mapping[str, Mapping[str, Any]]) -> xr.Dataset:
    """Return the table with the health index of every component watched, NaN where a record was not judged."""
    records = [health.get(str(name), {}) for name in table["record"].to_numpy()]
    watched = list(dict.fromkeys(sorted({name for one in records for name in one.get("index", ())})))
    index = np.full((len(records), len(watched)), np.nan, dtype=np.float32)
    score = np.full_like(index, np.nan)
    places = {name: place for place, name in enumerate(watched)}
    for number, one in enumerate(records):
        for name, value in one.get("index", {}).items():
            index[number, places[name]], score[number, places[name]] = value, one["scores"][name]
    return table.assign(
        health=(("record", "watched"), index, {"long_name": "health index: 0 normal, 1 alarm"}),
        score=(("record", "watched"), score, {"long_name": "departure from normal, in deviations"}),
        not_judged=("record", np.array([one.get("why", "") for one in records], dtype=np.str_)),
    ).assign_coords(watched=np.array(watched, dtype=np.str_))


def _coordinates(dim: str, names: Sequence[str], keys: Mapping[Key, int]) -> dict[str, tuple[str, NDArray[Any]]]:
    """Return the identity of the columns as coordinates ``line_channel``, ``line_kind`` and so on."""
    values = list(zip(*keys, strict=True)) if keys else [()] * len(names)
    integers = ("harmonic", "sideband")
    return {
        f"{dim}_{name}": (dim, np.array(value, dtype=np.int64 if name in integers else np.str_))
        for name, value in zip(names, values, strict=True)
    }


# ---- CSV ---------------------------------------------------------------------------------------------------


def _titles(table: xr.Dataset, dim: str) -> list[str]:
    """Return the title of each column of a dimension."""
    names = {"line": _LINE, "indicator": _INDICATOR, "condition": _CONDITION}[dim]
    parts = {name: table[f"{dim}_{name}"].to_numpy() for name in names}
    titles = []
    for number in range(table.sizes[dim]):
        here = {name: str(column[number]) for name, column in parts.items()}
        if dim == "line":
            place = f"harmonic {here['harmonic']}"
            place += f" sideband {int(here['sideband']):+d}" if here["sideband"] != "0" else ""
            title = f"{here['channel']}: {here['spectrum']}: {here['component']} {here['kind']} {place}"
        elif dim == "indicator":
            title = f"{here['channel']}: {here['component']} {here['kind']} {here['indicator']}"
        else:
            title = f"{here['component']} {here['kind']}"
        titles.append(title)
    return titles


def _write_csv(table: xr.Dataset, stream: TextIO) -> None:
    """Write the table as CSV, one row per record."""
    lines = _titles(table, "line")
    line_units, units = table["line_units"].to_numpy(), table["indicator_units"].to_numpy()
    watched = [f"health: {name}" for name in table["watched"].to_numpy()]
    header = [
        *_FACTS,
        "speed_hz",
        "not_judged",
        "health_index",
        *watched,
        *(f"verdict: {title}" for title in _titles(table, "condition")),
    ]
    header += [f"{title} [{unit}]" for title, unit in zip(_titles(table, "indicator"), units, strict=True)]
    header += [f"{title} [{unit}]" for title, unit in zip(lines, line_units, strict=True)]
    header += [f"{title} over surroundings" for title in lines]
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    facts = [table[name].to_numpy() for name in (*_FACTS, "speed_hz")]
    numbers = [table[name].to_numpy() for name in ("value", "amplitude", "snr")]
    health, not_judged = table["health"].to_numpy(), table["not_judged"].to_numpy()
    for at, verdicts in enumerate(table["verdict"].to_numpy()):
        row: list[Any] = [column[at] for column in facts[:-1]] + [_number(facts[-1][at])]
        row += [not_judged[at], _number(_largest(health[at])), *map(_number, health[at])]
        row += ["" if facts[3][at] else VERDICTS[verdict] for verdict in verdicts]
        row += [_number(value) for block in numbers for value in block[at]]
        writer.writerow(row)


def _largest(values: Array) -> float:
    return float(np.max(values, where=np.isfinite(values), initial=-np.inf)) if np.isfinite(values).any() else np.nan


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.7g}"


# ---- trends ------------------------------------------------------------------------------------------------


def _write_trends(rows: Sequence[tuple[str, str, str, Trend]], stream: TextIO) -> None:
    """Write the trends as CSV in ascending order of their adjusted p values."""
    adjusted_p = adjusted_p_values(np.array([found.p_value for *_, found in rows]))
    writer = csv.writer(stream, lineterminator="\n")
    slopes = ("slope_per_day", "slope_low", "slope_high")
    writer.writerow(
        ["machine", "series", "units", "records", "median", *slopes, "kendall_tau", "p_value", "adjusted_p", "trend"]
    )
    for (machine, title, unit, found), adjusted in sorted(zip(rows, adjusted_p, strict=True), key=lambda pair: pair[1]):
        word = "none" if adjusted >= SIGNIFICANCE else "rising" if found.tau > 0 else "falling"
        numbers = (found.median, found.slope, found.slope_low, found.slope_high, found.tau, found.p_value, adjusted)
        writer.writerow([machine, title, unit, found.points, *(f"{number:.6g}" for number in numbers), word])


def _series_trends(table: xr.Dataset) -> Iterator[tuple[str, str, str, Trend]]:
    """Yield machine, series, units and trend of every series with enough values."""
    days, machines = _days_since_1970(table["recorded_at"].to_numpy()), table["machine"].to_numpy()
    blocks = [
        (_titles(table, dim), table[f"{dim}_units"].to_numpy(), table[name].to_numpy())
        for dim, name in (("indicator", "value"), ("line", "amplitude"))
    ]
    for machine in dict.fromkeys(machines):
        rows = machines == machine
        for titles, units, values in blocks:
            for title, unit, series in zip(titles, units, values.T, strict=True):
                found = trend(series[rows], days[rows])
                if found is not None:
                    yield str(machine), title, str(unit), found


def _reason_for_no_trends(table: xr.Dataset) -> str:
    """Return the reason why the analysed records have no trends."""
    dated = np.isfinite(_days_since_1970(table["recorded_at"].to_numpy()))
    if table.sizes["record"] and not dated.any():
        return "no trends: no record says when it was made; give recorded_at (hums convert --recorded-at)"
    most = max(Counter(table["machine"].to_numpy()[dated].tolist()).values(), default=0)
    if most < MIN_POINTS:
        return (
            f"no trends: a machine needs {MIN_POINTS} analysed records with recorded_at, and the most of any is {most}"
        )
    return f"no trends: no series has {MIN_POINTS} values at different times that differ from each other"


def _days_since_1970(moments: Iterable[str]) -> NDArray[np.float64]:
    """Return the days since 1970 of ISO 8601 times, NaN for what is none."""
    return np.array([seconds_since_1970(when) / _DAY_S for when in moments])
