"""From velocity ratios to the table of defect orders: which component produces which line.

An order counts cycles per revolution of the reference shaft. It is a `Fraction` while teeth alone define it.
Bearing rates follow the rolling kinematics of Penaud and Alazard 2010, eq. 6 to 8, with the errata: the
relative speed multiplies the whole bracket, and the factor D/d of the rolling element keeps the plain
diameters (2 BSF as usually defined) unless the paper's variant is asked for.

Sidebands lie apart by the rate of what modulates a line: the turning of a damaged part through its load, and,
where a contact is carried round, its passing of a sensor on the frame.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from hums._forms import evaluate
from hums.gearbox import Bearing, Gearbox, GearboxError, closest
from hums.kinematics import Kinematics, solve_kinematics

if TYPE_CHECKING:
    import pandas as pd

    from hums.mechanism import Contact

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
ElementFormula = Literal["usual", "projected_diameter"]


@dataclass(frozen=True, kw_only=True)
class DefectOrder:
    """One row of the table: a component, a kind of defect, and the order at which it repeats.

    The spacings in `sidebands` are Fractions while teeth alone define them, like `exact`, and floats otherwise.
    """

    component: str
    kind: str
    exact: Fraction | None
    order: float
    sources: int
    seen_from: str
    sidebands: tuple[Fraction | float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class BearingOrders:
    """Rates of one bearing in orders: of its rings against each other, its defects, and its elements.

    With rolling contact and `elements` Z: inner + outer = Z x relative, outer = Z x (cage against outer ring).
    `inner_ring`, `outer_ring` and `cage` turn as the load zone sees them, which rests in the body that carries the
    bearing's axis: the frame, or for a planet's bearing the planet carrier. `carried` is that body's own turning.
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


def defect_orders(
    gearbox: Gearbox | Kinematics,
    *,
    reference: str | None = None,
    speeds: Mapping[str, float | Fraction] | None = None,
    element_formula: ElementFormula = "usual",
) -> "pd.DataFrame":
    """Tabulate every contact of a gearbox that repeats, and how often.

    Parameters
    ----------
    gearbox : Gearbox or Kinematics
    reference : str, optional
        The link whose revolutions orders count; by default the one the gearbox declares.
    speeds : mapping of link name to speed, optional
        Needed where the gearbox has several degrees of freedom; any unit, only ratios matter.
    element_formula : {"usual", "projected_diameter"}
        How often a spot of a rolling element is struck, where a bearing is given by its geometry; see
        `bearing_multiples`.

    Returns
    -------
    pandas.DataFrame
        ``component``, ``kind`` (one of `KINDS`), ``order`` (float), ``exact`` (Fraction or None), ``sources``
        (how many physical places share the order), ``seen_from`` (the link the motion is relative to) and
        ``sidebands`` (spacings of the modulation to expect, in orders: Fractions while exact, floats
        otherwise). What stands still has no row.

    Raises
    ------
    GearboxError
        No reference, a reference at rest, speeds that do not settle every degree of freedom, or an unknown
        `element_formula`.
    """
    import pandas as pd  # noqa: PLC0415

    rows = defects(gearbox, reference=reference, speeds=speeds, element_formula=element_formula)
    # column by column and typed: from rows pandas takes several times as long
    numbers = {"order": np.float64, "sources": np.int64}
    columns = {name: np.empty(len(rows), dtype=numbers.get(name, object)) for name in COLUMNS}
    for place, row in enumerate(rows):
        for name, column in columns.items():
            column[place] = getattr(row, name)
    return pd.DataFrame(columns, copy=False)


def defects(
    gearbox: Gearbox | Kinematics,
    *,
    reference: str | None = None,
    speeds: Mapping[str, float | Fraction] | None = None,
    element_formula: ElementFormula = "usual",
) -> tuple[DefectOrder, ...]:
    """Return the rows of `defect_orders` as objects; parameters and errors as there."""
    motion = _Motion.of(gearbox, reference, speeds)
    rows = (*_shafts(motion), *_meshes(motion), *_planets(motion), *_bearings(motion, element_formula))
    return tuple(row for row in rows if row.order > 0)


def bearing_orders(
    gearbox: Gearbox | Kinematics,
    *,
    reference: str | None = None,
    speeds: Mapping[str, float | Fraction] | None = None,
    element_formula: ElementFormula = "usual",
) -> tuple[BearingOrders, ...]:
    """Return the rates of every bearing, in orders; parameters as in `defect_orders`."""
    motion = _Motion.of(gearbox, reference, speeds)
    return tuple(rates for bearing in motion.gearbox.bearings for rates in _rates_of(motion, bearing, element_formula))


def bearing_multiples(
    bearing: Bearing, *, element_formula: ElementFormula = "usual"
) -> tuple[float, float, float, float, int]:
    """Return inner, outer, element-defect and cage rate per relative turn of the rings, and the elements.

    By geometry ``Z/2 (1 +- d/D cos a)``, ``D/d (1 - (d/D cos a)^2)`` and ``(1 - d/D cos a)/2`` (Penaud and
    Alazard 2010, eq. 6 to 8, with errata); otherwise as printed. The element formula ``"projected_diameter"``
    is the paper's own, with ``d cos a`` for ``d`` also in the factor ``D/d``: ``D/(d cos a) (1 - (d/D cos a)^2)``.
    """
    known = list(get_args(ElementFormula))
    if element_formula not in known:
        raise GearboxError(f'element_formula = "{element_formula}" is unknown{closest(str(element_formula), known)}')
    if bearing.multiples is not None:
        printed = bearing.multiples
        elements = bearing.elements or round(printed.inner + printed.outer)
        return printed.inner, printed.outer, printed.defect, printed.cage, elements
    if bearing.element_diameter_mm is None or bearing.pitch_diameter_mm is None or bearing.elements is None:
        raise GearboxError(f'bearing "{bearing.names[0]}" has neither multiples nor a full geometry.')
    ratio = bearing.element_diameter_mm / bearing.pitch_diameter_mm
    along = ratio * math.cos(math.radians(bearing.contact_angle_deg))
    half = bearing.elements / 2
    defect = (1 - along**2) / (along if element_formula == "projected_diameter" else ratio)
    return half * (1 + along), half * (1 - along), defect, (1 - along) / 2, bearing.elements


@dataclass(frozen=True)
class _Motion:
    """A solved mechanism at given speeds; every speed in turns per turn of the reference."""

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
        unit = abs(evaluate(form, rates))
        if unit == 0:
            raise GearboxError(f'the reference "{name}" does not turn, so orders cannot be counted by it.')
        # with one degree of freedom any speed cancels, so teeth alone define the ratios
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

    def turn(self, link: str) -> Fraction:
        """Return a link's turning as the body that carries its axis sees it; 0 for the frame."""
        return self.rates.get(self.kinematics.bodies[link], Fraction(0))

    def holder(self, link: str) -> str:
        """Return the body that carries a link's axis; the frame for the frame itself."""
        joint = self.kinematics.joints.get(self.kinematics.bodies[link])
        return self.kinematics.mechanism.frame if joint is None else joint.carried_by

    def spacings(self, *turns: Fraction | float) -> tuple[Fraction | float, ...]:
        """Return the sizes of some rates, each once: exact where possible, those at rest left out."""
        moving = (turn if self.exact else float(turn) for turn in turns if turn)
        return tuple(dict.fromkeys(-turn if turn < 0 else turn for turn in moving))

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
        size = -order if order < 0 else order
        return DefectOrder(
            component=component,
            kind=kind,
            exact=size if self.exact else None,
            order=float(size),
            sources=sources,
            seen_from=seen_from,
            sidebands=sidebands,
        )


def _shafts(motion: _Motion) -> Iterator[DefectOrder]:
    """Links that turn about an axis fixed in the frame."""
    frame = motion.kinematics.mechanism.frame
    for body in motion.kinematics.joints:
        if motion.holder(body) == frame:
            yield motion.row(body, "shaft", motion.turn(body), sources=1, seen_from=frame)


def _meshes(motion: _Motion) -> Iterator[DefectOrder]:
    """Mesh, tooth, hunting-tooth and assembly-phase orders; the copies of a mesh share one row."""
    contacts: dict[str, list[Contact]] = {}
    for contact in motion.kinematics.contacts:
        contacts.setdefault(contact.mesh, []).append(contact)
    for name, alike in contacts.items():
        first, count = alike[0], len(alike)
        seen_from, passing = first.carrier, motion.turn(first.carrier)
        teeth = [abs(number) for _, number in first.gears]
        turns = [motion.speed(link, first.carrier) for link, _ in first.gears]
        mesh = teeth[0] * turns[0]
        beside = motion.spacings(*turns, count * passing)
        yield motion.row(name, "gear_mesh", mesh, sources=count, seen_from=seen_from, sidebands=beside)
        for (link, number), turn in zip(first.gears, turns, strict=True):
            declared = _declared(motion.gearbox, link)
            copies = len(motion.gearbox.instances(declared))
            # a gear that meets every planet has each of its teeth struck once a planet and turn, wherever in the
            # gear's own turn that happens; a planet's tooth is struck where the carrier has taken it
            moving = motion.turn(link) if count > copies or motion.holder(link) != first.carrier else passing
            yield motion.row(
                f"{name}/{declared}",
                "tooth",
                turn if count == copies else turn * count / copies,
                sources=abs(number) * copies,
                seen_from=seen_from,
                sidebands=motion.spacings(moving),
            )
        if len(teeth) == 2:  # noqa: PLR2004
            yield motion.row(name, "hunting_tooth", mesh / math.lcm(*teeth), sources=count, seen_from=seen_from)
            yield motion.row(name, "assembly_phase", mesh / math.gcd(*teeth), sources=count, seen_from=seen_from)


def _planets(motion: _Motion) -> Iterator[DefectOrder]:
    """Planets passing a sensor, and planet teeth, which meet one gear after the other."""
    kinematics = motion.kinematics
    gears = [gear for contact in kinematics.contacts for gear in contact.gears]
    toothed = {kinematics.bodies[link] for link, _ in gears}
    for link in dict.fromkeys(_declared(motion.gearbox, name) for name in motion.gearbox.links):
        first, copies = motion.gearbox.instances(link)[0], len(motion.gearbox.instances(link))
        carrier = motion.holder(first)
        if carrier == kinematics.mechanism.frame and copies == 1:
            continue
        met = [abs(number) for name, number in gears if name == first]
        passing, body = motion.turn(carrier), kinematics.bodies[first]
        if first == body and body in toothed:  # a planet, not a second gear on one
            around = motion.holder(carrier)
            yield motion.row(f"{link} pass", "planet_pass", copies * passing, sources=1, seen_from=around)
        if len(met) > 1:
            yield motion.row(
                link,
                "planet_tooth",
                len(met) * motion.turn(first),
                sources=max(met) * copies,
                seen_from=carrier,
                sidebands=motion.spacings(passing),
            )


def _bearings(motion: _Motion, formula: ElementFormula) -> Iterator[DefectOrder]:
    for bearing in motion.gearbox.bearings:
        copies = _copies(motion.gearbox, bearing)
        held, inner, outer = _rings(motion, bearing)
        carried = motion.turn(held)
        for rates in _rates_of(motion, bearing, formula):
            struck, cage = copies * rates.elements, f"{rates.name} cage"
            for kind, order, sources, seen_from, turns in (
                ("inner_race", rates.inner_race, copies, bearing.inner_ring, (inner, carried)),
                ("outer_race", rates.outer_race, copies, bearing.outer_ring, (outer, carried)),
                ("rolling_element", rates.rolling_element, struck, cage, (rates.cage, carried)),
                ("cage", rates.cage, copies, held, ()),
            ):
                yield DefectOrder(
                    component=rates.name,
                    kind=kind,
                    exact=None,
                    order=order,
                    sources=sources,
                    seen_from=seen_from,
                    sidebands=motion.spacings(*turns),
                )


def _rates_of(motion: _Motion, bearing: Bearing, formula: ElementFormula) -> Iterator[BearingOrders]:
    inner_race, outer_race, defect, cage, elements = bearing_multiples(bearing, element_formula=formula)
    held, inner, outer = _rings(motion, bearing)
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
            carried=float(motion.turn(held)),
        )


def _rings(motion: _Motion, bearing: Bearing) -> tuple[str, Fraction, Fraction]:
    """Return the body that carries a bearing's axis, and how fast it sees the inner and the outer ring turn."""
    rings = [motion.gearbox.instances(ring)[0] for ring in (bearing.inner_ring, bearing.outer_ring)]
    bodies = [motion.kinematics.bodies[ring] for ring in rings]
    # a planet's bearing sits on its carrier, which is one of the rings
    held = next((motion.holder(body) for body in bodies if motion.holder(body) in bodies), motion.holder(bodies[0]))
    inner, outer = (motion.speed(ring, held) for ring in rings)
    return held, inner, outer


def _declared(gearbox: Gearbox, instance: str) -> str:
    return next(link for link in (*gearbox.copied, instance) if instance in (*gearbox.instances(link), link))


def _copies(gearbox: Gearbox, bearing: Bearing) -> int:
    return max(len(gearbox.instances(ring)) for ring in (bearing.inner_ring, bearing.outer_ring))
