"""Axes and contacts of a gearbox with their dimensions, before and during placement."""

import math
from dataclasses import dataclass
from statistics import median

import numpy as np

from hums.gearbox.components import Mesh, Vector, planet_angles
from hums.gearbox.layout.shapes import PARALLEL, Array, Line, orthogonal, rotated, transverse_axes, vector
from hums.gearbox.mechanism import Contact, Mechanism


@dataclass(frozen=True)
class Pair:
    """A contact with the lines of its gears."""

    number: int
    contact: Contact
    mesh: Mesh
    lines: tuple[str, ...]
    parallel: bool
    module: float

    @property
    def rolling(self) -> bool:
        """Whether pitch circles or cones touch, unlike those of belts and crossed axes."""
        return self.mesh.kind is None

    def key(self, which: int) -> tuple[str, int, str, str]:
        """Return the identity of a gear across meshes: link, teeth, line, and for a ring the stage."""
        link, teeth = self.contact.gears[which]
        return (link, teeth, self.lines[which], self.contact.carrier if teeth < 0 and self.parallel else "")


class Stages:
    """The lines and contacts of a gearbox; placement fills the lines and `places`."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.gearbox = mechanism.gearbox
        self.meshes = {mesh.name: mesh for mesh in self.gearbox.meshes}
        self.normal = self._normal()
        self.lines = self._unplaced_lines()
        modules = self._modules()
        self.any_module = any(mesh.module_mm for mesh in self.gearbox.meshes)
        self.pairs = [
            self._pair(number, contact, modules[contact.mesh]) for number, contact in enumerate(mechanism.contacts)
        ]
        self.places: dict[int, float] = {}  # of a contact: along its first gear's line
        self.notes: list[str] = []

    def _normal(self) -> Array:
        """Return the normal of the plane of the section: that of the first two axes that are not parallel."""
        directions = [np.array(vector) for vector in self.mechanism.directions.values()]
        for other in directions:
            normal = np.cross(directions[0], other)
            if np.linalg.norm(normal) > PARALLEL:
                normal = normal / np.linalg.norm(normal)
                return np.asarray(normal if normal[int(np.argmax(np.abs(normal)))] > 0 else -normal)
        z = np.array([0.0, 0.0, 1.0])
        return z if abs(directions[0][2]) < PARALLEL else orthogonal(directions[0])

    def _unplaced_lines(self) -> dict[str, Line]:
        lines = {}
        for axis in self.gearbox.axes:
            angles = planet_angles(axis.copies, axis.spacing_deg) if axis.copies else [0.0]
            for name, angle in zip(axis.instances(), angles, strict=True):
                direction = np.array(self.mechanism.directions[name])
                line = Line(name, direction, math.radians(angle), copied=axis.copies is not None)
                if axis.through is not None and axis.copies is None:
                    line.origin = np.array(axis.through)
                lines[name] = line
        for name, line in lines.items():  # bevel planets are rotated about their carrier's axis
            about = self._carrier_axis(name)
            if about is not None and line.angle_rad:
                line.direction = rotated(line.direction, lines[about].direction, line.angle_rad)
        return lines

    def _carrier_axis(self, line: str) -> str | None:
        """Return the axis about which the carrier of a line rotates."""
        for joint in self.mechanism.joints.values():
            if joint.axis == line and joint.carried_by in self.mechanism.joints:
                return self.mechanism.joints[joint.carried_by].axis
        return None

    def _modules(self) -> dict[str, float]:
        """Return the module of each mesh: declared, else that of a mesh that shares a gear, else a typical one."""
        cosines = {name: math.cos(math.radians(mesh.helix_angle_deg or 0)) for name, mesh in self.meshes.items()}
        found = {name: mesh.module_mm / cosines[name] for name, mesh in self.meshes.items() if mesh.module_mm}
        usual = median(found.values()) if found else 1.0
        gears = {name: {(gear.link, abs(gear.teeth)) for gear in mesh.gears} for name, mesh in self.meshes.items()}
        for _ in self.meshes:
            for name in self.meshes:
                if name not in found:
                    shared = [module for other, module in found.items() if gears[name] & gears[other]]
                    found |= {name: shared[0]} if shared else {}
        return {name: found.get(name, usual) for name in self.meshes}

    def _pair(self, number: int, contact: Contact, module: float) -> Pair:
        bodies = self.mechanism.bodies
        lines = tuple(
            self.mechanism.shared_axis(bodies[link], contact.carrier) or next(iter(self.lines))
            for link, _ in contact.gears
        )
        directions = [self.lines[name].direction for name in lines]
        parallel = len(lines) < 2 or bool(np.linalg.norm(np.cross(directions[0], directions[1])) < PARALLEL)  # noqa: PLR2004
        return Pair(number, contact, self.meshes[contact.mesh], lines, parallel, module)

    def face(self, pair: Pair) -> float:
        """Return the face width of a contact, if undeclared at most a third of its largest diameter."""
        if pair.mesh.face_width_mm and self.any_module:
            return pair.mesh.face_width_mm
        largest = max(abs(teeth) for _, teeth in pair.contact.gears)
        # ten times the module is a typical face width of spur gears
        return min(10.0, largest / 3) * pair.module

    def signs(self, pair: Pair) -> int:
        """Return +1 for two external gears on parallel axes, -1 if one of them is internal."""
        one, two = (teeth for _, teeth in pair.contact.gears)
        along = float(self.lines[pair.lines[0]].direction @ self.lines[pair.lines[1]].direction)
        return 1 if one * two * along > 0 else -1

    def distance(self, pair: Pair) -> float:
        """Return the nominal centre distance of parallel axes, or the distance of crossed ones."""
        one, two = (abs(teeth) * pair.module / 2 for _, teeth in pair.contact.gears)
        if pair.mesh.kind in {"belt", "chain"}:
            return 1.6 * (one + two)  # centre distance of a belt over the sum of its radii
        if not pair.parallel:
            return sum(self.crossed_radii(pair))
        sign = self.signs(pair)
        shift = pair.mesh.profile_shift or (0.0, 0.0)
        # the shift moves the axes by nearly this much; the inclination of the flanks takes a few hundredths of it off
        moved = (shift[0] + shift[-1] if sign > 0 else abs(shift[1] - shift[0])) * (pair.mesh.module_mm or 0.0)
        return (one + two if sign > 0 else abs(one - two)) + moved

    def crossed_radii(self, pair: Pair) -> tuple[float, float]:
        """Return the radii of gears on crossed axes, with a typical radius for a worm."""
        one, two = (abs(teeth) * pair.module / 2 for _, teeth in pair.contact.gears)
        least = 0.35 * max(one, two)  # radius of a worm over that of its wheel, which its starts do not give
        return max(one, least), max(two, least)

    def cones(self, pair: Pair) -> tuple[Array, tuple[float, float], float]:
        """Return the common element of two pitch cones, their signed angles, and the outer cone distance.

        The relative rotation is about the element, along ``z2 a1 + z1 a2`` for ``z1 w1 + z2 w2 = 0``.
        """
        (_, one), (_, two) = pair.contact.gears
        axes = [self.lines[name].direction for name in pair.lines]
        along = math.copysign(1.0, one * two) * (two * axes[0] + one * axes[1])
        element = along / np.linalg.norm(along)
        first, second = (math.acos(max(-1.0, min(1.0, float(element @ axis)))) for axis in axes)
        return element, (first, second), abs(one) * pair.module / 2 / math.sin(first)

    def transverse(self, line: Line) -> tuple[Vector, Vector]:
        """Return two unit vectors normal to a line."""
        return transverse_axes(vector(line.direction), vector(self.normal))
