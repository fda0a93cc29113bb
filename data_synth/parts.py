"""What a gearbox is assembled from: what is given of its parts, and where they stand; see `assembly`."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from data_synth.elements import as_vector
from data_synth.gear_geometry import GearPair
from data_synth.layout import Contact, across, direction_of, height_m, upright
from data_synth.mechanics import Array, Vector
from data_synth.mesh import Stiffness
from data_synth.transmission_error import TransmissionError
from hums.kinematics import Kinematics

_UPRIGHT = 1 - 1e-12


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

    `held` are links of the frame that are bodies of their own, `places` a point of the axis of each body in space
    (empty for torsion), `speeds` as given to `assemble`. With `turning` the coordinates of each body turn with the
    carrier of its meshes.
    """

    kinematics: Kinematics
    contacts: tuple[Contact, ...]
    motions: tuple[str, ...]
    inertias: Mapping[str, Inertia]
    supports: Mapping[str, Holding]
    meshes: Mapping[str, MeshProperties]
    held: tuple[str, ...]
    places: Mapping[str, Array]
    speeds: Mapping[str, float] | None
    turning: bool = False

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

    def mesh(self, contact: Contact) -> MeshProperties:
        """Return what a contact is made of: what is given for it, or for its mesh."""
        return self.meshes.get(contact.name) or self.meshes.get(contact.mesh) or MeshProperties()

    def turns(self, link: str, seen_from: str) -> Fraction:
        """Return the speed of a link about its axis, in the unit of `speeds`."""
        return self.kinematics.relative_speed(link, seen_from=seen_from, speeds=self.speeds)

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

    # ---- where things stand ------------------------------------------------------------------------------

    @cached_property
    def space(self) -> Array:
        """x, y and z of the assembly as directions of space, (3, 3)."""
        z = upright(self.kinematics)
        return np.stack([*across(z), z])

    def axis(self, link: str) -> Vector:
        """Return the direction of the axis a link is declared on, in x, y and z."""
        direction = self.space @ direction_of(self.kinematics, link)
        return (0.0, 0.0, math.copysign(1.0, direction[2])) if abs(direction[2]) > _UPRIGHT else as_vector(direction)

    def upright(self, link: str) -> float:
        """Return the cosine between the axis a link is declared on and z."""
        return self.axis(link)[2]

    def station(self, body: str, carrier: str) -> Array:
        """Return a point on the axis of a body, (3,) m; one of the frame stands on the axis of its mesh's carrier."""
        known = self.places.get(body if body != self.frame and body not in self.held else carrier)
        if known is None:
            raise ValueError(
                f'nothing says where the axis of "{body}" stands; give through = [x, y, z] for its axis in the gearbox.'
            )
        return np.asarray(self.space @ known)

    def foot(self, contact: Contact, gear: int) -> Array:
        """Return the point on the axis of a gear, 0 or 1, that is nearest to where a contact touches, (3,) m."""
        link = contact.links[gear]
        axis, start = np.array(self.axis(link)), self.station(self.body(link), contact.carrier)
        return np.asarray(start + ((self.touches(contact) - start) @ axis) * axis)

    def touches(self, contact: Contact) -> Array:
        """Return a point on the line where the pitch surfaces of a contact touch, (3,) m: of bevels the middle."""
        link = contact.links[1 if contact.swapped else 0]
        start = self.station(self.body(link), contact.carrier)
        start = start + height_m(self.kinematics, contact) * np.array(self.axis(link))
        if contact.cone is None:
            return np.asarray(start)
        return np.asarray(start + contact.cone.distance_m(contact.pair) * (self.space @ np.array(contact.cone.element)))

    def centre(self, body: str, frame: str | None = None) -> Vector:
        """Return the centre of a body, or of its piece in a frame: the mean of the feet of its meshes."""
        if self.torsion:
            return 0.0, 0.0, 0.0
        feet = [self.foot(contact, gear) for contact, gear in self.gears(body, frame)]
        return as_vector(np.mean(feet, axis=0) if feet else self.station(body, body))

    def gears(self, body: str, frame: str | None = None) -> Iterator[tuple[Contact, int]]:
        """Yield the contacts of a body, those of one frame where it is named, with the number of its gear."""
        for contact in self.contacts:
            for number, link in enumerate(contact.links):
                if self.body(link) == body and frame in (None, contact.carrier):
                    yield contact, number

    # ---- what turns with what ----------------------------------------------------------------------------

    def frames(self, body: str) -> tuple[str, ...]:
        """Return what the coordinates of a body turn with, the frame first: carriers of its meshes, and itself.

        A body with gears in several frames has a piece for each.
        """
        if not self.turning or self.torsion:
            return (self.frame,)
        joints = self.kinematics.joints
        found = [contact.carrier for contact, _ in self.gears(body)]
        if body in joints and joints[body].carried_by != self.frame:
            found.append(joints[body].carried_by)
        if any(joint.carried_by == body for joint in joints.values()):
            found.append(body)
        found.sort(key=lambda name: name != self.frame)
        return tuple(dict.fromkeys(found)) or (self.frame,)

    def piece(self, body: str, frame: str) -> str:
        """Return the name of the piece of a body whose coordinates turn with a carrier."""
        frames = self.frames(body)
        return body if frame == frames[0] or frame not in frames else f"{body} ({frame})"

    def frame_ratio(self, frame: str) -> float:
        """Return the turns about z of what turns with a carrier, per revolution of the reference."""
        if frame == self.frame:
            return 0.0
        return float(self.turns(frame, self.frame) / self.unit()) * self.upright(frame)
