"""Velocity ratios of a mechanism, exact where teeth make them so.

Every body but the frame turns about one axis, carried by another body; its one unknown is the rate of that
turning pair. A mesh between gears i and j with carrier k is one real equation in these rates,
``Z_i (w_i - w_k) + Z_j (w_j - w_k) = 0``, each speed along the gear's own declared axis (Willis; Penaud,
Alazard and Amiez 2012, eq. 2, with the directions already in the signs of the teeth). So the equations have
whole-number coefficients and are solved in rational arithmetic; directions enter only when the rates are
added up to velocity vectors.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Real

import numpy as np
import xarray as xr

from hums.declared import closest
from hums.gearbox import Gearbox, GearboxError, Mesh

Rates = dict[str, Fraction]  # a linear form in the joint rates, by body
Row = dict[str, Fraction]


@dataclass(frozen=True, kw_only=True)
class Joint:
    """The turning pair that holds a body: the axis it turns about and the body that carries the axis."""

    body: str
    axis: str
    carried_by: str


@dataclass(frozen=True, kw_only=True)
class Contact:
    """One mesh of the expanded mechanism, a planet's copies each counted: its gears and its carrier."""

    mesh: str
    gears: tuple[tuple[str, int], ...]
    carrier: str


@dataclass(frozen=True)
class Kinematics:
    """The solved mechanism: degrees of freedom, carriers, velocity ratios."""

    gearbox: Gearbox
    bodies: Mapping[str, str]
    joints: Mapping[str, Joint]
    contacts: tuple[Contact, ...]
    pivots: Mapping[str, Row]

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of all links, copies expanded."""
        return self.gearbox.links

    @cached_property
    def free(self) -> tuple[str, ...]:
        """Bodies whose joint rates are free: one for each degree of freedom."""
        return tuple(body for body in self.joints if body not in self.pivots)

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return len(self.free)

    @property
    def carriers(self) -> tuple[str, ...]:
        """The carrier of each contact, in the order of `contacts`."""
        return tuple(contact.carrier for contact in self.contacts)

    def rates(self, speeds: Mapping[str, float | Fraction] | None = None) -> dict[str, Fraction]:
        """Solve for every joint rate, given the speeds of as many links as there are degrees of freedom.

        Parameters
        ----------
        speeds : mapping of link name to speed, any unit
            Absolute speeds along the links' declared axes. None: one turn of the gearbox's reference.

        Returns
        -------
        dict of body name to Fraction, in the unit of `speeds`

        Raises
        ------
        GearboxError
            Too few speeds, contradictory speeds, or a speed imposed on a link whose axis itself turns.
        """
        imposed = self._one_turn() if speeds is None else speeds
        system: dict[str, Row] = {}
        for link, speed in imposed.items():
            form = self._in_free(self.spin(link))
            form["="] = -_exact(link, speed)
            left = _reduced(form, system)
            unknown = next((body for body in left if body != "="), None)
            if unknown is None:
                if left:
                    given = ", ".join(f'"{name}" = {float(value):g}' for name, value in imposed.items())
                    raise GearboxError(
                        f'speeds {given} contradict each other at "{link}"; leave out one of them '
                        f"({_count(self.dof, 'speed')} can be chosen)."
                    )
                continue
            _add_pivot(system, left, unknown)
        missing = [body for body in self.free if body not in system]
        if missing:
            raise GearboxError(
                f'gearbox "{self.gearbox.name}" has {self.dof} degrees of freedom; the speeds given '
                f"({', '.join(imposed) or 'none'}) leave {_count(len(missing), 'degree')} open. "
                f'Give the speed of "{missing[0]}" too, as in speeds={{"{missing[0]}": 1.0}}.'
            )
        solved = {body: row.get("=", Fraction(0)) for body, row in system.items()}
        return {body: _value(self._in_free({body: Fraction(1)}), solved) for body in self.joints}

    def spin(self, link: str, *, seen_from: str | None = None) -> Rates:
        """Return a link's turning about its own axis, as a linear form in the joint rates.

        Seen from the frame where `seen_from` is None, which needs all axes up to the frame to be parallel;
        otherwise from a link on the same axis.
        """
        body = self._body(link)
        if seen_from is None:
            return self._absolute(body)
        other = self._body(seen_from)
        if body == other:
            return {}
        for axis in self._axes_of(body):
            if axis in self._axes_of(other):
                return _difference(self._on_axis(body, axis), self._on_axis(other, axis))
        if other == self._body(self.gearbox.frame):
            return self._absolute(body)
        return _difference(self._absolute(body), self._absolute(other))

    def relative_speed(
        self, link: str, *, seen_from: str, speeds: Mapping[str, float | Fraction] | None = None
    ) -> Fraction:
        """Return the speed of `link` about its axis as `seen_from` sees it, signed, exact for exact `speeds`."""
        return _value(self.spin(link, seen_from=seen_from), self.rates(speeds))

    def vectors(self, speeds: Mapping[str, float | Fraction] | None = None) -> xr.DataArray:
        """Return the angular velocity vector of every link at the declared configuration, (link, 3)."""
        rates = self.rates(speeds)
        table = np.array([self._vector(self.bodies[link], rates) for link in self.links])
        return xr.DataArray(
            table, dims=("link", "component"), coords={"link": list(self.links), "component": list("xyz")}
        )

    def velocity_ratios(self, inputs: Sequence[str] | None = None) -> xr.DataArray:
        """Return the velocity ratio matrix of the papers, (link, input), complex: x is real, y imaginary.

        Parameters
        ----------
        inputs : sequence of link names, as many as there are degrees of freedom
            None: the gearbox's reference.

        Raises
        ------
        GearboxError
            Where an axis leaves the x-y plane: use `vectors`.
        """
        names = tuple(self._one_turn()) if inputs is None else tuple(inputs)
        columns = []
        for name in names:
            vectors = self.vectors({other: Fraction(int(other == name)) for other in names})
            if np.any(np.abs(vectors.sel(component="z")) > 1e-12):  # noqa: PLR2004
                raise GearboxError("an axis leaves the x-y plane, so no complex number holds it; use vectors().")
            columns.append(vectors.sel(component="x").to_numpy() + 1j * vectors.sel(component="y").to_numpy())
        return xr.DataArray(
            np.stack(columns, axis=1),
            dims=("link", "input"),
            coords={"link": list(self.links), "input": list(names)},
        )

    def _one_turn(self) -> dict[str, Fraction]:
        if self.gearbox.reference is None:
            raise GearboxError(
                f'gearbox "{self.gearbox.name}" declares no reference; add reference = "LINK" or name the inputs.'
            )
        return {self.gearbox.reference: Fraction(1)}

    def _body(self, link: str) -> str:
        if link not in self.bodies:
            raise GearboxError(f'gearbox "{self.gearbox.name}" has no link "{link}"{closest(link, list(self.bodies))}')
        return self.bodies[link]

    def _axes_of(self, body: str) -> list[str]:
        own = [self.joints[body].axis] if body in self.joints else []
        return own + sorted({joint.axis for joint in self.joints.values() if joint.carried_by == body})

    def _on_axis(self, body: str, axis: str) -> Rates:
        return {body: Fraction(1)} if body in self.joints and self.joints[body].axis == axis else {}

    def _absolute(self, body: str) -> Rates:
        if body not in self.joints:
            return {}
        own = _direction(self.gearbox, self.joints[body].axis)
        form: Rates = {}
        while body in self.joints:
            along = float(own @ _direction(self.gearbox, self.joints[body].axis))
            if abs(abs(along) - 1) > 1e-12:  # noqa: PLR2004
                raise GearboxError(
                    f'"{body}" carries an axis that turns with it in another direction, so one number cannot say '
                    "how fast the link on it turns; name the speed relative to its carrier, or use vectors()."
                )
            form[body] = Fraction(round(along))
            body = self.joints[body].carried_by
        return form

    def _vector(self, body: str, rates: Mapping[str, Fraction]) -> np.ndarray:
        vector = np.zeros(3)
        while body in self.joints:
            vector += float(rates[body]) * _direction(self.gearbox, self.joints[body].axis)
            body = self.joints[body].carried_by
        return vector

    def _in_free(self, form: Rates) -> Row:
        return _reduced(form, self.pivots)


def solve_kinematics(gearbox: Gearbox) -> Kinematics:
    """Solve a mechanism for the ratios of all its speeds.

    Parameters
    ----------
    gearbox : Gearbox
        From `load_gearbox`.

    Returns
    -------
    Kinematics

    Raises
    ------
    GearboxError
        A link that nothing holds, a mesh without a carrier or with two possible ones, a mechanism that
        cannot move: the parts by name, and the cure.
    """
    bodies = _bodies(gearbox)
    levels = _levels(gearbox, bodies)
    joints = _joints(gearbox, bodies, levels)
    contacts = tuple(
        _contact(gearbox, mesh, number, bodies, levels)
        for mesh in gearbox.meshes
        for number in range(_multiplicity(gearbox, mesh))
    )
    unsolved = Kinematics(gearbox, bodies, joints, contacts, {})
    pivots: dict[str, Row] = {}
    for contact in contacts:
        if len(contact.gears) == 1:
            continue
        row: Row = {}
        for link, teeth in contact.gears:
            for body, factor in unsolved.spin(link, seen_from=contact.carrier).items():
                row[body] = row.get(body, Fraction(0)) + teeth * factor
        left = _reduced(row, pivots)
        if left:
            # the body declared last is expressed by the earlier ones, so inputs tend to stay free
            _add_pivot(pivots, left, max(left, key=list(joints).index))
    solved = Kinematics(gearbox, bodies, joints, contacts, pivots)
    if solved.dof == 0:
        raise GearboxError(
            f'gearbox "{gearbox.name}" cannot move: its {len(contacts)} meshes lock all {len(joints)} turning '
            "bodies. Check the signs of the teeth (minus: internal gear) and which links are rigid."
        )
    return solved


def _bodies(gearbox: Gearbox) -> dict[str, str]:
    """Map each link to its body: itself, or the first name of its rigid group, the frame's name first."""
    body = {link: link for link in gearbox.links}
    rank = [name for group in gearbox.rigid for link in group for name in gearbox.instances(link)]
    for group in gearbox.rigid:
        instances = [gearbox.instances(link) for link in group]
        alike = len({len(names) for names in instances}) == 1
        # copies that all come in the same number are joined one by one: a stepped planet
        for names in zip(*instances, strict=True) if alike else [sum(instances, ())]:
            roots = {body[name] for name in names}
            root = gearbox.frame if gearbox.frame in roots else min(roots, key=rank.index)
            for link, held in body.items():
                if held in roots:
                    body[link] = root
    return body


def _levels(gearbox: Gearbox, bodies: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Expand the axes: name -> bodies on it, each body once; copies are named ``planet 1`` and so on."""
    levels = {}
    for axis in gearbox.axes:
        for number, name in enumerate(axis.instances()):
            members = [gearbox.instances(link) for link in axis.links]
            levels[name] = tuple(dict.fromkeys(bodies[m[number] if len(m) > 1 else m[0]] for m in members))
    return levels


def _joints(gearbox: Gearbox, bodies: Mapping[str, str], levels: Mapping[str, tuple[str, ...]]) -> dict[str, Joint]:
    """Walk outwards from the frame: the first axis that reaches a body holds it."""
    frame = bodies[gearbox.frame]
    joints: dict[str, Joint] = {}
    reached, walked = [frame], set()
    for body in reached:
        for axis, members in levels.items():
            if axis in walked or body not in members:
                continue
            walked.add(axis)
            for other in members:
                if other == body:
                    continue
                if other in reached:
                    raise GearboxError(
                        f'gearbox "{gearbox.name}": "{other}" is held twice, by axis "{axis}" and by another; '
                        "list links that turn about one line on one axis."
                    )
                joints[other] = Joint(body=other, axis=axis, carried_by=body)
                reached.append(other)
    loose = [body for body in dict.fromkeys(bodies.values()) if body not in reached]
    if loose:
        raise GearboxError(
            f'gearbox "{gearbox.name}": nothing holds "{loose[0]}"; put it on an axis that leads to the frame '
            f'"{gearbox.frame}", or make it rigid with a link that is.'
        )
    order = {body: rank for rank, body in enumerate(dict.fromkeys(bodies.values()))}
    return dict(sorted(joints.items(), key=lambda item: order[item[0]]))


def _multiplicity(gearbox: Gearbox, mesh: Mesh) -> int:
    return max(len(gearbox.instances(gear.link)) for gear in mesh.gears)


def _contact(
    gearbox: Gearbox,
    mesh: Mesh,
    number: int,
    bodies: Mapping[str, str],
    levels: Mapping[str, tuple[str, ...]],
) -> Contact:
    def pick(link: str) -> str:
        names = gearbox.instances(link)
        return names[number] if len(names) > 1 else names[0]

    gears = tuple((pick(gear.link), gear.teeth) for gear in mesh.gears)
    neighbours = [_neighbours(bodies[link], levels) for link, _ in gears]
    common = set.intersection(*neighbours) - {bodies[link] for link, _ in gears}
    if mesh.carrier is not None:
        carrier = bodies[pick(mesh.carrier)]
        for (link, _), near in zip(gears, neighbours, strict=True):
            if carrier not in near:
                raise GearboxError(
                    f'mesh "{mesh.name}": the carrier "{mesh.carrier}" does not hold "{link}" '
                    f"({link} turns on {_set(near)}). Name a carrier that shares an axis with each gear."
                )
    elif len(common) == 1:
        carrier = common.pop()
    else:
        turns = ", ".join(f"{link} on {_set(near)}" for (link, _), near in zip(gears, neighbours, strict=True))
        what = f"{_set(common)} each carry" if common else "no link carries"
        raise GearboxError(
            f'mesh "{mesh.name}": {what} both gears ({turns}). Add the axis that holds the gears, or name the '
            'carrier with carrier = "...".'
        )
    return Contact(mesh=mesh.name, gears=gears, carrier=carrier)


def _neighbours(body: str, levels: Mapping[str, tuple[str, ...]]) -> set[str]:
    """Return S_i: the bodies that share an axis with this one (Penaud 2012, eq. 1)."""
    return {other for members in levels.values() if body in members for other in members} - {body}


def _exact(link: str, speed: object) -> Fraction:
    if isinstance(speed, bool) or not isinstance(speed, Real) or not math.isfinite(speed):
        raise GearboxError(f'speeds: "{link}" = {speed!r} is not a finite number; give its speed as one.')
    return Fraction(speed) if isinstance(speed, int | Fraction) else Fraction(float(speed))


def _set(names: set[str]) -> str:
    return "{" + ", ".join(sorted(names)) + "}"


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" + ("" if number == 1 else "s")


def _direction(gearbox: Gearbox, expanded_axis: str) -> np.ndarray:
    names = {axis.name for axis in gearbox.axes}
    return np.array(gearbox.direction(expanded_axis if expanded_axis in names else expanded_axis.rsplit(" ", 1)[0]))


def _difference(a: Rates, b: Rates) -> Rates:
    total = {body: a.get(body, Fraction(0)) - b.get(body, Fraction(0)) for body in {**a, **b}}
    return {body: factor for body, factor in total.items() if factor}


def _value(form: Rates, rates: Mapping[str, Fraction]) -> Fraction:
    return sum((factor * rates[body] for body, factor in form.items()), Fraction(0))


def _reduced(form: Mapping[str, Fraction], pivots: Mapping[str, Row]) -> Row:
    """Replace every pivot variable of `form` by its expression in free ones."""
    result: Row = {}
    for name, factor in form.items():
        for other, share in pivots[name].items() if name in pivots else ((name, Fraction(1)),):
            result[other] = result.get(other, Fraction(0)) + factor * share
    return {name: factor for name, factor in result.items() if factor}


def _add_pivot(pivots: dict[str, Row], row: Row, name: str) -> None:
    """Solve ``row = 0`` for `name` and substitute it in all earlier expressions."""
    expression = {other: -factor / row[name] for other, factor in row.items() if other != name}
    for earlier, terms in pivots.items():
        if name in terms:
            pivots[earlier] = _reduced(terms, {name: expression})
    pivots[name] = expression
