"""From velocity ratios to the table of defect orders: which component produces which line.

An order counts cycles per revolution of the reference shaft. It is a `Fraction` while teeth alone define it.
Bearing rates follow the rolling kinematics of Penaud and Alazard 2010, eq. 6 to 8, with the errata: the
relative speed multiplies the whole bracket, and the factor D/d of the rolling element keeps the plain
diameters (2 BSF as usually defined).
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from hums.gearbox import Bearing, Gearbox, GearboxError
from hums.kinematics import Contact, Kinematics, solve_kinematics

if TYPE_CHECKING:
    import pandas as pd

KINDS = (
    "shaft",
    "gear_mesh",
    "tooth",
    "planet_pass",
    "planet_tooth",
    "hunting_tooth",
    "assembly_phase",
    "inner_race",
    "outer_race",
    "rolling_element",
    "cage",
)
BEARING_KINDS = ("inner_race", "outer_race", "rolling_element", "cage")


@dataclass(frozen=True, kw_only=True)
class DefectOrder:
    """One row of the table: a component, a kind of defect, and the order at which it repeats."""

    component: str
    kind: str
    exact: Fraction | None
    order: float
    sources: int
    seen_from: str
    sidebands: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class BearingOrders:
    """Rates of one bearing in orders: of its rings against each other, its defects, and its elements.

    With rolling contact and `elements` Z: inner + outer = Z x relative, outer = Z x (cage against outer ring).
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


def defect_orders(
    gearbox: Gearbox | Kinematics,
    *,
    reference: str | None = None,
    speeds: Mapping[str, float | Fraction] | None = None,
) -> "pd.DataFrame":
    """Tabulate every contact of a gearbox that repeats, and how often.

    Parameters
    ----------
    gearbox : Gearbox or Kinematics
    reference : str, optional
        The link whose revolutions orders count; by default the one the gearbox declares.
    speeds : mapping of link name to speed, optional
        Needed where the gearbox has several degrees of freedom; any unit, only ratios matter.

    Returns
    -------
    pandas.DataFrame
        ``component``, ``kind`` (one of `KINDS`), ``order`` (float), ``exact`` (Fraction or None), ``sources``
        (how many physical places share the order), ``seen_from`` (the link the motion is relative to) and
        ``sidebands`` (spacings of the modulation to expect, in orders). What stands still has no row.

    Raises
    ------
    GearboxError
        No reference, a reference at rest, or speeds that do not settle every degree of freedom.
    """
    import pandas as pd  # noqa: PLC0415

    rows = defects(gearbox, reference=reference, speeds=speeds)
    return pd.DataFrame(
        [[row.component, row.kind, row.order, row.exact, row.sources, row.seen_from, row.sidebands] for row in rows],
        columns=["component", "kind", "order", "exact", "sources", "seen_from", "sidebands"],
    )


def defects(
    gearbox: Gearbox | Kinematics,
    *,
    reference: str | None = None,
    speeds: Mapping[str, float | Fraction] | None = None,
) -> tuple[DefectOrder, ...]:
    """Return the rows of `defect_orders` as objects; parameters and errors as there."""
    motion = _Motion.of(gearbox, reference, speeds)
    rows = (*_shafts(motion), *_meshes(motion), *_planets(motion), *_bearings(motion))
    return tuple(row for row in rows if row.order > 0)


def bearing_orders(
    gearbox: Gearbox | Kinematics,
    *,
    reference: str | None = None,
    speeds: Mapping[str, float | Fraction] | None = None,
) -> tuple[BearingOrders, ...]:
    """Return the rates of every bearing, in orders; parameters as in `defect_orders`."""
    motion = _Motion.of(gearbox, reference, speeds)
    return tuple(rates for bearing in motion.gearbox.bearings for rates in _rates_of(motion, bearing))


def bearing_multiples(bearing: Bearing) -> tuple[float, float, float, float, int]:
    """Return inner, outer, element-defect and cage rate per relative turn of the rings, and the elements.

    By geometry ``Z/2 (1 +- d/D cos a)``, ``D/d (1 - (d/D cos a)^2)`` and ``(1 - d/D cos a)/2`` (Penaud and
    Alazard 2010, eq. 6 to 8, with errata); otherwise as printed.
    """
    if bearing.multiples is not None:
        printed = bearing.multiples
        elements = bearing.elements or round(printed.inner + printed.outer)
        return printed.inner, printed.outer, printed.defect, printed.cage, elements
    if bearing.element_diameter_mm is None or bearing.pitch_diameter_mm is None or bearing.elements is None:
        raise GearboxError(f'bearing "{bearing.names[0]}" has neither multiples nor a full geometry.')
    ratio = bearing.element_diameter_mm / bearing.pitch_diameter_mm
    along = ratio * math.cos(math.radians(bearing.contact_angle_deg))
    half = bearing.elements / 2
    return half * (1 + along), half * (1 - along), (1 - along**2) / ratio, (1 - along) / 2, bearing.elements


@dataclass(frozen=True)
class _Motion:
    """A solved mechanism at given speeds; every speed in turns per turn of the reference."""

    kinematics: Kinematics
    rates: Mapping[str, Fraction]
    unit: Fraction
    exact: bool

    @classmethod
    def of(
        cls,
        gearbox: Gearbox | Kinematics,
        reference: str | None,
        speeds: Mapping[str, float | Fraction] | None,
    ) -> "_Motion":
        kinematics = gearbox if isinstance(gearbox, Kinematics) else solve_kinematics(gearbox)
        name = reference or kinematics.gearbox.reference
        if name is None:
            raise GearboxError(
                f'gearbox "{kinematics.gearbox.name}" declares no reference shaft to count orders by; '
                'add reference = "LINK" or pass reference="LINK".'
            )
        form = kinematics.spin(name)
        if not form:
            raise GearboxError(f'the reference "{name}" is the frame, which does not turn; name a shaft.')
        rates = kinematics.rates({name: Fraction(1)} if speeds is None else speeds)
        unit = abs(sum((factor * rates[body] for body, factor in form.items()), Fraction(0)))
        if unit == 0:
            raise GearboxError(f'the reference "{name}" does not turn, so orders cannot be counted by it.')
        exact = speeds is None or all(isinstance(speed, int | Fraction) for speed in speeds.values())
        return cls(kinematics, rates, unit, exact)

    @property
    def gearbox(self) -> Gearbox:
        return self.kinematics.gearbox

    def speed(self, link: str, seen_from: str) -> Fraction:
        form = self.kinematics.spin(link, seen_from=seen_from)
        return sum((factor * self.rates[body] for body, factor in form.items()), Fraction(0)) / self.unit

    def row(
        self,
        component: str,
        kind: str,
        order: Fraction,
        *,
        sources: int,
        seen_from: str,
        sidebands: tuple[Fraction, ...] = (),
    ) -> DefectOrder:
        size = abs(order)
        return DefectOrder(
            component=component,
            kind=kind,
            exact=size if self.exact else None,
            order=float(size),
            sources=sources,
            seen_from=seen_from,
            sidebands=tuple(float(abs(spacing)) for spacing in dict.fromkeys(sidebands)),
        )


def _shafts(motion: _Motion) -> Iterator[DefectOrder]:
    """Links that turn about an axis fixed in the frame."""
    kinematics, frame = motion.kinematics, motion.gearbox.frame
    for body, joint in kinematics.joints.items():
        if joint.carried_by == kinematics.bodies[frame]:
            yield motion.row(body, "shaft", motion.speed(body, frame), sources=1, seen_from=frame)


def _meshes(motion: _Motion) -> Iterator[DefectOrder]:
    """Mesh, tooth, hunting-tooth and assembly-phase orders; the copies of a mesh share one row."""
    contacts: dict[str, list[Contact]] = {}
    for contact in motion.kinematics.contacts:
        contacts.setdefault(contact.mesh, []).append(contact)
    for name, alike in contacts.items():
        first, count = alike[0], len(alike)
        teeth = [abs(number) for _, number in first.gears]
        turns = [motion.speed(link, first.carrier) for link, _ in first.gears]
        mesh = teeth[0] * turns[0]
        yield motion.row(name, "gear_mesh", mesh, sources=count, seen_from=first.carrier, sidebands=tuple(turns))
        for (link, number), turn in zip(first.gears, turns, strict=True):
            declared = _declared(motion.gearbox, link)
            copies = len(motion.gearbox.instances(declared))
            # a gear that meets every planet has each of its teeth struck once a planet and turn
            yield motion.row(
                f"{name}/{declared}",
                "tooth",
                turn * count / copies,
                sources=abs(number) * copies,
                seen_from=first.carrier,
            )
        if len(teeth) == 2:  # noqa: PLR2004
            yield motion.row(name, "hunting_tooth", mesh / math.lcm(*teeth), sources=count, seen_from=first.carrier)
            yield motion.row(name, "assembly_phase", mesh / math.gcd(*teeth), sources=count, seen_from=first.carrier)


def _planets(motion: _Motion) -> Iterator[DefectOrder]:
    """Planets passing a sensor on the frame, and planet teeth, which meet one gear after the other."""
    frame = motion.gearbox.frame
    for link, copies in motion.gearbox.copied.items():
        first = motion.gearbox.instances(link)[0]
        met = [c for c in motion.kinematics.contacts if first in (name for name, _ in c.gears)]
        carrier = motion.kinematics.joints[motion.kinematics.bodies[first]].carried_by
        passing = copies * motion.speed(carrier, frame)
        if first in motion.kinematics.joints:  # a planet, not a second gear on one
            yield motion.row(f"{link} pass", "planet_pass", passing, sources=1, seen_from=frame)
        if len(met) > 1:
            number = max(abs(teeth) for contact in met for name, teeth in contact.gears if name == first)
            yield motion.row(
                link,
                "planet_tooth",
                len(met) * motion.speed(first, carrier),
                sources=number * copies,
                seen_from=carrier,
            )


def _bearings(motion: _Motion) -> Iterator[DefectOrder]:
    for bearing in motion.gearbox.bearings:
        copies = _copies(motion.gearbox, bearing)
        for rates in _rates_of(motion, bearing):
            inner, outer = (rates.inner_ring,), (rates.outer_ring,)
            for kind, order, sources, seen_from, sidebands in (
                ("inner_race", rates.inner_race, copies, bearing.inner_ring, inner),
                ("outer_race", rates.outer_race, copies, bearing.outer_ring, outer),
                ("rolling_element", rates.rolling_element, copies * rates.elements, "cage", (rates.cage,)),
                ("cage", rates.cage, copies, motion.gearbox.frame, ()),
            ):
                spacings = tuple(abs(spacing) for spacing in sidebands if spacing)
                yield DefectOrder(
                    component=rates.name,
                    kind=kind,
                    exact=None,
                    order=order,
                    sources=sources,
                    seen_from=seen_from,
                    sidebands=spacings,
                )


def _rates_of(motion: _Motion, bearing: Bearing) -> Iterator[BearingOrders]:
    inner_race, outer_race, defect, cage, elements = bearing_multiples(bearing)
    inner, outer = (motion.gearbox.instances(ring)[0] for ring in (bearing.inner_ring, bearing.outer_ring))
    frame = motion.gearbox.frame
    relative = float(motion.speed(inner, outer))
    ring_speeds = [float(motion.speed(ring, frame)) for ring in (inner, outer)]
    for name in bearing.names:
        yield BearingOrders(
            name=name,
            relative=abs(relative),
            inner_ring=ring_speeds[0],
            outer_ring=ring_speeds[1],
            inner_race=inner_race * abs(relative),
            outer_race=outer_race * abs(relative),
            rolling_element=defect * abs(relative),
            cage=abs(ring_speeds[1] + cage * relative),
            cage_to_outer=cage * abs(relative),
            elements=elements,
        )


def _declared(gearbox: Gearbox, instance: str) -> str:
    return next(link for link in (*gearbox.copied, instance) if instance in (*gearbox.instances(link), link))


def _copies(gearbox: Gearbox, bearing: Bearing) -> int:
    return max(len(gearbox.instances(ring)) for ring in (bearing.inner_ring, bearing.outer_ring))
