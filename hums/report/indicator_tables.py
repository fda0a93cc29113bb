"""Tables of condition indicators for the report: value, limit and meaning, one per channel and kind of component."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from signals.indicators import INDICATORS

_TITLES = {
    "channel": "whole record",
    "shaft": "shafts",
    "gear": "gears",
    "planetary": "planetary stages",
    "bearing": "bearings",
}
_OURS = {
    "defect_energy_ratio": ("Defect energy over that of the background", "a spall on that race or rolling element"),
    "velocity_rms": (
        "RMS vibration velocity in the band of ISO 20816-1",
        "unbalance, misalignment, looseness",
    ),
    "modulation": (
        "Defect lines of the envelope over its mean, in the band where this is largest, whatever their source",
        "a spall on that race or rolling element; coinciding lines of other components",
    ),
    "tooth_outlier": (
        "How far a tooth stands out from the others in all bands together, in their standard deviations",
        "one damaged tooth; a single pitch deviation",
    ),
}
_MEANINGS = {
    "rms": "Root mean square about the mean",
    "peak": "Largest deviation from the mean",
    "crest_factor": "Peak over the RMS: sqrt 2 for a sine",
    "kurtosis": "Fourth moment about the mean over the variance squared: 3 for Gaussian noise, 1.5 for a sine",
    "so1": "Peak amplitude of order 1 in the shaft's synchronous average",
    "so2": "Peak amplitude of order 2 in the shaft's synchronous average",
    "so3": "Peak amplitude of order 3 in the shaft's synchronous average",
    "fm0": "Peak-to-peak value of the average over the sum of its mesh harmonics' amplitudes",
    "fm4": "Kurtosis of the difference signal",
    "m6a": "Sixth moment of the difference signal over its variance cubed",
    "m8a": "Eighth moment of the difference signal over its variance to the fourth",
    "na4": "Fourth moment of the residual signal over the squared mean variance of its history",
    "nb4": "Fourth moment of the band's envelope over the squared mean variance of its history",
    "energy_ratio": "RMS of the difference signal over that of the regular signal",
    "energy_operator": "Kurtosis of the residual signal's Teager energy",
    "sideband_index": "Mean amplitude of the first sidebands of the mesh",
    "sideband_level_factor": "Sum of the first sidebands' amplitudes over the standard deviation of the average",
    "narrowband_kurtosis": "Kurtosis of the band-pass filtered mesh signal: 1.5 without modulation",
    "amplitude_modulation": "Amplitude modulation depth: m for a mesh amplitude of 1 + m cos",
    "phase_modulation": "Phase modulation index in rad: b for a mesh phase of b sin",
    "frequency_modulation": "Relative frequency deviation of the mesh",
    "amplitude_modulation_kurtosis": "Kurtosis of the envelope: 1.5 for a sine, high for one tooth",
    "frequency_modulation_kurtosis": "Kurtosis of the derivative of the phase: 1.5 for a sine",
    "defect_energy": "Energy at the harmonics of a defect frequency in an envelope spectrum",
    "carrier_sideband_ratio": "RMS of the sidebands that identical planets cancel, over that of the others",
}
UNIT_WORDS = {"m s-1": "m/s", "m s-2": "m/s\N{SUPERSCRIPT TWO}"}
_ZONES = (
    ("A", "calm", "typical of a newly commissioned machine"),
    ("B", "calm", "acceptable for unrestricted long-term operation"),
    ("C", "watch", "unsatisfactory for long-term operation"),
    ("D", "alarm", "severe enough to cause damage"),
)  # ISO 20816-1, evaluation zones, in our words

Rows = Sequence[dict[str, Any]]


def indicator_tables(rows: Rows, findings: Rows = ()) -> list[dict[str, Any]]:
    """Return the tables of indicators.

    Each has a title, a head, rows of cells, the meaning of each indicator, which ones were withheld and why, and which
    faults of other components explain values above their limits.
    """
    tables: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        kind = row["kind"] if row["kind"] in _TITLES else "bearing"
        part = f"{row['component']} {row['kind'].replace('_', ' ')}" if kind == "bearing" else row["component"]
        tables.setdefault((row["channel"], kind), []).append(row | {"part": part})
    made = []
    for (channel, kind), mine in tables.items():
        parts = list(dict.fromkeys(row["part"] for row in mine))
        every = len(parts) if kind == "bearing" else 6  # columns, so that a table fits on a sheet
        for first in range(0, len(parts), every):
            here = parts[first : first + every]
            made.append(_table(channel, kind, [row for row in mine if row["part"] in here], findings))
    return made


def velocity_zones(rows: Rows, limits: Sequence[float] | None) -> list[dict[str, str]]:
    """Return the ISO 20816 zone of every channel with a measured velocity; none without declared limits."""
    zones = []
    for row in rows if limits else ():
        if row["indicator"] == "velocity_rms" and row["value"] is not None:
            letter, style, meaning = _ZONES[sum(row["value"] > limit for limit in limits or ())]
            zones.append(
                {"channel": row["channel"], "zone": letter, "style": style, "meaning": meaning}
                | {"value": f"{row['value']:.3g} mm/s"}
            )
    return zones


def _table(channel: str, kind: str, rows: Rows, findings: Rows) -> dict[str, Any]:
    """Return one table, with bearings, of which there are many, in rows and other components in columns."""
    parts = list(dict.fromkeys(row["part"] for row in rows))
    names = list(dict.fromkeys(row["indicator"] for row in rows))
    units = {row["indicator"]: {"1": "", "g2": "g\N{SUPERSCRIPT TWO}"}.get(row["unit"], row["unit"]) for row in rows}
    cells = {(row["indicator"], row["part"]): _cell(row, findings) for row in rows}
    table = {
        "title": f"{_TITLES[kind][0].upper()}{_TITLES[kind][1:]}, {channel}",
        "channel": channel,
        "withheld": _withheld(rows),
        "raised": _raised_by_others(rows, findings),
    }
    if kind == "bearing":  # many of them, and few indicators
        return table | {
            "head": ["component", *(", ".join(filter(None, [_words(name), units[name]])) for name in names)],
            "rows": [{"name": part, "cells": [cells.get((n, part), _NONE) for n in names]} for part in parts],
            "meanings": [f"{_words(name)}: {_meaning(name)}" for name in names],
        }
    return table | {
        "head": ["indicator", *parts],
        "described": True,
        "rows": [
            {
                "name": _words(name),
                "cells": [cells.get((name, part), _NONE) for part in parts],
                "unit": units[name],
                "meaning": _meaning(name),
            }
            for name in names
        ],
    }


def _meaning(name: str) -> str:
    """Return the meaning of an indicator, and what raises it."""
    if name in INDICATORS:
        what, raised_by = _MEANINGS[name], INDICATORS[name].raised_by
    else:
        what, raised_by = _OURS.get(name) or (_words(name).capitalize(), "")
    return f"{what}." + (f" Raised by: {raised_by}." if raised_by else "")


def _words(name: str) -> str:
    return _WORDS.get(name) or name.replace("_", " ")


_NONE: dict[str, Any] = {"text": "\N{EN DASH}", "style": "", "limit": ""}
_SHORT = ("rms", "so1", "so2", "so3", "fm0", "fm4", "m6a", "m8a", "na4", "nb4")
_WORDS = {name: name.upper() for name in _SHORT} | {"velocity_rms": "velocity RMS"}


def _cell(row: Mapping[str, Any], findings: Rows) -> dict[str, Any]:
    if row["value"] is None or math.isnan(row["value"]):
        return _NONE
    limit, text = row["noise_limit"], _digits(row["value"])
    if limit is None:
        return {"text": text, "style": "", "limit": ""}
    own = any(finding["component"] == row["component"] for finding in findings)
    style = "calm" if row["value"] <= limit else "alarm" if own else "watch"
    return {"text": text, "style": style, "limit": _digits(limit)}


def _digits(value: float) -> str:
    """Return a number with three digits, large ones without an exponent."""
    text = f"{value:.3g}"
    return f"{value:,.0f}" if "e+" in text else text


def _raised_by_others(rows: Rows, findings: Rows) -> list[str]:
    """Return a sentence for each value above its limit that a fault of a mating or coaxial component also raises."""
    said = []
    for row in rows:
        high = row["value"] is not None and row["noise_limit"] is not None and row["value"] > row["noise_limit"]
        if not high or any(finding["component"] == row["component"] for finding in findings):
            continue
        others = [
            f"the {finding['verdict']} fault of {finding['component']} ({_words(finding['kind'])}), {relation},"
            for finding in findings
            if (relation := _relation(row["component"], finding["component"]))
        ]
        if others:
            raised = f"{' and '.join(others)} also raise{'s' if len(others) == 1 else ''} it"
            said.append(f"{_words(row['indicator'])} of {row['part']} is above its limit; {raised}.")
    return said


def _relation(part: str, other: str) -> str:
    """Return how another component affects the average of a gear: in mesh with it, or on its shaft."""
    mesh, _, link = part.rpartition("/")
    other_mesh, _, other_link = other.rpartition("/")
    if mesh and mesh == other_mesh:
        return "in mesh with it"
    return "on the same shaft" if mesh and link == other_link else ""


def _withheld(rows: Rows) -> list[str]:
    """Return one sentence per reason that names the indicators withheld for it."""
    by_reason: dict[str, list[str]] = {}
    for row in rows:
        if row["withheld"]:
            by_reason.setdefault(row["withheld"], []).append(f"{_words(row['indicator'])} of {row['part']}")
    return [f"Withheld: {', '.join(parts)}: {reason}" for reason, parts in by_reason.items()]
