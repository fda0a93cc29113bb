"""Velocity ratios of a mechanism, exact where teeth make them so.

Every body but the frame turns about one axis, carried by another body; its one unknown is the rate of that
turning pair. A mesh between gears i and j with carrier k is one real equation in these rates,
``Z_i (w_i - w_k) + Z_j (w_j - w_k) = 0``, each speed along the gear's own declared axis (Willis; Penaud,
Alazard and Amiez 2012, eq. 2, with the directions already in the signs of the teeth). So the equations have
whole-number coefficients and are solved in rational arithmetic; directions enter only when the rates are
added up to velocity vectors.

The papers' own way, a complex constraint matrix and its null space, stands beside it as an independent check
for mechanisms whose axes lie in one plane.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from numbers import Real

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums._forms import Form, add_pivot, difference, evaluate, reduced
from hums.declared import closest, count
from hums.gearbox import Gearbox, GearboxError
from hums.mechanism import Contact, Joint, Mechanism, build_mechanism

Rates = Form  # in the joint rates, by body
Speeds = Mapping[str, float | Fraction]
_ONE = Fraction(1)
_ZERO = Fraction(0)
_FLAT = 1e-12


@dataclass(frozen=True)
class Kinematics:
    """The solved mechanism: degrees of freedom, carriers, velocity ratios."""

    mechanism: Mechanism
    pivots: Mapping[str, Rates]

    @property
    def gearbox(self) -> Gearbox:
        """What was drawn."""
        return self.mechanism.gearbox

    @property
    def bodies(self) -> Mapping[str, str]:
        """Link -> body; links that are rigid with each other are one body."""
        return self.mechanism.bodies

    @property
    def joints(self) -> Mapping[str, Joint]:
        """Body -> the turning pair that holds it."""
        return self.mechanism.joints

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Every mesh, copies counted."""
        return self.mechanism.contacts

    @property
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

    # ---- speeds --------------------------------------------------------------------------------------------

    def rates(self, speeds: Speeds | None = None) -> dict[str, Fraction]:
        """Solve for every joint rate, given the speeds of as many links as there are degrees of freedom.

        Parameters
        ----------
        speeds : mapping of link name to speed, any unit
            Absolute speeds along the links' declared axes, of any links; more than needed are welcome where
            they agree (to 1e-9 where they are floats). None: one turn of the gearbox's reference.

        Returns
        -------
        dict of body name to Fraction, in the unit of `speeds`

        Raises
        ------
        GearboxError
            Too few speeds; contradictory ones, by name; a speed imposed on a link whose axis itself turns in
            another direction.
        """
        imposed = self._one_turn() if speeds is None else speeds
        values = {link: _fraction(link, speed) for link, speed in imposed.items()}
        found: dict[str, Rates] = {}  # free body -> combination of the imposed speeds
        for link, speed in values.items():
            form = reduced(self.spin(link), self.pivots) | {_imposed(link): -_ONE}
            left = reduced(form, found)
            unknown = next((body for body in left if not _is_imposed(body)), None)
            if unknown is not None:
                add_pivot(found, left, unknown)
            elif not _agree(left, values, exact=all(isinstance(x, int | Fraction) for x in imposed.values())):
                self._refuse_contradiction(left, link, speed, values)
        missing = [body for body in self.free if body not in found]
        if missing:
            raise GearboxError(
                f'gearbox "{self.gearbox.name}" has {count(self.dof, "degree")} of freedom; the speeds given '
                f"({', '.join(imposed) or 'none'}) leave {count(len(missing), 'degree')} open. "
                f'Give the speed of "{missing[0]}" too, as in speeds={{"{missing[0]}": 1.0}}.'
            )
        symbols = {_imposed(link): speed for link, speed in values.items()}
        free = {body: evaluate(found[body], symbols) for body in self.free}
        return {body: free[body] if body in free else evaluate(self.pivots[body], free) for body in self.joints}

    def spin(self, link: str, *, seen_from: str | None = None) -> Rates:
        """Return a link's turning about its own axis, as a linear form in the joint rates.

        Seen from the frame where `seen_from` is None, which needs all axes up to the frame to be parallel;
        otherwise from any link on the same axis, or on a parallel one.
        """
        body = self._body(link)
        if seen_from is None:
            return dict(self._absolute(body))
        other = self._body(seen_from)
        if body == other:
            return {}
        axis = self.mechanism.shared_axis(body, other)
        if axis is not None:
            return difference(self._on_axis(body, axis), self._on_axis(other, axis))
        if other == self.mechanism.frame:
            return dict(self._absolute(body))
        along = self._along(body, other)
        seen = {name: along * factor for name, factor in self._absolute(other).items()}
        return difference(self._absolute(body), seen)

    def relative_speed(self, link: str, *, seen_from: str, speeds: Speeds | None = None) -> Fraction:
        """Return the speed of `link` about its axis as `seen_from` sees it, signed, exact for exact `speeds`."""
        return evaluate(self.spin(link, seen_from=seen_from), self.rates(speeds))

    def vectors(self, speeds: Speeds | None = None) -> xr.DataArray:
        """Return the angular velocity vector of every link at the declared configuration, (link, 3)."""
        rates = self.rates(speeds)
        of_body = {self.mechanism.frame: np.zeros(3)}
        for body in _outwards(self.joints, self.mechanism.frame):
            joint = self.joints[body]
            direction = np.array(self.mechanism.directions[joint.axis])
            of_body[body] = of_body[joint.carried_by] + float(rates[body]) * direction
        table = np.array([of_body[self.bodies[link]] for link in self.links])
        return xr.DataArray(
            table, dims=("link", "component"), coords={"link": list(self.links), "component": list("xyz")}
        )

    def velocities(self, speeds: Speeds | None = None) -> xr.DataArray:
        """Return the complex angular velocity of every link, (link,): x is real, y imaginary.

        Raises
        ------
        GearboxError
            Where an axis leaves the x-y plane: use `vectors`.
        """
        self._refuse_space()
        vectors = self.vectors(speeds)
        return xr.DataArray(
            vectors.sel(component="x").to_numpy() + 1j * vectors.sel(component="y").to_numpy(),
            dims="link",
            coords={"link": list(self.links)},
        )

    def velocity_ratios(self, inputs: Sequence[str] | None = None) -> xr.DataArray:
        """Return the velocity ratio matrix Omega_0 of the papers, (link, input), complex, 1 at each input.

        Angles are relative to the input's own axis. Parameters and errors as in `velocities`.

        Parameters
        ----------
        inputs : sequence of link names, as many as there are degrees of freedom
            None: the gearbox's reference.
        """
        names = tuple(self._one_turn()) if inputs is None else tuple(inputs)
        columns = []
        for name in names:
            turning = self.velocities({other: Fraction(int(other == name)) for other in names})
            columns.append(turning.to_numpy() / turning.sel(link=name).item())
        return xr.DataArray(
            np.stack(columns, axis=1), dims=("link", "input"), coords={"link": list(self.links), "input": list(names)}
        )

    # ---- the papers' matrix --------------------------------------------------------------------------------

    @cached_property
    def constraint_matrix(self) -> NDArray[np.complex128]:
        """The kinematic constraint matrix M of Penaud, Alazard and Amiez 2012, 2.4: (1 + meshes + rigid, link).

        First the frame at rest, then a row a mesh of two gears, then one for each second name of a body. Each
        mesh has its gears' teeth, turned by ``pitch_angle_deg`` where declared, else by the axes' directions,
        which gives the same row up to a unit factor.
        """
        self._refuse_space()
        place = {link: column for column, link in enumerate(self.links)}
        rows = [self._row(place, {self.gearbox.frame: 1.0})]
        for contact in self.contacts:
            if len(contact.gears) == 1:
                continue
            weights = self._mesh_weights(contact)
            terms = {link: weight for (link, _), weight in zip(contact.gears, weights, strict=True)}
            terms[contact.carrier] = terms.get(contact.carrier, 0) - sum(weights)
            rows.append(self._row(place, terms))
        rows += [self._row(place, {link: 1.0, body: -1.0}) for link, body in self.bodies.items() if link != body]
        return np.array(rows)

    @cached_property
    def null_space(self) -> NDArray[np.complex128]:
        """An orthonormal basis of the null space of `constraint_matrix`, (link, dof): the independent solver."""
        from scipy.linalg import null_space  # noqa: PLC0415

        return np.asarray(null_space(self.constraint_matrix))

    def _mesh_weights(self, contact: Contact) -> list[complex]:
        if contact.pitch_angle_deg is not None:
            angles = np.radians(contact.pitch_angle_deg)
            return [abs(teeth) * complex(np.exp(1j * a)) for (_, teeth), a in zip(contact.gears, angles, strict=True)]
        weights = []
        for link, teeth in contact.gears:
            axis = self.mechanism.shared_axis(self.bodies[link], contact.carrier)
            x, y, _ = self.mechanism.directions[axis or ""]
            weights.append(teeth * complex(x, -y))
        return weights

    @staticmethod
    def _row(place: Mapping[str, int], terms: Mapping[str, complex]) -> NDArray[np.complex128]:
        row = np.zeros(len(place), dtype=np.complex128)
        for link, weight in terms.items():
            row[place[link]] += weight
        return row

    def _refuse_space(self) -> None:
        for axis, (_, _, z) in self.mechanism.directions.items():
            if abs(z) > _FLAT:
                raise GearboxError(
                    f'axis "{axis}" leaves the x-y plane, so no complex number holds its speeds; use vectors().'
                )

    # ---- pieces --------------------------------------------------------------------------------------------

    def _one_turn(self) -> dict[str, Fraction]:
        if self.gearbox.reference is None:
            raise GearboxError(
                f'gearbox "{self.gearbox.name}" declares no reference; add reference = "LINK" or name the inputs.'
            )
        return {self.gearbox.reference: _ONE}

    def _body(self, link: str) -> str:
        if link not in self.bodies:
            raise GearboxError(f'gearbox "{self.gearbox.name}" has no link "{link}"{closest(link, list(self.bodies))}')
        return self.bodies[link]

    def _on_axis(self, body: str, axis: str) -> Rates:
        return {body: _ONE} if body in self.joints and self.joints[body].axis == axis else {}

    def _along(self, body: str, other: str) -> int:
        """Return +1 or -1 as the axes of two bodies point the same or the opposite way; refuse all else."""
        one, two = (self.mechanism.directions[self.joints[name].axis] for name in (body, other))
        along = sum(a * b for a, b in zip(one, two, strict=True))
        if abs(abs(along) - 1) > _FLAT:
            raise GearboxError(
                f'"{body}" and "{other}" turn about axes in different directions, so one number cannot say how fast '
                "the one turns seen from the other; name the speed relative to its carrier, or use vectors()."
            )
        return round(along)

    def _absolute(self, body: str) -> Rates:
        """Return the turning of a body about its own axis as the frame sees it: the sum along its carriers."""
        known = self._known_absolute
        if body not in known:
            joint = self.joints[body]
            form = {body: _ONE}
            if joint.carried_by != self.mechanism.frame:
                along = self._along(body, joint.carried_by)
                form |= {name: along * factor for name, factor in self._absolute(joint.carried_by).items()}
            known[body] = form
        return known[body]

    @cached_property
    def _known_absolute(self) -> dict[str, Rates]:
        return {self.mechanism.frame: {}}

    def _refuse_contradiction(self, left: Rates, link: str, speed: Fraction, values: Mapping[str, Fraction]) -> None:
        others = [name for name in values if name != link and _imposed(name) in left]
        needed = -evaluate({key: f for key, f in left.items() if key != _imposed(link)}, _symbols(values))
        implied = float(needed / left[_imposed(link)])
        given = " and ".join(f'"{name}" = {float(values[name]):g}' for name in others) or "the mechanism"
        raise GearboxError(
            f'speeds contradict each other: {given} make "{link}" turn at {implied:g}, but it is given as '
            f"{float(speed):g}. Leave out one of them, or correct it."
        )


def solve_kinematics(
    gearbox: Gearbox,
    *,
    fixed: Iterable[str] = (),
    constraints: Iterable[Mapping[str, float | Fraction]] = (),
) -> Kinematics:
    """Solve a mechanism for the ratios of all its speeds.

    Parameters
    ----------
    gearbox : Gearbox
        From `load_gearbox` or `from_adjacency_table`.
    fixed : links held at rest, besides the frame.
    constraints : linear relations between speeds
        Each a mapping of link to factor: the speeds along the links' own axes, so weighted, add up to zero.

    Returns
    -------
    Kinematics

    Raises
    ------
    GearboxError
        A mechanism that is none (see `hums.mechanism`) or that cannot move: the parts by name, and the cure; a
        bearing whose rings are one body.
    """
    fixed, constraints = tuple(fixed), tuple(constraints)
    unsolved = Kinematics(build_mechanism(gearbox), {})
    _refuse_bearings_in_one_body(unsolved)
    rows = _equations(unsolved, fixed, constraints)
    rank = {body: number for number, body in enumerate(unsolved.joints)}
    pivots: dict[str, Rates] = {}
    users: dict[str, set[str]] = {}
    for _, row in rows:
        left = reduced(row, pivots)
        if left:
            # the body declared last is expressed by the earlier ones, so inputs tend to stay free
            add_pivot(pivots, left, max(left, key=rank.__getitem__), users=users)
    solved = Kinematics(unsolved.mechanism, pivots)
    stuck = [
        body for body, form in pivots.items() if not form and solved.joints[body].carried_by == solved.mechanism.frame
    ]
    if solved.dof == 0 or (stuck and not (fixed or constraints)):
        what = f'gearbox "{gearbox.name}"' if solved.dof == 0 else f'gearbox "{gearbox.name}": "{stuck[0]}"'
        raise GearboxError(
            f"{what} cannot move: it is locked by {_who_locks(rows)}. Check the signs of the teeth (minus: internal "
            "gear), which links are rigid, and what is fixed; make a link that is to rest rigid with the frame."
        )
    return solved


def _refuse_bearings_in_one_body(unsolved: Kinematics) -> None:
    for bearing in unsolved.gearbox.bearings:
        inner, outer = bearing.inner_ring, bearing.outer_ring
        bodies = [unsolved.bodies[unsolved.gearbox.instances(ring)[0]] for ring in (inner, outer)]
        if bodies[0] == bodies[1]:
            why = "are one link" if inner == outer else "are rigid with each other"
            raise GearboxError(
                f'bearing "{bearing.names[0]}": inner_ring = "{inner}" and outer_ring = "{outer}" {why}, so it cannot '
                "turn; name a link on either side of it, or leave the bearing out."
            )


def _equations(
    unsolved: Kinematics, fixed: Iterable[str], constraints: Iterable[Mapping[str, float | Fraction]]
) -> list[tuple[str, Rates]]:
    """Return every equation in the joint rates, with the name of what makes it."""
    rows = []
    for contact in unsolved.contacts:
        if len(contact.gears) == 1:
            continue
        row: Rates = {}
        for link, teeth in contact.gears:
            for body, factor in unsolved.spin(link, seen_from=contact.carrier).items():
                row[body] = row.get(body, _ZERO) + teeth * factor
        rows.append((f'mesh "{contact.mesh}"', {body: factor for body, factor in row.items() if factor}))
    rows += [(f'fixed "{link}"', unsolved.spin(link)) for link in fixed]
    for number, constraint in enumerate(constraints):
        row = {}
        for link, weight in constraint.items():
            for body, factor in unsolved.spin(link).items():
                row[body] = row.get(body, _ZERO) + Fraction(weight) * factor
        rows.append((f"constraint {number + 1}", {body: factor for body, factor in row.items() if factor}))
    return rows


def _who_locks(rows: Sequence[tuple[str, Rates]]) -> str:
    """Name the fewest equations that leave some body no rate but zero.

    Every equation gets a slip of its own; once a body's rate is a combination of slips alone, those are the
    ones that hold it.
    """
    pivots: dict[str, Rates] = {}
    for number, (_, row) in enumerate(rows):
        left = reduced(row | {_imposed(str(number)): -_ONE}, pivots)
        body = next((name for name in left if not _is_imposed(name)), None)
        if body is not None:
            add_pivot(pivots, left, body)
    held = [form for form in pivots.values() if all(map(_is_imposed, form))]
    guilty = min(held, key=len)
    names = dict.fromkeys(rows[int(key.removeprefix(_MARK))][0] for key in guilty)
    return ", ".join(names)


# ---- rational linear algebra: forms are sparse rows, pivots are variables solved for the others ------------------

_MARK = "\0"  # sets a constant's name apart from every body's


def _imposed(name: str) -> str:
    return _MARK + name


def _is_imposed(name: str) -> bool:
    return name.startswith(_MARK)


def _symbols(values: Mapping[str, Fraction]) -> dict[str, Fraction]:
    return {_imposed(link): speed for link, speed in values.items()}


def _fraction(link: str, speed: object) -> Fraction:
    if isinstance(speed, bool) or not isinstance(speed, Real) or not math.isfinite(speed):
        raise GearboxError(f'speeds: "{link}" = {speed!r} is not a finite number; give its speed as one.')
    return Fraction(speed) if isinstance(speed, int | Fraction) else Fraction(float(speed))


def _agree(left: Rates, values: Mapping[str, Fraction], *, exact: bool) -> bool:
    """Whether a combination of imposed speeds that must vanish does."""
    terms = [factor * values[name.removeprefix(_MARK)] for name, factor in left.items()]
    total = abs(sum(terms, _ZERO))
    return total == 0 if exact else total <= Fraction(1, 10**9) * max((abs(term) for term in terms), default=_ZERO)


def _outwards(joints: Mapping[str, Joint], frame: str) -> list[str]:
    """Bodies such that each comes after the one that carries it."""
    held_by: dict[str, list[str]] = {}
    for body, joint in joints.items():
        held_by.setdefault(joint.carried_by, []).append(body)
    order = [frame]
    for body in order:
        order += held_by.get(body, [])
    return order[1:]
