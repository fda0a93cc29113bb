"""Indicators that say what they mean: limit, colour, sentence, zone, and whose fault raises them."""

import pytest

from hums.report.indicator_tables import indicator_tables, velocity_zones


def row(component, value, *, indicator="fm4", limit=4.0, kind="gear"):
    return {
        "channel": "a",
        "component": component,
        "kind": kind,
        "indicator": indicator,
        "value": value,
        "unit": "1",
        "noise_limit": limit,
        "withheld": "",
    }


FAULT = {"component": "stage 1/pinion", "kind": "tooth", "verdict": "diagnosed"}


def test_colours_and_limits():
    rows = [row("stage 1/pinion", 9.0), row("stage 1/wheel", 5.0), row("stage 2/x", 3.0), row("stage 2/y", None)]
    (table,) = indicator_tables(rows, [FAULT])
    cells = table["rows"][0]["cells"]
    assert [cell["style"] for cell in cells] == ["alarm", "watch", "calm", ""]
    assert [cell["limit"] for cell in cells] == ["4", "4", "4", ""]
    assert "Kurtosis of the difference signal." in table["rows"][0]["meaning"]


def test_what_another_fault_raises_is_said():
    rows = [row("stage 1/wheel", 5.0), row("stage 2/pinion", 5.0), row("stage 3/other", 5.0)]
    (table,) = indicator_tables(rows, [FAULT])
    mesh, shaft = table["raised"]  # and nothing of the third, which shares neither mesh nor shaft
    assert mesh.startswith("FM4 of stage 1/wheel is above its limit; the diagnosed fault of stage 1/pinion (tooth), in")
    assert mesh.endswith("in mesh with it, also raises it.")
    assert "stage 2/pinion" in shaft
    assert "on the same shaft" in shaft


@pytest.mark.parametrize(("value", "zone"), [(1.0, "A"), (1.8, "A"), (3.0, "B"), (7.0, "C"), (20.0, "D")])
def test_zones_of_declared_limits(value, zone):
    velocity = [row("record", value, indicator="velocity_rms", kind="channel")]
    assert [one["zone"] for one in velocity_zones(velocity, (1.8, 4.5, 11.2))] == [zone]
    assert velocity_zones(velocity, None) == []
