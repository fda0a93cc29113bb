"""Table of the results of many records, one row per record, as HDF5 and CSV, and the trends of its series."""

import csv
import io
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, fields
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from hums.fleet.observation import days_since_1970
from hums.fleet.result_files import StoredRecord
from hums.fleet.series import CONDITION, INDICATOR, LINE, Keys, places, shared
from hums.records.fields import plain_cell
from hums.records.outputs import atomic_write
from hums.records.store import write_tree
from signals.monitoring.slopes import FEWEST, Slopes, series_slopes, time_until

Array = NDArray[np.float64]

# ---- Table -----------------------------------------------------------------------------------------------------------


VERDICTS = ("none", "indicated", "diagnosed", "not judged")
_FACTS = ("record", "machine", "recorded_at", "error", "regime", "parts_not_judged")
FEWEST_SHOWN = 2  # values of which a change is shown
_RECENT_POINTS = 300  # of a forecast: what lies before says little about the slope now
Key = tuple[Any, ...]


def write_tables(
    records: Sequence[StoredRecord],
    folder: Path,
    *,
    health: Mapping[str, Mapping[str, Any]] | None = None,
    limits: Mapping[tuple[str, str], float] | None = None,
) -> str:
    """Write ``fleet.h5``, ``fleet.csv``, ``indicators.parquet`` and ``trends.csv`` from the results of the records.

    Return `NO_TRENDS` if no series has one, else an empty string.

    `health` has, by name of record, the reason why it was not judged and the condition indices of its components;
    `limits` has the limit for forecasts of each score, by machine and component.

    Memory holds the table, with 9 bytes per line, 4 per indicator and 1 per condition of each record.
    """
    table = _table(records, health or {})
    write_tree(xr.DataTree(table), folder / "fleet.h5")
    with atomic_write(folder / "fleet.csv") as part, part.open("w", encoding="utf-8", newline="") as stream:
        _write_csv(table, stream)
    _write_indicators(table, folder / "indicators.parquet")
    rows = sorted(_trends(table, limits or {}), key=lambda row: float(np.nan_to_num(row["adjusted_p"], nan=2.0)))
    write_rows(folder / "trends.csv", _TREND_COLUMNS, rows)
    return "" if any(row["adjusted_p"] >= 0 for row in rows) else NO_TRENDS


def distinct(keys: Iterable[Keys]) -> Keys:
    """Return the keys of all records, which share most of theirs, in the order in which they first occur."""
    return shared(tuple(dict.fromkeys(chain(*dict.fromkeys(keys)))))


def _filled(rows: Sequence[Mapping[Any, float]], keys: Sequence[Any], *, missing: float) -> NDArray[np.float32]:
    """Return the numbers of rows (rows, keys)."""
    found = [[row.get(key, missing) for key in keys] for row in rows]
    return np.array(found, dtype=np.float32).reshape(len(rows), len(keys))


def _table(records: Sequence[StoredRecord], health: Mapping[str, Mapping[str, Any]]) -> xr.Dataset:
    """Return the table of all records, NaN where a record lacks a column or was not judged."""
    facts = {name: [getattr(one, name) for one in records] for name in _FACTS}
    speed = np.array([one.covariates.get("speed_hz", np.nan) for one in records], dtype=np.float64)
    lines, indicators = distinct(one.lines.keys for one in records), distinct(one.indicators.keys for one in records)
    amplitude = np.full((len(records), len(lines)), np.nan, dtype=np.float32)
    snr, claimed = np.full_like(amplitude, np.nan), np.zeros(amplitude.shape, dtype=np.int8)
    value, order = np.full((len(records), len(indicators)), np.nan, dtype=np.float32), np.zeros(len(lines))
    for number in reversed(range(len(records))):  # orders are those of the first record with a line
        one, at = records[number], places(lines, records[number].lines.keys)
        amplitude[number, at], snr[number, at], claimed[number, at] = one.lines.values.T  # noqa: PD011
        value[number, places(indicators, one.indicators.keys)], order[at] = one.indicators.values, one.orders  # noqa: PD011
    words = [
        {(component, kind): VERDICTS.index(word) for component, kind, word in one.findings}
        | dict.fromkeys(one.not_judged, VERDICTS.index("not judged"))
        for one in records
    ]
    conditions = tuple(dict.fromkeys((component, kind) for one in records for component, kind, _ in one.findings))
    judged = [health.get(one.record, {"index": {}, "scores": {}, "why": ""}) for one in records]
    watched = sorted({name for one in judged for name in one["index"]})
    index, score = (_filled([one[what] for one in judged], watched, missing=np.nan) for what in ("index", "scores"))
    return xr.Dataset(
        {
            "class": ("record", np.array([one.label for one in records], dtype=np.str_)),
            "not_judged": ("record", np.array([one["why"] for one in judged], dtype=np.str_)),
            **{name: ("record", np.array(texts, dtype=np.str_)) for name, texts in facts.items() if name != "record"},
            "speed_hz": ("record", speed, {"units": "rev s-1", "long_name": "mean speed of the reference"}),
            "amplitude": (("record", "line"), amplitude, {"long_name": "peak amplitude"}),
            "snr": (("record", "line"), snr, {"units": "1", "long_name": "amplitude over its background"}),
            "claimed": (("record", "line"), claimed, {"long_name": "1 where the line is identified"}),
            "value": (("record", "indicator"), value),
            "verdict": (
                ("record", "condition"),
                _filled(words, conditions, missing=0).astype(np.int8),
                {"flag_values": [0, 1, 2, 3], "flag_meanings": " ".join(VERDICTS).replace("not judged", "not_judged")},
            ),
            "order": ("line", order),
            "health": (("record", "watched"), index, {"long_name": "condition index: 0 normal, 1 alarm"}),
            "score": (("record", "watched"), score, {"long_name": "deviation from normal, in standard deviations"}),
        },
        coords={
            "record": np.array(facts["record"], dtype=np.str_),
            **_coordinates("line", LINE, lines),
            **_coordinates("indicator", INDICATOR, indicators),
            **_coordinates("condition", CONDITION, conditions),
            "watched": np.array(watched, dtype=np.str_),
        },
        attrs={"schema": "hums-fleet/1"},
    )


def _coordinates(dim: str, names: Sequence[str], keys: Sequence[Key]) -> dict[str, tuple[str, NDArray[Any]]]:
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
    names = {"line": LINE, "indicator": INDICATOR, "condition": CONDITION}[dim]
    rows = zip(*(table[f"{dim}_{name}"].to_numpy().tolist() for name in names), strict=True)
    if dim == "condition":
        return [f"{component} {kind}" for component, kind in rows]
    if dim == "indicator":
        return [f"{channel}: {component} {kind} {name}" for channel, component, kind, name, _ in rows]
    return [
        f"{channel}: {spectrum}: {component} {kind} harmonic {harmonic}"
        + (f" sideband {sideband:+d}" if sideband else "")
        for channel, spectrum, component, kind, harmonic, sideband, _ in rows
    ]


def _write_csv(table: xr.Dataset, stream: TextIO) -> None:
    lines, health = _titles(table, "line"), table["health"].to_numpy()
    words = (*_FACTS, "class", "not_judged")
    columns: dict[str, Iterable[str]] = {name: map(plain_cell, table[name].to_numpy()) for name in words}
    columns["speed_hz"] = map(_number, table["speed_hz"].to_numpy())
    columns["condition_index"] = map(_number, np.fmax.reduce(health, axis=1, initial=np.nan))
    for name, index in zip(table["watched"].to_numpy(), health.T, strict=True):
        columns[f"health: {name}"] = map(_number, index)
    for title, verdicts in zip(_titles(table, "condition"), table["verdict"].to_numpy().T, strict=True):
        found = zip(table["error"].to_numpy(), verdicts, strict=True)
        columns[f"verdict: {title}"] = ["" if error else VERDICTS[verdict] for error, verdict in found]
    titles, units = (*_titles(table, "indicator"), *lines), (*table["indicator_units"].data, *table["line_units"].data)
    header = [*columns, *(f"{title} [{unit}]" for title, unit in zip(titles, units, strict=True))]
    header += [f"{title} over background" for title in lines]
    csv.writer(stream, lineterminator="\n").writerow(map(plain_cell, header))
    numbers = np.concatenate([table[name].to_numpy() for name in ("value", "amplitude", "snr")], axis=1)
    form = ",%.7g" * numbers.shape[1]
    for row, values in zip(zip(*columns.values(), strict=True), numbers, strict=True):
        line = io.StringIO()
        csv.writer(line, lineterminator="").writerow(row)
        stream.write(line.getvalue() + (form % tuple(values.tolist())).replace("nan", "") + "\n")


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.7g}"


# ---- indicators ---------------------------------------------------------------------------------------------


NO_PYARROW = 'indicators.parquet needs pyarrow, which is not installed: pip install "hums-toolkit[parquet]".'


def _write_indicators(table: xr.Dataset, path: Path) -> None:
    """Write one row per record, channel, component and indicator; names are stored as dictionaries.

    Without pyarrow, which pandas needs, the file of an earlier run is removed.
    """
    if find_spec("pyarrow") is None:
        path.unlink(missing_ok=True)
        return
    value = table["value"].to_numpy()
    at, which = np.nonzero(np.isfinite(value))
    columns: dict[str, Any] = {name: pd.Categorical(table[name].to_numpy())[at] for name in _FACTS[:3]}
    columns |= {name: pd.Categorical(table[f"indicator_{name}"].to_numpy())[which] for name in INDICATOR}
    with atomic_write(path) as part:
        pd.DataFrame(columns | {"value": value[at, which]}).to_parquet(part, engine="pyarrow", index=False)


# ---- trends ------------------------------------------------------------------------------------------------


NO_TRENDS = (
    f"no trends: a machine needs {FEWEST} records with different times (recorded_at; hums convert --recorded-at), "
    "and a series that varies"
)
_FORECAST = ("days_until_limit", "days_low", "days_high", "no_forecast")
_TREND_COLUMNS = ("machine", "regime", "series", "units", *(one.name for one in fields(Slopes)), *_FORECAST)


def write_rows(path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV, numbers with six digits; NaN, and a column that a row lacks, are empty."""
    table = pd.DataFrame(rows, columns=list(columns)).map(plain_cell)
    with atomic_write(path) as part:
        table.to_csv(part, index=False, float_format="%.6g", lineterminator="\n")


def _trends(table: xr.Dataset, limits: Mapping[tuple[str, str], float]) -> Iterator[dict[str, Any]]:
    """Yield a row of ``trends.csv`` for each series that varies, by machine and regime; scores have a limit."""
    days, watched = days_since_1970(table["recorded_at"].to_numpy()), table["watched"].to_numpy().tolist()
    series = [*_titles(table, "indicator"), *_titles(table, "line"), *(f"health: {name}" for name in watched)]
    units = [*table["indicator_units"].data, *table["line_units"].data, *["deviations"] * len(watched)]
    numbers = [table[name].to_numpy() for name in ("value", "amplitude", "score")]
    values, scored = np.concatenate(numbers, axis=1, dtype=np.float64), len(series) - len(watched)
    machines, regimes = table["machine"].to_numpy(), table["regime"].to_numpy()
    for machine, regime in dict.fromkeys(zip(machines.tolist(), regimes.tolist(), strict=True)):
        rows = np.flatnonzero((machines == machine) & (regimes == regime) & np.isfinite(days))
        rows = rows[np.argsort(days[rows], kind="stable")]
        if rows.size < FEWEST_SHOWN or not np.ptp(days[rows]):
            continue
        known, times = values[rows], days[rows]
        found = series_slopes(known, times)
        varies = (found.records >= FEWEST_SHOWN) & (np.isfinite(known) & (known != found.median)).any(axis=0)
        for number in np.flatnonzero(varies).tolist():
            row = {"machine": machine, "regime": regime, "series": series[number], "units": units[number]}
            row |= {name: column[number] for name, column in vars(found).items()}
            if number >= scored:
                row["change"] = np.nan
            if number >= scored and np.isfinite(row["slope_per_day"]):
                limit = limits.get((machine, watched[number - scored]), np.inf)
                ahead = time_until(limit, known[-_RECENT_POINTS:, number], times[-_RECENT_POINTS:])
                row |= dict(zip(_FORECAST, astuple(ahead), strict=True))
            yield row
