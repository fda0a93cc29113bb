"""Results of many records, read once: numbers in arrays, the names that records share held once."""

import gzip
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from dataclasses import replace as with_changes
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.fleet.observation import Observation, observation
from hums.fleet.series import Series, SeriesValues

__all__ = ["INDICATOR", "LINE", "KeptRecord", "Numbers", "read_results", "read_row"]

LINE = ("channel", "spectrum", "component", "kind", "harmonic", "sideband", "units")
INDICATOR = ("channel", "component", "kind", "indicator", "units")
Key = tuple[Any, ...]


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """Numbers of a record (keys, columns) under keys that other records share."""

    keys: tuple[Any, ...]
    values: NDArray[Any]

    def get(self, key: object) -> float:
        """Return the number under a key, NaN where there is none."""
        return float(self.values[self.keys.index(key)]) if key in self.keys else math.nan


@dataclass(frozen=True, kw_only=True)
class KeptRecord:
    """One record: its facts, and what it has of lines, indicators and findings.

    ``lines`` has amplitude, what it is over its surroundings, and 1 where it is claimed; ``orders`` are those of the
    first record with such lines; ``indicators`` has their values; ``findings`` component, kind and verdict;
    ``not_judged`` component and kind of what could not be judged, ``parts_not_judged`` how many and why; ``label`` is
    the class of a record of a dataset.
    """

    record: str
    machine: str
    recorded_at: str
    error: str
    speed_hz: float
    lines: Numbers
    orders: NDArray[np.float64]
    indicators: Numbers
    findings: tuple[tuple[str, str, str], ...]
    watched: Numbers
    seen: Observation
    label: str = ""
    not_judged: tuple[tuple[str, str], ...] = ()
    parts_not_judged: str = ""

    @property
    def observation(self) -> Observation:
        """What the record says about its machine."""
        return with_changes(self.seen, values=SeriesValues(self.watched.keys, self.watched.values))


def read_row(path: Path) -> dict[str, Any]:
    """Return the results of one record as they are stored."""
    row: dict[str, Any] = json.loads(gzip.decompress(path.read_bytes()))
    return row


def read_results(paths: Iterable[Path]) -> list[KeptRecord]:
    """Return the results of all records, in their order; each file is read once.

    Memory holds 8 bytes for each number that is watched and 4 for the others, and every set of names once.
    """
    shared: dict[Any, Any] = {}
    return [_kept(read_row(path), shared) for path in paths]


def _kept(row: Mapping[str, Any], shared: dict[Any, Any]) -> KeptRecord:
    seen = observation(row)
    lines, indicators = row.get("lines", ()), row.get("indicators", ())
    taken = _numbers([tuple(one[: len(LINE)]) for one in lines], [one[len(LINE) + 1 :] for one in lines], 3, shared)
    if ("orders", taken.keys) not in shared:
        shared["orders", taken.keys] = np.array([one[len(LINE)] for one in lines], dtype=np.float64)
    return KeptRecord(
        **{name: row[name] for name in ("record", "machine", "recorded_at", "error")},
        speed_hz=row.get("speed_hz", np.nan),
        lines=taken,
        orders=shared["orders", taken.keys],
        indicators=_numbers([tuple(one[:-1]) for one in indicators], [one[-1:] for one in indicators], 1, shared),
        findings=tuple((component, kind, word) for component, kind, word, *_ in row.get("findings", ())),
        watched=_watched(seen.values),
        seen=with_changes(seen, values={}),
        label=row.get("class", ""),
        not_judged=_shared_pairs(row.get("not_judged", ()), shared),
        parts_not_judged=row.get("parts_not_judged", ""),
    )


def _watched(values: Mapping[Series, float]) -> Numbers:
    """Return the values of the series; those of one record's results share their keys with others already."""
    if isinstance(values, SeriesValues):
        return Numbers(keys=values.series, values=values.numbers)
    return Numbers(keys=tuple(values), values=np.array(list(values.values()), dtype=np.float64))


def _shared_pairs(rows: Iterable[Iterable[str]], shared: dict[Any, Any]) -> tuple[tuple[str, str], ...]:
    """Return component and kind of each row; records with the same ones share them."""
    pairs = tuple((component, kind) for component, kind in rows)
    return shared.setdefault(("pairs", pairs), pairs)  # type: ignore[no-any-return]


def _numbers(keys: list[Any], values: list[Any], width: int, shared: dict[Any, Any]) -> Numbers:
    names = tuple(keys)
    table: NDArray[Any] = np.array(values, dtype=np.float32).reshape(len(names), width)
    return Numbers(keys=shared.setdefault(names, names), values=table[:, 0] if width == 1 else table)
