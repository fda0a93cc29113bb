"""Colours and text style of the figures."""

from collections.abc import Mapping
from math import log10
from typing import Any

INK, FAINT, LINE, MARK = "#1f2933", "#9aa5b1", "#2563a8", "#c2410c"
KIND_COLOURS = {
    "shaft": "#4b5563",
    "gear_mesh": "#2f855a",
    "tooth": "#805ad5",
    "planet_pass": "#0369a1",
    "planet_tooth": "#6366f1",
    "hunting_tooth": "#92400e",
    "assembly_phase": "#65a30d",
    "inner_race": "#c2410c",
    "outer_race": "#b7791f",
    "rolling_element": "#b83280",
    "cage": "#2c7a7b",
}
TRACK_COLOURS = ("#2563a8", "#c2410c", "#2f855a", "#805ad5", "#b7791f", "#b83280")


def line_label(line: Mapping[Any, Any]) -> str:
    """Return the name of a line from its component, kind, harmonic and sideband: "2x stage 1 +1"."""
    harmonic = f"{line['harmonic']}x " if line["harmonic"] != 1 else ""
    sideband = f" {line['sideband']:+d}" if line["sideband"] else ""
    kind = "" if line["kind"] in {"shaft", "gear_mesh", "tooth"} else " " + str(line["kind"]).replace("_", " ")
    return f"{harmonic}{line['component']}{kind}{sideband}"


def minus(text: str) -> str:
    """Return the text of a number with a typographic minus sign."""
    return text.replace("-", "\N{MINUS SIGN}")


def power_of_ten(value: float) -> str:
    """Return a power of ten with a superscript exponent."""
    raised = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    return "10" + f"{round(log10(value))}".translate(raised)
