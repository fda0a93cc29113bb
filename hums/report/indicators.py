"""Tables of condition indicators for the report: one per channel and kind of component, a column per component."""

import math
from collections.abc import Sequence
from typing import Any

from signals.indicators import INDICATORS

_TITLES = {
    "channel": "the record",
    "shaft": "shafts",
    "gear": "gears",
    "planetary": "planetary stages",
    "bearing": "bearings",
}
_RAISED_BY = {
    "velocity_rms": "unbalance, misalignment, looseness",
}


def indicator_tables(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the tables of indicators: title, head, rows of cells, and the withheld indicators with the reason."""
    tables: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        kind = row["kind"] if row["kind"] in _TITLES else "bearing"
        part = f"{row['component']} {row['kind'].replace('_', ' ')}" if kind == "bearing" else row["component"]
        tables.setdefault((row["channel"], kind), []).append(row | {"part": part})
    return [_table(channel, kind, mine) for (channel, kind), mine in tables.items()]


def _table(channel: str, kind: str, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return one table: bearings in rows, since there are many; other components in columns."""
    parts = list(dict.fromkeys(row["part"] for row in rows))
    names = list(dict.fromkeys(row["indicator"] for row in rows))
    units = {row["indicator"]: row["unit"] for row in rows}
    cells = {(row["indicator"], row["part"]): _cell(row) for row in rows}
    table = {
        "title": f"{_TITLES[kind][0].upper()}{_TITLES[kind][1:]}, {channel}",
        "withheld": _withheld(rows),
    }
    if kind == "bearing":  # many of them, and few indicators
        return table | {
            "head": ["part", *(f"{_words(name)}, {units[name]}" for name in names)],
            "rows": [{"name": part, "cells": [cells.get((n, part), _NONE) for n in names]} for part in parts],
        }
    return table | {
        "head": ["indicator", *parts],
        "described": True,
        "rows": [
            {
                "name": _words(name),
                "cells": [cells.get((name, part), _NONE) for part in parts],
                "unit": units[name],
                "raised_by": INDICATORS[name].raised_by if name in INDICATORS else _RAISED_BY.get(name, ""),
            }
            for name in names
        ],
    }


def _words(name: str) -> str:
    return _WORDS.get(name) or name.replace("_", " ")


_NONE: dict[str, Any] = {"text": "\N{EN DASH}", "high": False}
_SHORT = ("rms", "so1", "so2", "so3", "fm0", "fm4", "m6a", "m8a", "na4", "nb4")
_WORDS = {name: name.upper() for name in _SHORT} | {"velocity_rms": "velocity RMS"}


def _cell(row: dict[str, Any]) -> dict[str, Any]:
    if row["value"] is None or math.isnan(row["value"]):
        return _NONE
    limit = row["noise_limit"]
    return {"text": f"{row['value']:.3g}", "high": limit is not None and row["value"] > limit}


def _withheld(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return one sentence per reason that names the indicators withheld for it."""
    by_reason: dict[str, list[str]] = {}
    for row in rows:
        if row["withheld"]:
            by_reason.setdefault(row["withheld"], []).append(f"{_words(row['indicator'])} of {row['part']}")
    return [f"Withheld: {', '.join(parts)}: {reason}" for reason, parts in by_reason.items()]
