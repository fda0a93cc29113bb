"""The catalogue of bearings: the frequencies that its sources print, and how a gearbox file names a bearing."""

import warnings

import pytest

from hums.gearbox.bearing_catalogue import bearing_catalogue
from hums.gearbox.defect_orders import bearing_orders
from hums.gearbox.model import Gearbox, GearboxError, GearboxWarning


def gearbox(**bearing):
    entry = {"name": "left", "inner_ring": "a", "outer_ring": "box", **bearing}
    table = {"name": "pair", "frame": "box", "reference": "a", "axes": {"one": ["box", "a"], "two": ["box", "b"]}}
    return Gearbox.from_mapping(table | {"mesh": [{"teeth": {"a": 20, "b": 41}}], "bearing": [entry]})


@pytest.mark.parametrize(
    ("name", "speed_hz", "printed"),
    [
        # inner race, outer race, element (both races), cage, as far as the sources print them
        ("SKF 6205-2RS JEM", 1, (5.4152, 3.5848, 4.7135, 0.39828)),
        ("SKF 6203-2RS JEM", 1, (4.9469, 3.0530, 3.9874, 0.3817)),
        ("NICE (MFPT)", 25, (118.88, 81.12, None, None)),
        ("Rexnord ZA-2115", 2000 / 60, (296.9, 236.4, None, None)),
        ("LDK UER204", 35, (None, 107.91, None, None)),
        ("MB ER-16K", 1, (None, 3.572, None, None)),  # as a rig with this bearing states it
    ],
)
def test_printed_frequencies(name, speed_hz, printed):
    (rates,) = bearing_orders(gearbox(bearing=name))
    found = (rates.inner_race, rates.outer_race, rates.rolling_element, rates.cage)
    for value, known in zip(found, printed, strict=True):
        if known is not None:
            assert value * speed_hz == pytest.approx(known, rel=2e-4)  # diameters and frequencies have four digits


def test_every_row_names_its_source_and_can_be_a_bearing():
    for row in bearing_catalogue():
        assert row.source.endswith(".")
        bearing = gearbox(bearing=row.name).bearings[0]
        assert (bearing.elements, bearing.pitch_diameter_mm) == (row.elements, row.pitch_diameter_mm)


def test_a_bare_designation_is_warned_of():
    with pytest.warns(
        GearboxWarning, match=r'bearing "left": 6205 is taken as that of SKF 6205-2RS JEM.*differs between'
    ):
        gearbox(bearing="6205")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gearbox(bearing="skf 6205-2RS jem")


def test_a_designation_of_several_is_not_guessed():
    with pytest.raises(
        GearboxError, match=r'bearing = "6203" is made in several ways.*"SKF 6203-2RS JEM", "6203 \(Pader'
    ):
        gearbox(bearing="6203")


def test_unknown_and_contradicting_ones_are_refused():
    with pytest.raises(GearboxError, match=r'bearing = "6305" is not in the catalogue'):
        gearbox(bearing="6305")
    with pytest.raises(GearboxError, match=r"elements = 8 contradicts SKF 6205-2RS JEM, which has 9"):
        gearbox(bearing="SKF 6205-2RS JEM", elements=8)
