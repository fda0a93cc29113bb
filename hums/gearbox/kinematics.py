"""Velocity ratios of a mechanism, exact if determined by tooth numbers.

Every body except the frame rotates about one axis, carried by another body; its only unknown is the rate of that
turning pair. A mesh between gears i and j with carrier k is one real equation in these rates,
``Z_i (w_i - w_k) + Z_j (w_j - w_k) = 0``, with each speed along the gear's declared axis (Willis; Penaud, Alazard and
Amiez 2012, eq. 2, with the directions included in the signs of the teeth). The equations have integer coefficients and
are solved in rational arithmetic; directions enter only when rates are added to velocity vectors.

The method of the papers, the null space of a complex constraint matrix, is kept as an independent check for
mechanisms whose axes lie in one plane.

References
----------
J. Penaud, D. Alazard and A. Amiez, Kinematic analysis of spatial geared mechanisms, Journal of Mechanical Design 134
(2012), 021009.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from graphlib import TopologicalSorter

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from hums.gearbox.components import closest, count
from hums.gearbox.mechanism import Contact, Joint, Mechanism, build_mechanism
from hums.gearbox.model import Gearbox, GearboxError
from hums.gearbox.rational import ONE, ZERO, Form, add, add_pivot, difference, evaluate, reduced
from signals._validation import brief, checked, is_float

Rates = Form  # a linear form in the joint rates, which are named after their bodies
Speeds = Mapping[str, float | Fraction]
_IN_PLANE = 1e-12  # largest z component, or deviation from parallel, of unit vectors


@dataclass(frozen=True, eq=False)  # results derived from it are cached by identity
class Kinematics:
    """The solved kinematics of a gearbox: degrees of freedom, carriers, velocity ratios.

    Built by `solve_kinematics`.

    Attributes
    ----------
    mechanism : Mechanism
        Bodies, turning pairs and contacts.
    pivots : mapping of body to linear form
        Dependent joint rates as combinations of the free ones.

    Examples
    --------
    >>> import hums
    >>> kinematics = hums.solve_kinematics(hums.load_gearbox("planetary-27-36-99"))
    >>> kinematics.dof, kinematics.free
    (1, ('sun',))
    >>> kinematics.carriers[0]
    'carrier'
    """

    mechanism: Mechanism
    pivots: Mapping[str, Rates]

    @property
    def gearbox(self) -> Gearbox:
        """The gearbox as declared."""
        return self.mechanism.gearbox

    @property
    def bodies(self) -> Mapping[str, str]:
        """Body of each link; rigidly connected links are one body."""
        return self.mechanism.bodies

    @property
    def joints(self) -> Mapping[str, Joint]:
        """Turning pair of each body."""
        return self.mechanism.joints

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Every mesh, copies expanded."""
        return self.mechanism.contacts

    @property
    def links(self) -> tuple[str, ...]:
        """Names of all links, copies expanded."""
        return self.gearbox.links

    @cached_property
    def free(self) -> tuple[str, ...]:
        """Bodies whose joint rates are independent, one per degree of freedom."""
        return tuple(body for body in self.joints if body not in self.pivots)

    @property
    def dof(self) -> int:
        """Number of degrees of freedom."""
        return len(self.free)

    @property
    def carriers(self) -> tuple[str, ...]:
        """The carrier of each contact, in the order of `contacts`."""
        return tuple(contact.carrier for contact in self.contacts)

    # ---- speeds --------------------------------------------------------------------------------------------

    def rates(self, speeds: Speeds | None = None) -> dict[str, Fraction]:
        """Return every joint rate, given the speeds of as many links as there are degrees of freedom.

        Parameters
        ----------
        speeds : mapping of str to float or Fraction, optional
            Absolute speeds of links along their declared axes, in any unit. More than necessary are accepted if they
            agree (to 1e-9 for floats). Default: 1 for the gearbox's reference.

        Returns
        -------
        dict of str to Fraction
            Speed of each body relative to the carrier of its axis, in the unit of `speeds`.

        Raises
        ------
        GearboxError
            If speeds are missing or contradictory, or a link's axis itself rotates in another direction.

        Examples
        --------
        >>> import hums
        >>> kinematics = hums.solve_kinematics(hums.load_gearbox("planetary-27-36-99"))
        >>> print(kinematics.rates({"sun": 1})["carrier"])  # Willis: 27 / (27 + 99), the ring at rest
        3/14
        """
        if speeds is None:
            return dict(self._unit_rates)
        return self._rates(speeds)

    @cached_property
    def _unit_rates(self) -> dict[str, Fraction]:
        """Joint rates at the speed 1 of the reference."""
        return self._rates(self._unit_reference_speed())

    def _rates(self, imposed: Speeds) -> dict[str, Fraction]:
        values = {link: _fraction(link, speed) for link, speed in imposed.items()}
        found: dict[str, Rates] = {}  # by free body, a linear form in the imposed speeds
        for link, speed in values.items():
            form = reduced(self.spin(link), self.pivots) | {_imposed(link): -ONE}
            residual = reduced(form, found)
            unknown = next((body for body in residual if not _is_imposed(body)), None)
            if unknown is not None:
                add_pivot(found, residual, unknown)
            elif not _vanishes(residual, values, exact=all(isinstance(x, int | Fraction) for x in imposed.values())):
                self._refuse_contradiction(residual, link, speed, values)
        missing = [body for body in self.free if body not in found]
        if missing:
            raise GearboxError(
                f'gearbox "{self.gearbox.name}" has {count(self.dof, "degree")} of freedom; the speeds given '
                f"({', '.join(imposed) or 'none'}) leave {count(len(missing), 'degree')} undetermined. "
                f'Also give the speed of "{missing[0]}", as in speeds={{"{missing[0]}": 1.0}}.'
            )
        symbols = {_imposed(link): speed for link, speed in values.items()}
        free = {body: evaluate(found[body], symbols) for body in self.free}
        return {body: free[body] if body in free else evaluate(self.pivots[body], free) for body in self.joints}

    def spin(self, link: str, *, seen_from: str | None = None) -> Rates:
        """Return the speed of a link about its own axis as a linear form in the joint rates.

        Parameters
        ----------
        link : str
            Link that rotates.
        seen_from : str, optional
            Link relative to which it rotates, on the same axis or a parallel one. Default: the frame, which requires
            all axes from the link to the frame to be parallel.

        Returns
        -------
        dict of str to Fraction
            Factor of each joint rate.

        Raises
        ------
        GearboxError
            If a link is unknown, or axes are not parallel.

        Examples
        --------
        >>> import hums
        >>> kinematics = hums.solve_kinematics(hums.load_gearbox("planetary-27-36-99"))
        >>> {body: int(factor) for body, factor in kinematics.spin("planet 1").items()}
        {'planet 1': 1, 'carrier': 1}
        """
        body = self._body(link)
        if seen_from is None:
            return dict(self._absolute(body))
        other = self._body(seen_from)
        if body == other:
            return {}
        axis = self.mechanism.shared_axis(body, other)
        if axis is not None:
            return difference(self._rate_on(body, axis), self._rate_on(other, axis))
        if other == self.mechanism.frame:
            return dict(self._absolute(body))
        sense = self._relative_sense(body, other)
        reference = {name: sense * factor for name, factor in self._absolute(other).items()}
        return difference(self._absolute(body), reference)

    def relative_speed(self, link: str, *, seen_from: str, speeds: Speeds | None = None) -> Fraction:
        """Return the signed speed of a link about its axis relative to another link.

        Parameters
        ----------
        link, seen_from : str
            As in `spin`.
        speeds : mapping of str to float or Fraction, optional
            As in `rates`.

        Returns
        -------
        Fraction
            Speed in the unit of `speeds`; exact if they are.

        Examples
        --------
        >>> import hums
        >>> kinematics = hums.solve_kinematics(hums.load_gearbox("two-stage"))
        >>> print(kinematics.relative_speed("intermediate", seen_from="housing"))  # 23 teeth drive 67
        -23/67
        """
        return evaluate(self.spin(link, seen_from=seen_from), self.rates(speeds))

    def vectors(self, speeds: Speeds | None = None) -> xr.DataArray:
        """Return the angular velocity vector of every link at the declared configuration.

        Parameters
        ----------
        speeds : mapping of str to float or Fraction, optional
            As in `rates`.

        Returns
        -------
        xarray.DataArray
            (link, component), in the unit of `speeds`.

        Examples
        --------
        >>> import hums
        >>> kinematics = hums.solve_kinematics(hums.load_gearbox("two-stage"))
        >>> kinematics.vectors({"input": 67}).sel(link="intermediate").values.tolist()
        [-23.0, 0.0, 0.0]
        """
        rates = self.rates(speeds)
        of_body = {self.mechanism.frame: np.zeros(3)}
        carriers = {body: [joint.carried_by] for body, joint in self.joints.items()}
        for body in TopologicalSorter(carriers).static_order():
            if (joint := self.joints.get(body)) is None:
                continue  # the frame
            direction = np.array(self.mechanism.directions[joint.axis])
            of_body[body] = of_body[joint.carried_by] + float(rates[body]) * direction
        table = np.array([of_body[self.bodies[link]] for link in self.links])
        return xr.DataArray(
            table, dims=("link", "component"), coords={"link": list(self.links), "component": list("xyz")}
        )

    def velocities(self, speeds: Speeds | None = None) -> xr.DataArray:
        """Return the complex angular velocity of every link: x is real, y imaginary.

        Parameters
        ----------
        speeds : mapping of str to float or Fraction, optional
            As in `rates`.

        Returns
        -------
        xarray.DataArray
            (link,), complex, in the unit of `speeds`.

        Raises
        ------
        GearboxError
            If an axis is not in the x-y plane; use `vectors`.

        Examples
        --------
        >>> import hums
        >>> kinematics = hums.solve_kinematics(hums.load_gearbox("two-stage"))
        >>> complex(kinematics.velocities({"input": 67}).sel(link="intermediate"))
        (-23+0j)
        """
        self._require_plane()
        vectors = self.vectors(speeds)
        return xr.DataArray(
            vectors.sel(component="x").to_numpy() + 1j * vectors.sel(component="y").to_numpy(),
            dims="link",
            coords={"link": list(self.links)},
        )

    def velocity_ratios(self, inputs: Sequence[str] | None = None) -> xr.DataArray:
        """Return the velocity ratio matrix Omega_0 of Penaud, Alazard and Amiez 2012.

        Parameters
        ----------
        inputs : sequence of str, optional
            Links, as many as there are degrees of freedom. Default: the gearbox's reference.

        Returns
        -------
        xarray.DataArray
            (link, input), complex, 1 at each input; its argument is the angle to the input's own axis.

        Raises
        ------
        GearboxError
            As in `velocities` and `rates`.

        Examples
        --------
        >>> import hums
        >>> kinematics = hums.solve_kinematics(hums.load_gearbox("two-stage"))
        >>> ratio = kinematics.velocity_ratios(["input"]).sel(link="output", input="input").item()
        >>> round(ratio.real * 67 * 61, 9)  # (-23 / 67) (-19 / 61)
        437.0
        """
        names = tuple(self._unit_reference_speed()) if inputs is None else tuple(inputs)
        columns = []
        for name in names:
            velocities = self.velocities({other: Fraction(int(other == name)) for other in names})
            columns.append(velocities.to_numpy() / velocities.sel(link=name).item())
        return xr.DataArray(
            np.stack(columns, axis=1), dims=("link", "input"), coords={"link": list(self.links), "input": list(names)}
        )

    # ---- constraint matrix ---------------------------------------------------------------------------------

    @cached_property
    def constraint_matrix(self) -> NDArray[np.complex128]:
        """The kinematic constraint matrix M of Penaud, Alazard and Amiez 2012, 2.4: (1 + meshes + rigid, link).

        The first row holds the frame at rest, the next are those of meshes of two gears, and the last equate links of
        the same body. The entries of a mesh are its gears' teeth, rotated by ``pitch_angle_deg`` if declared, else by
        the axes' directions, which gives the same row up to a unit factor.
        """
        self._require_plane()
        terms: list[Mapping[str, complex]] = [{self.gearbox.frame: 1.0}]
        for contact in self.contacts:
            if len(contact.gears) == 1:
                continue
            weights = self._mesh_weights(contact)
            row = {link: weight for (link, _), weight in zip(contact.gears, weights, strict=True)}
            row[contact.carrier] = row.get(contact.carrier, 0) - sum(weights)
            terms.append(row)
        terms += [{link: 1.0, body: -1.0} for link, body in self.bodies.items() if link != body]
        column = {link: number for number, link in enumerate(self.links)}
        matrix = np.zeros((len(terms), len(column)), dtype=np.complex128)
        for number, entries in enumerate(terms):
            for link, weight in entries.items():
                matrix[number, column[link]] += weight
        return matrix

    def _mesh_weights(self, contact: Contact) -> list[complex]:
        """Return the entries of a contact's gears in the constraint matrix: teeth times exp(j angle)."""
        if contact.pitch_angle_deg is not None:
            angles = np.radians(contact.pitch_angle_deg)
            return [abs(teeth) * complex(np.exp(1j * a)) for (_, teeth), a in zip(contact.gears, angles, strict=True)]
        weights = []
        for link, teeth in contact.gears:
            axis = self.mechanism.shared_axis(self.bodies[link], contact.carrier)
            x, y, _ = self.mechanism.directions[axis or ""]
            weights.append(teeth * complex(x, -y))
        return weights

    def _require_plane(self) -> None:
        for axis, (_, _, z) in self.mechanism.directions.items():
            if abs(z) > _IN_PLANE:
                raise GearboxError(
                    f'axis "{axis}" is not in the x-y plane, so complex numbers cannot hold its speeds; use vectors().'
                )

    # ---- linear forms in the joint rates -------------------------------------------------------------------

    def _unit_reference_speed(self) -> dict[str, Fraction]:
        if self.gearbox.reference is None:
            raise GearboxError(
                f'gearbox "{self.gearbox.name}" declares no reference; add reference = "LINK" or name the inputs.'
            )
        return {self.gearbox.reference: ONE}

    def _body(self, link: str) -> str:
        if link not in self.bodies:
            raise GearboxError(f'gearbox "{self.gearbox.name}" has no link "{link}"{closest(link, list(self.bodies))}')
        return self.bodies[link]

    def _rate_on(self, body: str, axis: str) -> Rates:
        """Return the rate of a body about an axis relative to the axis' carrier; zero for the carrier itself."""
        return {body: ONE} if body in self.joints and self.joints[body].axis == axis else {}

    def _relative_sense(self, body: str, other: str) -> int:
        """Return +1 for parallel axes of two bodies, -1 for antiparallel ones; refuse others."""
        one, two = (self.mechanism.directions[self.joints[name].axis] for name in (body, other))
        cosine = sum(a * b for a, b in zip(one, two, strict=True))
        if abs(abs(cosine) - 1) > _IN_PLANE:
            raise GearboxError(
                f'"{body}" and "{other}" rotate about axes in different directions, so their relative speed is not one '
                "number; use the speed relative to the carrier, or vectors()."
            )
        return round(cosine)

    def _absolute(self, body: str) -> Rates:
        """Return the absolute speed of a body about its own axis: its joint rate and those of its carriers."""
        cache = self._absolute_cache
        if body not in cache:
            joint = self.joints[body]
            form = {body: ONE}
            if joint.carried_by != self.mechanism.frame:
                sense = self._relative_sense(body, joint.carried_by)
                form |= {name: sense * factor for name, factor in self._absolute(joint.carried_by).items()}
            cache[body] = form
        return cache[body]

    @cached_property
    def _absolute_cache(self) -> dict[str, Rates]:
        return {self.mechanism.frame: {}}

    def _refuse_contradiction(
        self, residual: Rates, link: str, speed: Fraction, values: Mapping[str, Fraction]
    ) -> None:
        others = [name for name in values if name != link and _imposed(name) in residual]
        symbols = {_imposed(name): value for name, value in values.items()}
        needed = -evaluate({key: f for key, f in residual.items() if key != _imposed(link)}, symbols)
        implied = float(needed / residual[_imposed(link)])
        given = " and ".join(f'"{name}" = {float(values[name]):g}' for name in others) or "the mechanism"
        raise GearboxError(
            f'speeds are contradictory: {given} imply {implied:g} for "{link}", but it is given as '
            f"{float(speed):g}. Omit one of them, or correct it."
        )


@checked
def solve_kinematics(
    gearbox: Gearbox,
    *,
    fixed: Iterable[str] = (),
    constraints: Iterable[Mapping[str, float | Fraction]] = (),
) -> Kinematics:
    """Solve the kinematics of a gearbox for the ratios of all its speeds.

    Each mesh between gears i and j on carrier k is an equation ``Z_i (w_i - w_k) + Z_j (w_j - w_k) = 0`` (Willis),
    solved in rational arithmetic.

    Parameters
    ----------
    gearbox : Gearbox
        From `load_gearbox` or `from_adjacency_table`.
    fixed : iterable of str
        Links held at rest, in addition to the frame.
    constraints : iterable of mappings of str to float or Fraction
        Linear relations between speeds, each a factor by link: the speeds of the links along their own axes times these
        factors sum to zero.

    Returns
    -------
    Kinematics

    Raises
    ------
    GearboxError
        If the gearbox is not a mechanism (see `hums.gearbox.mechanism`) or cannot move, or the rings of a bearing are
        one body.

    Examples
    --------
    >>> import hums
    >>> gearbox = hums.load_gearbox("planetary-27-36-99")
    >>> kinematics = hums.solve_kinematics(gearbox)
    >>> print(kinematics.relative_speed("carrier", seen_from="housing"))  # 27 / (27 + 99)
    3/14
    """
    fixed, constraints = tuple(fixed), tuple(constraints)
    unsolved = Kinematics(build_mechanism(gearbox), {})
    _check_bearings(unsolved)
    rows = _equations(unsolved, fixed, constraints)
    position = {body: number for number, body in enumerate(unsolved.joints)}
    pivots: dict[str, Rates] = {}
    users: dict[str, set[str]] = {}
    for _, row in rows:
        residual = reduced(row, pivots)
        if residual:
            # the body declared last is expressed by earlier ones, so that inputs tend to stay free
            add_pivot(pivots, residual, max(residual, key=position.__getitem__), users=users)
    solved = Kinematics(unsolved.mechanism, pivots)
    locked = [
        body for body, form in pivots.items() if not form and solved.joints[body].carried_by == solved.mechanism.frame
    ]
    if solved.dof == 0 or (locked and not (fixed or constraints)):
        what = f'gearbox "{gearbox.name}"' if solved.dof == 0 else f'gearbox "{gearbox.name}": "{locked[0]}"'
        raise GearboxError(
            f"{what} cannot move: it is locked by {_locking_equations(rows)}. Check the signs of the teeth "
            "(minus: internal gear), the rigid and the fixed links; make a link at rest rigid with the frame."
        )
    return solved


def redundant_meshes(kinematics: Kinematics) -> list[str]:
    """Return the redundant meshes, whose equation follows from earlier ones, each with its redundant copies.

    A redundant mesh carries load, but removes no degree of freedom: the speeds are the same without it.

    Examples
    --------
    >>> import hums
    >>> from hums.gearbox.kinematics import redundant_meshes
    >>> redundant_meshes(hums.solve_kinematics(hums.load_gearbox("planetary-27-36-99")))
    ['planet-ring (planet 2 and planet 3): constraint already imposed by the preceding meshes']
    """
    pivots: dict[str, Rates] = {}
    found: dict[str, list[str]] = {}
    pairs = [contact for contact in kinematics.contacts if len(contact.gears) > 1]
    for contact, (_, row) in zip(pairs, _equations(kinematics, (), ()), strict=True):
        residual = reduced(row, pivots)
        if residual:
            add_pivot(pivots, residual, next(iter(residual)))
        else:
            copies = [link for link, _ in contact.gears if link in kinematics.gearbox.copy_links]
            found.setdefault(contact.mesh, []).extend(copies[:1])
    return [
        f"{mesh}{copies and f' ({copies})'}: constraint already imposed by the preceding meshes"
        for mesh, copies in ((mesh, " and ".join(copies)) for mesh, copies in found.items())
    ]


def _check_bearings(unsolved: Kinematics) -> None:
    for bearing in unsolved.gearbox.bearings:
        inner, outer = bearing.inner_ring, bearing.outer_ring
        bodies = [unsolved.bodies[unsolved.gearbox.instances(ring)[0]] for ring in (inner, outer)]
        if bodies[0] == bodies[1]:
            why = "are one link" if inner == outer else "are rigid with each other"
            raise GearboxError(
                f'bearing "{bearing.names[0]}": inner_ring = "{inner}" and outer_ring = "{outer}" {why}, so it cannot '
                "rotate; name the links on either side of it, or omit the bearing."
            )
        if unsolved.mechanism.shared_axis(*bodies) is None:
            on = [", ".join(unsolved.mechanism.axes_of[body]) or "no axis" for body in bodies]
            raise GearboxError(
                f'bearing "{bearing.names[0]}": inner_ring = "{inner}" is on {on[0]} and outer_ring = "{outer}" on '
                f"{on[1]}, which are not coaxial; name two links of one axis, or list them on one axis."
            )


def _equations(
    unsolved: Kinematics, fixed: Iterable[str], constraints: Iterable[Mapping[str, float | Fraction]]
) -> list[tuple[str, Rates]]:
    """Return the equations ``form = 0`` in the joint rates, each with the name of its mesh or constraint."""

    def combined(weights: Iterable[tuple[str, float | Fraction]], seen_from: str | None = None) -> Rates:
        form: Rates = {}
        for link, weight in weights:
            spin = unsolved.spin(link, seen_from=seen_from)
            add(form, {body: Fraction(weight) * factor for body, factor in spin.items()})
        return form

    pairs = (contact for contact in unsolved.contacts if len(contact.gears) > 1)
    rows = [(f'mesh "{contact.mesh}"', combined(contact.gears, contact.carrier)) for contact in pairs]
    rows += [(f'fixed "{link}"', unsolved.spin(link)) for link in fixed]
    rows += [(f"constraint {number}", combined(given.items())) for number, given in enumerate(constraints, 1)]
    return rows


def _locking_equations(rows: Sequence[tuple[str, Rates]]) -> str:
    """Return the names of the smallest set of equations that holds a body at rest.

    Every equation gets its own slack variable. A body whose rate is a combination of slack variables only is held by
    their equations.
    """
    pivots: dict[str, Rates] = {}
    for number, (_, row) in enumerate(rows):
        residual = reduced(row | {_imposed(str(number)): -ONE}, pivots)
        body = next((name for name in residual if not _is_imposed(name)), None)
        if body is not None:
            add_pivot(pivots, residual, body)
    locked = min((form for form in pivots.values() if all(map(_is_imposed, form))), key=len)
    return ", ".join(dict.fromkeys(rows[int(key.removeprefix(_IMPOSED))][0] for key in locked))


# ---- symbols of imposed speeds in linear forms -----------------------------------------------------------------

_IMPOSED = "\0"  # prefix that no body's name has


def _imposed(name: str) -> str:
    return _IMPOSED + name


def _is_imposed(name: str) -> bool:
    return name.startswith(_IMPOSED)


def _fraction(link: str, speed: object) -> Fraction:
    if not is_float(speed) or not math.isfinite(speed):
        raise GearboxError(f'speeds: "{link}" = {brief(speed)} is not a finite number; give the speed as a number.')
    return Fraction(speed) if isinstance(speed, int | Fraction) else Fraction(float(speed))


def _vanishes(form: Rates, values: Mapping[str, Fraction], *, exact: bool) -> bool:
    """Return whether a linear form in the imposed speeds is zero, within 1e-9 of its largest term unless exact."""
    terms = [factor * values[name.removeprefix(_IMPOSED)] for name, factor in form.items()]
    total = abs(sum(terms, ZERO))
    return total == 0 if exact else total <= Fraction(1, 10**9) * max((abs(term) for term in terms), default=ZERO)
