"""What was kept of each record, put into one table: HDF5 and CSV, a row a record, and the trends of its series."""

import csv
import gzip
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums._trends import FEWEST, Trend, adjusted, trend
from hums.store import atomic_write, write_tree

__all__ = ["TREND_CHANCE", "Written", "write_tables"]

TREND_CHANCE = 0.01
"""A trend is called rising or falling where its p value, adjusted for how many series there are, is below this."""

VERDICTS = ("none", "indicated", "diagnosed")
_LINE = ("channel", "spectrum", "component", "kind", "harmonic", "sideband", "units")
_INDICATOR = ("channel", "component", "kind", "indicator", "units")
_CONDITION = ("component", "kind")
_FACTS = ("record", "machine", "recorded_at", "error")
_DAY_S = 86400.0
Key = tuple[Any, ...]
Row = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Written:
    """What the tables say about themselves: why records failed, by record, and why there are no trends, or ""."""

    errors: Mapping[str, str]
    no_trends: str


def write_tables(pieces: Sequence[Path], folder: Path) -> Written:
    """Write ``fleet.h5``, ``fleet.csv`` and ``trends.csv`` from the files of the records.

    The table holds some 10 bytes for each line and 4 for each indicator of a record; records are read one by one.
    """
    keys = _Keys()
    for piece in pieces:
        keys.add(_read(piece))
    table = _table(pieces, keys)
    write_tree(xr.DataTree(table), folder / "fleet.h5")
    with atomic_write(folder / "fleet.csv") as part, part.open("w", encoding="utf-8", newline="") as stream:
        _write_csv(table, stream)
    with atomic_write(folder / "trends.csv") as part, part.open("w", encoding="utf-8", newline="") as stream:
        rows = list(_trends(table))
        _write_trends(rows, stream)
    failed = table["error"].to_numpy() != ""
    names, errors = table["record"].to_numpy()[failed], table["error"].to_numpy()[failed]
    return Written(
        errors=dict(zip(names.tolist(), errors.tolist(), strict=True)),
        no_trends="" if rows else _why_no_trends(table.isel(record=~failed)),
    )


def _read(piece: Path) -> dict[str, Any]:
    row: dict[str, Any] = json.loads(gzip.decompress(piece.read_bytes()))
    return row


class _Keys:
    """The columns that any record fills, numbered in the order in which they are first met."""

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


def _table(pieces: Sequence[Path], keys: _Keys) -> xr.Dataset:
    count = len(pieces)
    facts: dict[str, list[str]] = {name: [] for name in _FACTS}
    speed = np.full(count, np.nan)
    amplitude = np.full((count, len(keys.lines)), np.nan, dtype=np.float32)
    snr, claimed = np.full_like(amplitude, np.nan), np.zeros(amplitude.shape, dtype=np.int8)
    value = np.full((count, len(keys.indicators)), np.nan, dtype=np.float32)
    verdict = np.zeros((count, len(keys.conditions)), dtype=np.int8)
    for number, piece in enumerate(pieces):
        row = _read(piece)
        for name in _FACTS:
            facts[name].append(row[name])
        speed[number] = row.get("speed_hz", np.nan)
        for *key, _, line_amplitude, line_snr, line_claimed in row.get("lines", ()):
            at = number, keys.lines[tuple(key)]
            amplitude[at], snr[at], claimed[at] = line_amplitude, line_snr, line_claimed
        for *key, indicator in row.get("indicators", ()):
            value[number, keys.indicators[tuple(key)]] = indicator
        for component, kind, word, *_ in row.get("findings", ()):
            verdict[number, keys.conditions[component, kind]] = VERDICTS.index(word)
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
            "order": ("line", np.array(list(keys.orders.values()), dtype=np.float64)),
        },
        coords={
            "record": np.array(facts["record"], dtype=np.str_),
            **_columns("line", _LINE, keys.lines),
            **_columns("indicator", _INDICATOR, keys.indicators),
            **_columns("condition", _CONDITION, keys.conditions),
        },
        attrs={"schema": "hums-fleet/1"},
    )


def _columns(dim: str, names: Sequence[str], keys: Mapping[Key, int]) -> dict[str, tuple[str, NDArray[Any]]]:
    """Return what each column is, as coordinates ``line_channel``, ``line_kind`` and so on."""
    columns = list(zip(*keys, strict=True)) if keys else [()] * len(names)
    whole = ("harmonic", "sideband")
    return {
        f"{dim}_{name}": (dim, np.array(column, dtype=np.int64 if name in whole else np.str_))
        for name, column in zip(names, columns, strict=True)
    }


# ---- CSV ---------------------------------------------------------------------------------------------------


def _titles(table: xr.Dataset, dim: str) -> list[str]:
    """Name each column of a dimension in words."""
    parts = {name: table[f"{dim}_{name}"].to_numpy() for name in _names(dim)}
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


def _names(dim: str) -> Sequence[str]:
    return {"line": _LINE, "indicator": _INDICATOR, "condition": _CONDITION}[dim]


def _write_csv(table: xr.Dataset, stream: TextIO) -> None:
    lines = _titles(table, "line")
    line_units, units = table["line_units"].to_numpy(), table["indicator_units"].to_numpy()
    header = [*_FACTS, "speed_hz", *(f"verdict: {title}" for title in _titles(table, "condition"))]
    header += [f"{title} [{unit}]" for title, unit in zip(_titles(table, "indicator"), units, strict=True)]
    header += [f"{title} [{unit}]" for title, unit in zip(lines, line_units, strict=True)]
    header += [f"{title} over surroundings" for title in lines]
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    facts = [table[name].to_numpy() for name in (*_FACTS, "speed_hz")]
    numbers = [table[name].to_numpy() for name in ("value", "amplitude", "snr")]
    for at, verdicts in enumerate(table["verdict"].to_numpy()):
        row: list[Any] = [column[at] for column in facts[:-1]] + [_shown(facts[-1][at])]
        row += ["" if facts[3][at] else VERDICTS[verdict] for verdict in verdicts]
        row += [_shown(value) for block in numbers for value in block[at]]
        writer.writerow(row)


def _shown(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.7g}"


# ---- trends ------------------------------------------------------------------------------------------------


def _write_trends(rows: Sequence[tuple[str, str, str, Trend]], stream: TextIO) -> None:
    chances = adjusted(np.array([found.p_value for *_, found in rows]))
    writer = csv.writer(stream, lineterminator="\n")
    slopes = ("slope_per_day", "slope_low", "slope_high")
    writer.writerow(
        ["machine", "series", "units", "records", "median", *slopes, "kendall_tau", "p_value", "adjusted_p", "trend"]
    )
    for (machine, title, unit, found), chance in sorted(zip(rows, chances, strict=True), key=lambda pair: pair[1]):
        word = "none" if chance >= TREND_CHANCE else "rising" if found.tau > 0 else "falling"
        numbers = (found.median, found.slope, found.slope_low, found.slope_high, found.tau, found.p_value, chance)
        writer.writerow([machine, title, unit, found.points, *(f"{number:.6g}" for number in numbers), word])


def _trends(table: xr.Dataset) -> Iterator[tuple[str, str, str, Trend]]:
    """Yield machine, series, units and trend of every series long enough to have one."""
    days, machines = _days(table["recorded_at"].to_numpy()), table["machine"].to_numpy()
    blocks = [
        (_titles(table, dim), table[f"{dim}_units"].to_numpy(), table[name].to_numpy())
        for dim, name in (("indicator", "value"), ("line", "amplitude"))
    ]
    for machine in dict.fromkeys(machines):
        mine = machines == machine
        for titles, units, values in blocks:
            for title, unit, series in zip(titles, units, values.T, strict=True):
                found = trend(series[mine], days[mine])
                if found is not None:
                    yield str(machine), title, str(unit), found


def _why_no_trends(table: xr.Dataset) -> str:
    """Say what the records that were analysed lack for a trend."""
    dated = table["recorded_at"].to_numpy() != ""
    if table.sizes["record"] and not dated.any():
        return "no trends: no record says when it was made; give recorded_at (hums convert --recorded-at)"
    most = max(Counter(table["machine"].to_numpy()[dated].tolist()).values(), default=0)
    if most < FEWEST:
        return f"no trends: a machine needs {FEWEST} analysed records with recorded_at, and the most of any is {most}"
    return f"no trends: no series has {FEWEST} values at different times that differ from each other"


def _days(moments: Iterable[str]) -> NDArray[np.float64]:
    """Return days since 1970 of ISO 8601 moments, NaN where there is none."""
    return np.array([datetime.fromisoformat(when).timestamp() / _DAY_S if when else np.nan for when in moments])
