"""Defect orders: the orders at which the components of a gearbox excite vibration, from its velocity ratios.

An order is a number of cycles per revolution of the reference shaft, a `Fraction` if tooth numbers alone determine it.
Bearing rates follow the rolling kinematics of Penaud and Alazard 2010, eq. 6 to 8, with the errata: the relative speed
multiplies the whole bracket, and the factor D/d of the rolling element has the plain diameters (2 BSF as usually
defined).

The sideband spacing is the rate of the modulation: the rotation of a damaged part relative to its load and, if a planet
carrier moves the contact, the rate of planets passing a sensor on the frame.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from hums.gearbox.bearing_catalogue import BearingOrders, rolling_orders
from hums.gearbox.components import Bearing
from hums.gearbox.kinematics import Kinematics, solve_kinematics
from hums.gearbox.model import Gearbox, GearboxError
from hums.gearbox.rational import evaluate
from signals._validation import checked

if TYPE_CHECKING:
    import pandas as pd

    from hums.gearbox.mechanism import Contact


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
COLUMNS = ("component", "kind", "order", "exact", "sources", "seen_from", "sidebands")
BEARING_KINDS = ("inner_race", "outer_race", "rolling_element", "cage")


@dataclass(frozen=True, kw_only=True)
class DefectOrder:
    """One row of `defect_orders`: a component, a kind of defect, and its order; attributes are its columns.

    `tolerance`, not a column, is the declared relative tolerance of the orders of a bearing.
    """

    component: str
    kind: str
    exact: Fraction | None
    order: float
    sources: int
    seen_from: str
    sidebands: tuple[Fraction | float, ...] = ()
    tolerance: float = 0.0


@checked
def defect_orders(
    gearbox: Gearbox | Kinematics,
    *,
    reference: str | None = None,
    speeds: Mapping[str, float | Fraction] | None = None,
) -> "pd.DataFrame":
    """Return the table of defect orders of a gearbox: shafts, meshes, teeth, planets and bearings.

    Parameters
    ----------
    gearbox : Gearbox or Kinematics
        Gearbox, or its kinematics if `solve_kinematics` was given further constraints.
    reference : str, optional
        Reference shaft of the orders. Default: as declared by the gearbox.
    speeds : mapping of str to float or Fraction, optional
        Speeds of links, required if the gearbox has several degrees of freedom; in any unit, as only ratios matter.

    Returns
    -------
    pandas.DataFrame
        ``component``; ``kind``, one of `KINDS`; ``order``, cycles per revolution of the reference; ``exact``, the
        order as a Fraction if tooth numbers alone determine it, else None; ``sources``, the number of teeth, elements
        or meshes that share the order; ``seen_from``, the link relative to which the motion is; ``sidebands``, expected
        sideband spacings in orders (Fractions if exact). Components at rest have no row.

    Raises
    ------
    GearboxError
        If there is no reference or it is at rest, or speeds are missing or contradictory.

    Notes
    -----
    A bearing with Z elements of diameter d on pitch diameter D at contact angle a has, per relative revolution of its
    rings, the inner and outer race orders ``Z/2 (1 +- d/D cos a)`` and the element order ``D/d (1 - (d/D cos a)^2)``.

    Examples
    --------
    >>> import hums
    >>> table = hums.defect_orders(hums.load_gearbox("planetary-27-36-99")).set_index(["component", "kind"])
    >>> print(table.exact["sun-planet", "gear_mesh"])  # 99 teeth of the ring x 3/14 of the carrier
    297/14
    >>> print(table.exact["planet pass", "planet_pass"])  # 3 planets
    9/14
    """
    import pandas as pd  # noqa: PLC0415

    rows = defects(gearbox, reference=reference, speeds=speeds)
    # typed columns, as pandas takes several times as long from rows
    numbers = {"order": np.float64, "sources": np.int64}
    columns = {name: np.empty(len(rows), dtype=numbers.get(name, object)) for name in COLUMNS}
    for number, row in enumerate(rows):
        for name, column in columns.items():
            column[number] = getattr(row, name)
    return pd.DataFrame(columns, copy=False)


def defects(
    gearbox: Gearbox | Kinematics,
    *,
    reference: str | None = None,
    speeds: Mapping[str, float | Fraction] | None = None,
) -> tuple[DefectOrder, ...]:
    """Return the rows of `defect_orders` as objects, with the same parameters and errors."""
    rows = _rows(_Motion.of(gearbox, reference, speeds))
    return tuple(_unsigned(row) for row in rows if row.order)


@dataclass(frozen=True, kw_only=True)
class RateForm:
    """A defect rate as a linear form in the speeds of some links, of which it is the magnitude.

    Attributes
    ----------
    component, kind, seen_from : str
    sources : int
        As in `defect_orders`.
    factors : tuple of Fraction or float
        Factor of each speed; Fractions if tooth numbers alone determine them.
    """

    component: str
    kind: str
    sources: int
    seen_from: str
    factors: tuple[Fraction, ...] | tuple[float, ...]


def rate_forms(kinematics: Kinematics, inputs: Sequence[str]) -> tuple[RateForm, ...]:
    """Return every defect rate as a linear form in the speeds of as many links as there are degrees of freedom.

    Parameters
    ----------
    kinematics : Kinematics
        From `solve_kinematics`.
    inputs : sequence of str
        Links whose speeds determine all others.

    Returns
    -------
    tuple of RateForm
        Rows as in `defect_orders`, without those that are zero at all speeds.

    Examples
    --------
    >>> import hums
    >>> from hums.gearbox.defect_orders import rate_forms
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("glinsky-planetary-1"))
    >>> mesh = next(row for row in rate_forms(kinematics, ["sun", "carrier"]) if row.kind == "gear_mesh")
    >>> [str(factor) for factor in mesh.factors]  # 24 teeth, seen from the carrier
    ['24', '-24']
    """
    at_one = [kinematics.rates({link: Fraction(link == name) for link in inputs}) for name in inputs]
    tables = [_rows(_Motion(kinematics, rates, exact=True)) for rates in at_one]
    forms = []
    for rows in zip(*tables, strict=True):
        first, exact = rows[0], [row.exact for row in rows if row.exact is not None]
        factors = tuple(exact) if len(exact) == len(rows) else tuple(row.order for row in rows)
        if any(factors):
            forms.append(
                RateForm(
                    component=first.component,
                    kind=first.kind,
                    sources=first.sources,
                    seen_from=first.seen_from,
                    factors=factors,
                )
            )
    return tuple(forms)


def _rows(motion: "_Motion") -> tuple[DefectOrder, ...]:
    """Return all rows with their signs, in an order that does not depend on speeds."""
    return (*_shafts(motion), *_meshes(motion), *_planets(motion), *_bearings(motion))


def _unsigned(row: DefectOrder) -> DefectOrder:
    return row if row.order > 0 else replace(row, order=-row.order, exact=None if row.exact is None else -row.exact)


def bearing_orders(
    gearbox: Gearbox | Kinematics,
    *,
    reference: str | None = None,
    speeds: Mapping[str, float | Fraction] | None = None,
) -> tuple[BearingOrders, ...]:
    """Return the rotation and defect orders of every bearing, with the parameters of `defect_orders`."""
    motion = _Motion.of(gearbox, reference, speeds)
    return tuple(rates for bearing in motion.gearbox.bearings for rates in _rates_of(motion, bearing))


def bearing_multiples(bearing: Bearing) -> tuple[float, float, float, float, int]:
    """Return BPFI, BPFO, 2 BSF and FTF of a bearing per relative revolution of its rings, and its element count."""
    if bearing.multiples is not None:
        declared = bearing.multiples
        elements = bearing.elements or round(declared.inner + declared.outer)
        return declared.inner, declared.outer, declared.defect, declared.cage, elements
    if bearing.element_diameter_mm is None or bearing.pitch_diameter_mm is None or bearing.elements is None:
        raise GearboxError(f'bearing "{bearing.names[0]}" has neither multiples nor a full geometry.')
    ratio = bearing.element_diameter_mm / bearing.pitch_diameter_mm
    return (*rolling_orders(bearing.elements, ratio, math.radians(bearing.contact_angle_deg)), bearing.elements)


@dataclass(frozen=True)
class _Motion:
    """A mechanism at given speeds, in revolutions per revolution of the reference.

    `exact` states whether tooth numbers and exact speeds alone determine them.
    """

    kinematics: Kinematics
    rates: Mapping[str, Fraction]
    exact: bool

    @classmethod
    def of(
        cls,
        gearbox: Gearbox | Kinematics,
        reference: str | None,
        speeds: Mapping[str, float | Fraction] | None,
    ) -> "_Motion":
        """Return speeds relative to that of the reference shaft; GearboxError if there is none or it is at rest."""
        kinematics = gearbox if isinstance(gearbox, Kinematics) else solve_kinematics(gearbox)
        name = reference or kinematics.gearbox.reference
        if name is None:
            raise GearboxError(
                f'gearbox "{kinematics.gearbox.name}" declares no reference shaft for its orders; '
                'add reference = "LINK" or pass reference="LINK".'
            )
        form = kinematics.spin(name)
        if not form:
            raise GearboxError(f'the reference "{name}" is the frame, which does not rotate; name a shaft.')
        rates = kinematics.rates({name: Fraction(1)} if speeds is None else speeds)
        unit = abs(evaluate(form, rates))
        if unit == 0:
            raise GearboxError(f'the reference "{name}" does not rotate at these speeds; name another shaft.')
        # with one degree of freedom any speed cancels, so tooth numbers alone determine the ratios
        given = () if speeds is None or kinematics.dof == 1 else speeds.values()
        exact = all(isinstance(speed, int | Fraction) for speed in given)
        if unit != 1:
            rates = {body: rate / unit for body, rate in rates.items()}
        return cls(kinematics, rates, exact)

    @property
    def gearbox(self) -> Gearbox:
        return self.kinematics.gearbox

    def speed(self, link: str, seen_from: str) -> Fraction:
        form = self.kinematics.spin(link, seen_from=seen_from)
        return evaluate(form, self.rates)

    def rotation(self, link: str) -> Fraction:
        """Return the speed of a link relative to the body that carries its axis; 0 for the frame."""
        return self.rates.get(self.kinematics.bodies[link], Fraction(0))

    def carrier(self, link: str) -> str:
        """Return the body that carries a link's axis; the frame for the frame itself."""
        joint = self.kinematics.joints.get(self.kinematics.bodies[link])
        return self.kinematics.mechanism.frame if joint is None else joint.carried_by

    def spacings(self, *speeds: Fraction | float) -> tuple[Fraction | float, ...]:
        """Return the distinct non-zero magnitudes of some speeds, as fractions if exact."""
        moving = (speed if self.exact else float(speed) for speed in speeds if speed)
        return tuple(dict.fromkeys(-speed if speed < 0 else speed for speed in moving))

    def row(
        self,
        component: str,
        kind: str,
        order: Fraction,
        *,
        sources: int,
        seen_from: str,
        sidebands: tuple[Fraction | float, ...] = (),
    ) -> DefectOrder:
        """Return a row of the table of defect orders, with the sign of its rate."""
        return DefectOrder(
            component=component,
            kind=kind,
            exact=order if self.exact else None,
            order=float(order),
            sources=sources,
            seen_from=seen_from,
            sidebands=sidebands,
        )


def _shafts(motion: _Motion) -> Iterator[DefectOrder]:
    """Yield the rows of the links whose axis is fixed in the frame."""
    frame = motion.kinematics.mechanism.frame
    for body in motion.kinematics.joints:
        if motion.carrier(body) == frame:
            yield motion.row(body, "shaft", motion.rotation(body), sources=1, seen_from=frame)


def _meshes(motion: _Motion) -> Iterator[DefectOrder]:
    """Yield the rows of mesh, tooth, hunting tooth and assembly phase; the copies of a mesh share one row."""
    contacts: dict[str, list[Contact]] = {}
    for contact in motion.kinematics.contacts:
        contacts.setdefault(contact.mesh, []).append(contact)
    for name, copies_of_mesh in contacts.items():
        first, count = copies_of_mesh[0], len(copies_of_mesh)
        seen_from, carrier_speed = first.carrier, motion.rotation(first.carrier)
        teeth = [abs(number) for _, number in first.gears]
        speeds = [motion.speed(link, first.carrier) for link, _ in first.gears]
        mesh = teeth[0] * speeds[0]
        sidebands = motion.spacings(*speeds, count * carrier_speed)
        yield motion.row(name, "gear_mesh", mesh, sources=count, seen_from=seen_from, sidebands=sidebands)
        for (link, number), speed in zip(first.gears, speeds, strict=True):
            declared = _declared(motion.gearbox, link)
            copies = len(motion.gearbox.instances(declared))
            # a tooth of a gear that meshes with every planet is in contact once per planet and revolution: its impacts
            # are modulated by the gear's own rotation, those of a planet's tooth by the carrier's
            modulation = (
                motion.rotation(link) if count > copies or motion.carrier(link) != first.carrier else carrier_speed
            )
            yield motion.row(
                f"{name}/{declared}",
                "tooth",
                speed if count == copies else speed * count / copies,
                sources=abs(number) * copies,
                seen_from=seen_from,
                sidebands=motion.spacings(modulation),
            )
        if len(teeth) == 2:  # noqa: PLR2004
            yield motion.row(name, "hunting_tooth", mesh / math.lcm(*teeth), sources=count, seen_from=seen_from)
            yield motion.row(name, "assembly_phase", mesh / math.gcd(*teeth), sources=count, seen_from=seen_from)


def _planets(motion: _Motion) -> Iterator[DefectOrder]:
    """Yield the rows of planets passing a sensor, and of planet teeth, which mesh with one gear after the other."""
    kinematics = motion.kinematics
    gears = [gear for contact in kinematics.contacts for gear in contact.gears]
    toothed = {kinematics.bodies[link] for link, _ in gears}
    for link in dict.fromkeys(_declared(motion.gearbox, name) for name in motion.gearbox.links):
        first, copies = motion.gearbox.instances(link)[0], len(motion.gearbox.instances(link))
        carrier = motion.carrier(first)
        if carrier == kinematics.mechanism.frame and copies == 1:
            continue
        teeth = [abs(number) for name, number in gears if name == first]  # one entry per mesh
        carrier_speed, body = motion.rotation(carrier), kinematics.bodies[first]
        if first == body and body in toothed:  # not for the second gear of a stepped planet
            seen_from = motion.carrier(carrier)
            yield motion.row(f"{link} pass", "planet_pass", copies * carrier_speed, sources=1, seen_from=seen_from)
        if len(teeth) > 1:
            yield motion.row(
                link,
                "planet_tooth",
                len(teeth) * motion.rotation(first),
                sources=max(teeth) * copies,
                seen_from=carrier,
                sidebands=motion.spacings(carrier_speed),
            )


def _bearings(motion: _Motion) -> Iterator[DefectOrder]:
    """Yield the rows of inner race, outer race, rolling element and cage of every bearing."""
    for bearing in motion.gearbox.bearings:
        copies = max(len(motion.gearbox.instances(ring)) for ring in (bearing.inner_ring, bearing.outer_ring))
        carrier, inner, outer = _rings(motion, bearing)
        carrier_speed = motion.rotation(carrier)
        inner_race, outer_race, defect, cage_share, count = bearing_multiples(bearing)
        relative = float(inner - outer)
        cage_rate = float(outer) + cage_share * relative
        for name in bearing.names:
            cage = f"{name} cage"
            for kind, order, sources, seen_from, modulation in (
                ("inner_race", inner_race * relative, copies, bearing.inner_ring, (inner, carrier_speed)),
                ("outer_race", outer_race * relative, copies, bearing.outer_ring, (outer, carrier_speed)),
                ("rolling_element", defect * relative, copies * count, cage, (cage_rate, carrier_speed)),
                ("cage", cage_rate, copies, carrier, ()),
            ):
                yield DefectOrder(
                    component=name,
                    kind=kind,
                    exact=None,
                    order=order,
                    sources=sources,
                    seen_from=seen_from,
                    sidebands=motion.spacings(*modulation),
                    tolerance=bearing.order_tolerance,
                )


def _rates_of(motion: _Motion, bearing: Bearing) -> Iterator[BearingOrders]:
    """Yield the orders of each of the bearings that one declaration names."""
    inner_race, outer_race, defect, cage, elements = bearing_multiples(bearing)
    carrier, inner, outer = _rings(motion, bearing)
    relative = float(inner - outer)
    for name in bearing.names:
        yield BearingOrders(
            name=name,
            relative=abs(relative),
            inner_ring=float(inner),
            outer_ring=float(outer),
            inner_race=inner_race * abs(relative),
            outer_race=outer_race * abs(relative),
            rolling_element=defect * abs(relative),
            cage=abs(float(outer) + cage * relative),
            cage_to_outer=cage * abs(relative),
            elements=elements,
            carried=float(motion.rotation(carrier)),
        )


def _rings(motion: _Motion, bearing: Bearing) -> tuple[str, Fraction, Fraction]:
    """Return the body that carries a bearing's axis, and the speeds of inner and outer ring relative to it."""
    rings = [motion.gearbox.instances(ring)[0] for ring in (bearing.inner_ring, bearing.outer_ring)]
    bodies = [motion.kinematics.bodies[ring] for ring in rings]
    # one of the rings of a planet's bearing is its carrier
    carriers = [motion.carrier(body) for body in bodies]
    carrier = next((body for body in carriers if body in bodies), carriers[0])
    inner, outer = (motion.speed(ring, carrier) for ring in rings)
    return carrier, inner, outer


def _declared(gearbox: Gearbox, instance: str) -> str:
    """Return the declared link of a copy, ``planet`` for ``planet 2``."""
    return next(link for link in (*gearbox.copied, instance) if instance in (*gearbox.instances(link), link))
