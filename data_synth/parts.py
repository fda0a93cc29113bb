"""The bodies and supports of a declared gearbox, with what was not declared filled in; see `assembly`."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from data_synth.elements import Support
from data_synth.gear_geometry import GearPair
from data_synth.layout import Contact, direction_of
from data_synth.mechanics import Body, Vector
from data_synth.mesh import Stiffness
from data_synth.transmission_error import TransmissionError
from hums.gearbox import Bearing
from hums.kinematics import Kinematics

_STEEL_KG_M3 = 7850.0
_RIM_MODULES = 4.0
_MM = 1e-3


@dataclass(frozen=True, kw_only=True)
class Inertia:
    """Mass and moments of inertia of a link about its axis and across it; None: the default for the gears on it."""

    mass_kg: float | None = None
    inertia_kgm2: float | None = None
    tilt_inertia_kgm2: float | None = None


@dataclass(frozen=True, kw_only=True)
class Holding:
    """How a link is held to the one that carries its axis: N/m, and N m/rad; `damping_s` is damping over stiffness."""

    radial: float = 1e8
    axial: float = 1e8
    tilt: float = 1e5
    torsion: float = 0.0
    damping_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class MeshProperties:
    """What a mesh is made of, copies alike; `geometry` where the gearbox does not declare it.

    `damping` is in N s/m; `driver` names the link whose teeth push, where it is not the one nearer to the reference.
    """

    stiffness: Stiffness | None = None
    error: TransmissionError | None = None
    backlash_m: float = 0.0
    damping: float = 0.0
    geometry: GearPair | None = None
    driver: str | None = None


@dataclass(frozen=True, kw_only=True)
class Attached:
    """A rotor outside of the gearbox, as a motor or a load, behind a coupling (N m/rad, N m s/rad)."""

    name: str
    to: str
    inertia_kgm2: float
    stiffness: float
    damping: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Everything `assemble` was given, and where it stands.

    `held` are links of the frame that are bodies of their own, `places` the axes of the bodies in the plane across them
    (empty for torsion), `speeds` as given to `assemble`.
    """

    kinematics: Kinematics
    contacts: tuple[Contact, ...]
    motions: tuple[str, ...]
    inertias: Mapping[str, Inertia]
    supports: Mapping[str, Holding]
    meshes: Mapping[str, MeshProperties]
    held: tuple[str, ...]
    places: Mapping[str, tuple[float, float]]
    speeds: Mapping[str, float] | None

    @property
    def frame(self) -> str:
        """The body at rest."""
        return self.kinematics.mechanism.frame

    @property
    def torsion(self) -> bool:
        """Whether bodies only turn."""
        return self.motions == ("rotation",)

    def body(self, link: str) -> str:
        """Return the name of the body a link belongs to."""
        return link if link in self.held else self.kinematics.bodies[link]

    def turns(self, link: str, seen_from: str) -> Fraction:
        """Return the speed of a link about its axis, in the unit of `speeds`."""
        return self.kinematics.relative_speed(link, seen_from=seen_from, speeds=self.speeds)

    def upright(self, link: str) -> float:
        """Return the cosine between the axis a link is declared on and z, which is the first one."""
        first = next(iter(self.kinematics.joints))
        return float(direction_of(self.kinematics, link) @ direction_of(self.kinematics, first))

    def unit(self) -> Fraction:
        """Return the size of the speed of the reference."""
        reference = self.kinematics.gearbox.reference
        if reference is None:
            raise ValueError(
                f'gearbox "{self.kinematics.gearbox.name}" declares no reference, so mesh cycles cannot be counted; '
                'add reference = "LINK".'
            )
        unit = abs(self.turns(reference, self.frame))
        if not unit:
            raise ValueError(f'the reference "{reference}" does not turn at these speeds; give others.')
        return unit

    def centre(self, body: str) -> Vector:
        """Return the centre of a body; its meshes' mean position along the axis."""
        x, y = self.places.get(body, (0.0, 0.0))
        along = [z for contact in self.contacts for z, link in self._along(contact) if self.body(link) == body]
        return x, y, float(np.mean(along)) if along else 0.0

    def _along(self, contact: Contact) -> Iterator[tuple[float, str]]:
        for link in contact.links:
            yield self.height(contact), link

    def height(self, contact: Contact) -> float:
        """Return where the middle of a mesh's face lies along the axes, m."""
        mesh = next(mesh for mesh in self.kinematics.gearbox.meshes if mesh.name == contact.mesh)
        return _MM * (mesh.position_mm or 0.0)


# ---- bodies ------------------------------------------------------------------------------------------------


def bodies(parts: Parts) -> Iterator[Body]:
    """Yield every body that moves, with the inertia given or that of discs of steel."""
    unit = parts.unit()
    for name in [*parts.kinematics.joints, *parts.held]:
        given = parts.inertias.get(name, Inertia())
        mass, polar, tilt = _discs(parts, name)
        mass = mass if given.mass_kg is None else given.mass_kg
        polar = polar if given.inertia_kgm2 is None else given.inertia_kgm2
        tilt = tilt if given.tilt_inertia_kgm2 is None else given.tilt_inertia_kgm2
        if parts.torsion:
            polar += _carried(parts, name)
        if not polar > 0:
            raise ValueError(
                f'"{name}" has no gear and carries none, so no inertia follows from its teeth; give '
                f'inertias={{"{name}": Inertia(...)}}.'
            )
        axis = parts.upright(name)
        yield Body(
            name=name,
            mass_kg=mass,
            inertia_kgm2=polar,
            tilt_inertia_kgm2=tilt,
            motions=parts.motions,
            centre_m=parts.centre(name),
            axis=(0.0, 0.0, -1.0) if axis < 0 else (0.0, 0.0, 1.0),
            speed_ratio=0.0 if parts.torsion else float(parts.turns(name, parts.frame) / unit),
        )


def _discs(parts: Parts, body: str) -> tuple[float, float, float]:
    """Return mass, polar and transverse moment of the gears on a body, each counted once; else of a carrier's disc."""
    gears: dict[tuple[float, float], tuple[float, float, float]] = {}
    for contact in parts.contacts:
        for number, link in enumerate(contact.links):
            if parts.body(link) == body:
                radius, width = contact.pair.reference_radii_m[number], contact.pair.face_width_m
                internal = number == 1 and contact.pair.teeth[1] < 0
                outer = radius + _RIM_MODULES * contact.pair.module_m if internal else radius
                gears[radius, width] = _disc(outer, radius if internal else 0.0, width)
    if not gears:
        for contact in parts.contacts:
            planet = _planet_of(parts, contact, body)
            if planet is not None:
                gears[0.0, 0.0] = _disc(contact.pair.centre_distance_m, 0.0, contact.pair.face_width_m)
    mass, polar, tilt = np.array([*gears.values(), (0.0, 0.0, 0.0)]).sum(axis=0).tolist()
    return mass, polar, tilt


def _disc(outer: float, inner: float, width: float) -> tuple[float, float, float]:
    mass = _STEEL_KG_M3 * math.pi * (outer**2 - inner**2) * width
    polar = mass * (outer**2 + inner**2) / 2
    return mass, polar, polar / 2 + mass * width**2 / 12


def _planet_of(parts: Parts, contact: Contact, carrier: str) -> str | None:
    """Return the body of a contact that a carrier, other than the frame, holds; None if it holds none."""
    joints = parts.kinematics.joints
    held = [body for body in map(parts.body, contact.links) if body in joints and joints[body].carried_by == carrier]
    return held[0] if held and carrier != parts.frame else None


def _carried(parts: Parts, carrier: str) -> float:
    """Return what planets add to the inertia of their carrier where they only ride on it."""
    planets: dict[str, float] = {}
    for contact in parts.contacts:
        planet = _planet_of(parts, contact, carrier)
        if planet is not None and contact.carrier == carrier and planet not in planets:
            mate = 1 - [parts.body(link) for link in contact.links].index(planet)
            mass, _, tilt = _discs(parts, planet)
            given = parts.inertias.get(planet, Inertia())
            mass = mass if given.mass_kg is None else given.mass_kg
            # a bevel planet turns across the carrier's axis, so all of it turns with the carrier as well
            apart = contact.pair.centre_distance_m if contact.parallel else contact.pair.reference_radii_m[mate]
            planets[planet] = mass * apart**2 + (0.0 if contact.parallel else tilt)
    return sum(planets.values())


# ---- supports ----------------------------------------------------------------------------------------------


def supports_of(parts: Parts) -> Iterator[Support]:
    """Yield what holds each body to the one that carries its axis: its bearings, or one support in its centre."""
    joints = parts.kinematics.joints
    for body in [*joints, *parts.held]:
        holder = joints[body].carried_by if body in joints else parts.frame
        between = (body, None if holder == parts.frame else holder)
        bearings = [] if body in parts.supports or parts.torsion else list(_bearings_of(parts, body, holder))
        x, y, z = parts.centre(body)
        if not bearings:
            yield _support(between, (x, y, z), parts.supports.get(body, Holding()), axial=True, tilt=True)
        apart = len({height for _, height, _ in bearings}) > 1
        for name, height, axial in bearings:
            yield _support(between, (x, y, height), parts.supports.get(name, Holding()), axial=axial, tilt=not apart)


def _support(between: tuple[str, str | None], point: Vector, hold: Holding, *, axial: bool, tilt: bool) -> Support:
    return Support(
        between=between,
        point_m=point,
        x=hold.radial,
        y=hold.radial,
        z=hold.axial if axial else 0.0,
        tilt_x=hold.tilt if tilt else 0.0,
        tilt_y=hold.tilt if tilt else 0.0,
        torsion=hold.torsion,
        damping_s=hold.damping_s,
    )


def _bearings_of(parts: Parts, body: str, holder: str) -> Iterator[tuple[str, float, bool]]:
    """Yield name, place along the axis and whether it holds axially, of the bearings between a body and its holder."""
    gearbox = parts.kinematics.gearbox

    def rings(bearing: Bearing) -> set[str]:
        links = (bearing.inner_ring, bearing.outer_ring)
        return {parts.kinematics.bodies[link] for ring in links for link in gearbox.instances(ring)}

    mine = [bearing for bearing in gearbox.bearings if {body, holder} <= rings(bearing)]
    any_axial = any(bearing.takes_axial for bearing in mine)
    for bearing in mine:
        for number, name in enumerate(bearing.names):
            height = _MM * bearing.position_mm[number] if bearing.position_mm else parts.centre(body)[2]
            yield name, height, name in bearing.takes_axial or not any_axial
