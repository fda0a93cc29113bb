"""Bearings by designation: published geometries, and typical ones of a series if the maker publishes none.

Boundary dimensions in `bearing_series.csv` are those of ISO 15 and ISO 355. Its column ``basis`` names the source of
the internal geometry, which a table of `bearings.toml` describes; ``dynamic_rating_n`` and ``static_rating_n`` are load
ratings published by the maker, in N.
"""

import csv
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files

_SERIES = re.compile(r"(?<!\d)(?:(?:NUP|NU|NJ|N)(?=[23]\d\d(?!\d))|(?=(?:6[23]|22[23]|302|320)\d\d(?!\d)))(\d+)")


@dataclass(frozen=True, kw_only=True)
class CatalogueBearing:
    """A bearing of the catalogue.

    Attributes
    ----------
    name : str
        Maker and designation; only the designation for a typical geometry.
    designations : tuple of str
        Designations without maker that include this geometry.
    elements : int
        Rolling elements per row.
    element_diameter_mm, pitch_diameter_mm : float
        Diameters in mm of the rolling elements and of the circle through their centres.
    contact_angle_deg : float
        Contact angle in degrees.
    source : str
        Source of the geometry.
    spread : float
        Relative deviation of defect orders among bearings of the designation; 0 for a published geometry.
    boundary_mm : tuple of float
        Bore, outside diameter and width in mm (total width of a tapered roller bearing); empty if not published.
    """

    name: str
    designations: tuple[str, ...]
    elements: int
    element_diameter_mm: float
    pitch_diameter_mm: float
    contact_angle_deg: float = 0.0
    source: str
    spread: float = 0.0
    boundary_mm: tuple[float, ...] = ()

    @property
    def orders(self) -> tuple[float, float, float, float]:
        """BPFI, BPFO, 2 BSF and FTF per relative revolution of the rings."""
        return rolling_orders(
            self.elements, self.element_diameter_mm / self.pitch_diameter_mm, math.radians(self.contact_angle_deg)
        )


def rolling_orders(elements: int, ratio: float, angle_rad: float) -> tuple[float, float, float, float]:
    """Return BPFI, BPFO, 2 BSF and FTF per relative revolution of the rings, for pure rolling.

    Parameters
    ----------
    elements : int
        Rolling elements per row, Z.
    ratio : float
        Element diameter over pitch diameter, d/D.
    angle_rad : float
        Contact angle a in rad.

    Returns
    -------
    tuple of float
        ``Z/2 (1 +- d/D cos a)``, ``D/d (1 - (d/D cos a)^2)`` and ``(1 - d/D cos a)/2`` (Penaud and Alazard 2010, eq. 6
        to 8, with errata).

    Examples
    --------
    >>> from hums.gearbox.bearing_catalogue import rolling_orders
    >>> [round(order, 3) for order in rolling_orders(9, 0.3126 / 1.537, 0.0)]
    [5.415, 3.585, 4.713, 0.398]
    """
    projected = ratio * math.cos(angle_rad)
    half = elements / 2
    return half * (1 + projected), half * (1 - projected), (1 - projected**2) / ratio, (1 - projected) / 2


@cache
def bearing_catalogue() -> tuple[CatalogueBearing, ...]:
    """Return the bearings of the catalogue: published geometries, then typical ones by series.

    Examples
    --------
    >>> from hums.gearbox.bearing_catalogue import bearing_catalogue
    >>> bearing = bearing_catalogue()[0]
    >>> bearing.name, bearing.elements, round(bearing.pitch_diameter_mm, 2)
    ('SKF 6205-2RS JEM', 9, 39.04)
    """
    folder = files("hums.gearbox")
    tables = tomllib.loads((folder / "bearings.toml").read_text(encoding="utf-8"))
    rows = csv.DictReader((folder / "bearing_series.csv").read_text(encoding="utf-8").splitlines())
    return (
        *(CatalogueBearing(**{**row, "designations": tuple(row["designations"])}) for row in tables["bearing"]),
        *(_of_series(row, **tables["basis"][row["basis"]]) for row in rows),
    )


def _of_series(
    row: Mapping[str, str], *, name: str, source: str, spread: float, open_elements: int
) -> CatalogueBearing:
    designation, elements = row["designation"], int(row["elements"])
    return CatalogueBearing(
        name=name.format(designation),
        designations=(designation,),
        elements=elements,
        element_diameter_mm=float(row["element_diameter_mm"]),
        pitch_diameter_mm=float(row["pitch_diameter_mm"]),
        contact_angle_deg=float(row["contact_angle_deg"]),
        source=source,
        spread=spread + open_elements / elements,
        boundary_mm=tuple(float(row[key]) for key in ("bore_mm", "outside_diameter_mm", "width_mm")),
    )


def bearings_named(designation: str) -> tuple[CatalogueBearing, ...]:
    """Return the bearing with a name, or else all bearings of a designation.

    Case and spaces are ignored; so are, in a designation without its own row, the maker, suffixes for cage, seals and
    clearance, and the flanges of a cylindrical roller bearing.

    Examples
    --------
    >>> from hums.gearbox.bearing_catalogue import bearings_named
    >>> [bearing.name for bearing in bearings_named("6203")]
    ['SKF 6203-2RS JEM', '6203 (Paderborn)', 'TPI 6203']
    >>> [bearing.name for bearing in bearings_named("skf 6203-2rs jem")]
    ['SKF 6203-2RS JEM']
    >>> [bearing.name for bearing in bearings_named("FAG NJ 308-E-TVP2 C3")]
    ['NU308 (typical)']
    """
    wanted, rows = _plain(designation), bearing_catalogue()
    series = _SERIES.search(wanted.upper())
    basic = wanted if series is None else _plain("NU" * (len(series[1]) == len("208")) + series[1])
    named = tuple(row for row in rows if _plain(row.name) == wanted)
    return named or tuple(row for row in rows if {wanted, basic} & set(map(_plain, row.designations)))


def typical_bearing(designation: str, rows: Sequence[CatalogueBearing]) -> CatalogueBearing:
    """Return the bearing of a designation with the median BPFO, and the spread of defect orders.

    Parameters
    ----------
    designation : str
        Name or designation for which `bearings_named` returned the rows.
    rows : sequence of CatalogueBearing
        At least one, all with the same number of rolling elements.

    Returns
    -------
    CatalogueBearing
        The row itself if `designation` is its name. Its `spread` covers the orders of every row.

    Examples
    --------
    >>> from hums.gearbox.bearing_catalogue import bearings_named, typical_bearing
    >>> bearing = typical_bearing("6205", bearings_named("6205"))
    >>> bearing.elements, bearing.pitch_diameter_mm, round(bearing.spread, 3)
    (9, 38.5, 0.015)
    """
    ordered = sorted(rows, key=lambda row: row.orders[1])
    middle = ordered[(len(ordered) - 1) // 2]
    if _plain(middle.name) == _plain(designation) or (len(ordered) == 1 and middle.spread):
        return middle
    spread = max(abs(b / a - 1) for row in rows for a, b in zip(middle.orders, row.orders, strict=True))
    # 1 % between makers with the same number of balls: BPFO differs by 0.4 % among the 6205, 0.9 % among the 6204
    return replace(
        middle,
        name=designation,
        source=f"Typical of its series, check the data sheet: as {middle.name}.",
        spread=max(spread, 0.01, *(row.spread for row in rows)),
    )


def _plain(name: str) -> str:
    return "".join(name.lower().split())


@dataclass(frozen=True, kw_only=True)
class BearingOrders:
    """Rotation and defect orders of one bearing.

    With pure rolling and Z elements, ``inner_race + outer_race = Z relative`` and ``outer_race = Z cage_to_outer``.

    Attributes
    ----------
    name : str
        Name of the bearing.
    relative : float
        Rotation of the rings relative to each other.
    inner_ring, outer_ring, cage : float
        Rotation relative to the load zone, which is fixed in the body that carries the bearing's axis: the frame, or
        the planet carrier for a planet bearing.
    inner_race, outer_race, rolling_element : float
        Impact rates of a defect: BPFI, BPFO and, for both races, 2 BSF.
    cage_to_outer : float
        Rotation of the cage relative to the outer ring.
    elements : int
        Number of rolling elements.
    carried : float
        Rotation of the body that carries the bearing's axis.
    """

    name: str
    relative: float
    inner_ring: float
    outer_ring: float
    inner_race: float
    outer_race: float
    rolling_element: float
    cage: float
    cage_to_outer: float
    elements: int
    carried: float = 0.0
