"""Bearings by designation: geometries of public data sets, each with its source."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files


@dataclass(frozen=True, kw_only=True)
class CatalogueBearing:
    """A bearing of the catalogue.

    Attributes
    ----------
    name : str
        Maker and designation.
    designations : tuple of str
        Designations without a maker, for which the geometry is one among several.
    elements : int
        Rolling elements, of a row.
    element_diameter_mm, pitch_diameter_mm : float
    contact_angle_deg : float
    source : str
        Where the geometry is published.
    """

    name: str
    designations: tuple[str, ...]
    elements: int
    element_diameter_mm: float
    pitch_diameter_mm: float
    contact_angle_deg: float = 0.0
    source: str


@cache
def bearing_catalogue() -> tuple[CatalogueBearing, ...]:
    """Return the bearings of the catalogue.

    Examples
    --------
    >>> from hums.gearbox.bearing_catalogue import bearing_catalogue
    >>> bearing = bearing_catalogue()[0]
    >>> bearing.name, bearing.elements, round(bearing.pitch_diameter_mm, 2)
    ('SKF 6205-2RS JEM', 9, 39.04)
    """
    text = (files("hums.gearbox") / "bearings.toml").read_text(encoding="utf-8")
    return tuple(
        CatalogueBearing(**{**row, "designations": tuple(row["designations"])})
        for row in tomllib.loads(text)["bearing"]
    )


def bearings_named(designation: str) -> tuple[CatalogueBearing, ...]:
    """Return the bearing of a name, or else all bearings of a designation; letters' case and spaces do not count.

    Examples
    --------
    >>> from hums.gearbox.bearing_catalogue import bearings_named
    >>> [bearing.name for bearing in bearings_named("6203")]
    ['SKF 6203-2RS JEM', '6203 (Paderborn)']
    >>> [bearing.name for bearing in bearings_named("skf 6203-2rs jem")]
    ['SKF 6203-2RS JEM']
    """
    wanted = _plain(designation)
    named = tuple(row for row in bearing_catalogue() if _plain(row.name) == wanted)
    return named or tuple(row for row in bearing_catalogue() if wanted in map(_plain, row.designations))


def _plain(name: str) -> str:
    return "".join(name.lower().split())
