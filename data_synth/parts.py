"""Inputs of the assembly of a gearbox, and the positions of its axes and gears; see `assembly`."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from data_synth.elements import as_vector
from data_synth.gear_geometry import GearPair
from data_synth.layout import Contact, axial_position_m, direction_of, transverse_axes, z_direction
from data_synth.mechanics import Array, Vector
from data_synth.mesh import Stiffness
from data_synth.transmission_error import TransmissionError
from hums.kinematics import Kinematics

_UPRIGHT = 1 - 1e-12


@dataclass(frozen=True, kw_only=True)
class Inertia:
    """Mass and moments of inertia of a link with everything on it; None: the default for the gears on it.

    Attributes
    ----------
    mass_kg : float or None
        Mass in kg.
    inertia_kgm2 : float or None
        Moment of inertia about the axis in kg m2.
    tilt_inertia_kgm2 : float or None
        Moment of inertia about a diameter in kg m2.

    Examples
    --------
    See `data_synth.assembly.assemble`, whose `inertias` it is for.
    """

    mass_kg: float | None = None
    inertia_kgm2: float | None = None
    tilt_inertia_kgm2: float | None = None


@dataclass(frozen=True, kw_only=True)
class SupportStiffness:
    """Stiffness of a bearing, or of a link's support, against the link that carries its axis.

    Attributes
    ----------
    radial, axial : float
        N/m.
    tilt, torsion : float
        N m/rad, across the axis and about it.
    damping_s : float
        Damping over stiffness in s, the same for all of them.

    Examples
    --------
    See `data_synth.assembly.assemble`, whose `supports` it is for.
    """

    radial: float = 1e8
    axial: float = 1e8
    tilt: float = 1e5
    torsion: float = 0.0
    damping_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class MeshProperties:
    """Stiffness, transmission error, backlash and geometry of a mesh, the same for all planets.

    Attributes
    ----------
    stiffness : Stiffness or None
        Mesh stiffness over the mesh phase; the constant mean stiffness of ISO 6336-1 if left out.
    error : TransmissionError or None
        Transmission error over the mesh phase.
    backlash_m : float
        Half the backlash in m.
    damping : float
        N s/m along the line of action.
    geometry : GearPair or None
        Geometry of the teeth, where the gearbox does not declare it.
    driver : str or None
        The driving link, where it is not the one nearer to the reference.

    Examples
    --------
    See `data_synth.assembly.assemble`, whose `meshes` it is for.
    """

    stiffness: Stiffness | None = None
    error: TransmissionError | None = None
    backlash_m: float = 0.0
    damping: float = 0.0
    geometry: GearPair | None = None
    driver: str | None = None


@dataclass(frozen=True, kw_only=True)
class AttachedRotor:
    """A rotor outside of the gearbox, as a motor or a load, connected by a torsional coupling.

    Attributes
    ----------
    name : str
        Name of the new body.
    to : str
        Link of the gearbox to which the coupling connects it.
    inertia_kgm2 : float
        Moment of inertia about the axis of that link in kg m2.
    stiffness, damping : float
        Of the coupling, in N m/rad and N m s/rad.

    Examples
    --------
    See `data_synth.assembly.assemble`, whose `attached` it is for.
    """

    name: str
    to: str
    inertia_kgm2: float
    stiffness: float
    damping: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The inputs of `assemble`, and the positions of axes and gears.

    `elastic_links` are links of the frame that are bodies of their own, `axis_points` has a point of the axis of each
    body in space (empty for torsion), `speeds` as given to `assemble`. With `rotating_coordinates` those of each body
    rotate with the carrier of its meshes.
    """

    kinematics: Kinematics
    contacts: tuple[Contact, ...]
    motions: tuple[str, ...]
    inertias: Mapping[str, Inertia]
    supports: Mapping[str, SupportStiffness]
    meshes: Mapping[str, MeshProperties]
    elastic_links: tuple[str, ...]
    axis_points: Mapping[str, Array]
    speeds: Mapping[str, float] | None
    rotating_coordinates: bool = False

    @property
    def frame(self) -> str:
        """The body at rest."""
        return self.kinematics.mechanism.frame

    @property
    def torsion(self) -> bool:
        """Whether rotation is the only motion of every body."""
        return self.motions == ("rotation",)

    def body(self, link: str) -> str:
        """Return the name of the body a link belongs to."""
        return link if link in self.elastic_links else self.kinematics.bodies[link]

    def mesh(self, contact: Contact) -> MeshProperties:
        """Return the properties given for a contact, or for its mesh, or the defaults."""
        return self.meshes.get(contact.name) or self.meshes.get(contact.mesh) or MeshProperties()

    def relative_speed(self, link: str, seen_from: str) -> Fraction:
        """Return the speed of a link about its axis, relative to another link, in the unit of `speeds`."""
        return self.kinematics.relative_speed(link, seen_from=seen_from, speeds=self.speeds)

    def reference_speed(self) -> Fraction:
        """Return the magnitude of the speed of the reference, in the unit of `speeds`."""
        reference = self.kinematics.gearbox.reference
        if reference is None:
            raise ValueError(
                f'gearbox "{self.kinematics.gearbox.name}" declares no reference, so mesh cycles cannot be counted; '
                'add reference = "LINK".'
            )
        speed = abs(self.relative_speed(reference, self.frame))
        if not speed:
            raise ValueError(f'the reference "{reference}" does not turn at these speeds; give others.')
        return speed

    # ---- positions ---------------------------------------------------------------------------------------

    @cached_property
    def space(self) -> Array:
        """Rows x, y and z of the assembly in the coordinates of the gearbox, (3, 3)."""
        z = z_direction(self.kinematics)
        return np.stack([*transverse_axes(z), z])

    def axis(self, link: str) -> Vector:
        """Return the direction of the axis a link is declared on, in x, y and z."""
        direction = self.space @ direction_of(self.kinematics, link)
        return (0.0, 0.0, math.copysign(1.0, direction[2])) if abs(direction[2]) > _UPRIGHT else as_vector(direction)

    def cosine_to_z(self, link: str) -> float:
        """Return the cosine between the axis a link is declared on and z."""
        return self.axis(link)[2]

    def axis_point(self, body: str, carrier: str) -> Array:
        """Return a point on the axis of a body, (3,) m; a gear of the frame is on the axis of its mesh's carrier."""
        point = self.axis_points.get(body if body != self.frame and body not in self.elastic_links else carrier)
        if point is None:
            raise ValueError(
                f'the position of the axis of "{body}" is unknown; give its axis through = [x, y, z] in the gearbox.'
            )
        return np.asarray(self.space @ point)

    def gear_centre(self, contact: Contact, gear: int) -> Array:
        """Return the point on the axis of a gear, 0 or 1, nearest to the pitch point of a contact, (3,) m."""
        link = contact.links[gear]
        axis, start = np.array(self.axis(link)), self.axis_point(self.body(link), contact.carrier)
        return np.asarray(start + ((self.pitch_point(contact) - start) @ axis) * axis)

    def pitch_point(self, contact: Contact) -> Array:
        """Return a point at the axial position of a contact, (3,) m: on its first axis, of bevels on the pitch line."""
        link = contact.links[1 if contact.swapped else 0]
        start = self.axis_point(self.body(link), contact.carrier)
        start = start + axial_position_m(self.kinematics, contact) * np.array(self.axis(link))
        if contact.cone is None:
            return np.asarray(start)
        return np.asarray(start + contact.cone.distance_m(contact.pair) * (self.space @ np.array(contact.cone.element)))

    def centre(self, body: str, frame: str | None = None) -> Vector:
        """Return the centre of a body, or of its piece in a frame: the mean of the centres of its gears."""
        if self.torsion:
            return 0.0, 0.0, 0.0
        centres = [self.gear_centre(contact, gear) for contact, gear in self.gears(body, frame)]
        return as_vector(np.mean(centres, axis=0) if centres else self.axis_point(body, body))

    def gears(self, body: str, frame: str | None = None) -> Iterator[tuple[Contact, int]]:
        """Yield the contacts of a body, those of one frame where it is named, with the number of its gear."""
        for contact in self.contacts:
            for number, link in enumerate(contact.links):
                if self.body(link) == body and frame in (None, contact.carrier):
                    yield contact, number

    # ---- rotating coordinates ----------------------------------------------------------------------------

    def frames(self, body: str) -> tuple[str, ...]:
        """Return the links with which a body's coordinates rotate, the frame first: carriers of its meshes, and itself.

        A body with gears on several of them has a piece for each.
        """
        if not self.rotating_coordinates or self.torsion:
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
        """Return the name of the piece of a body whose coordinates rotate with a carrier."""
        frames = self.frames(body)
        return body if frame == frames[0] or frame not in frames else f"{body} ({frame})"

    def frame_ratio(self, frame: str) -> float:
        """Return the speed of a carrier about z over that of the reference."""
        if frame == self.frame:
            return 0.0
        return float(self.relative_speed(frame, self.frame) / self.reference_speed()) * self.cosine_to_z(frame)
