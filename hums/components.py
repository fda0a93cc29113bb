"""The parts of a declared gearbox, axes, gears, meshes and bearings, and the checks of their numbers."""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from hums._planets import planet_angles
from hums.declared import Declared, closest

__all__ = ["X_AXIS", "Axis", "Bearing", "Gear", "Mesh", "Multiples", "Name", "Positive", "Vector", "unit_vector"]

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1)]
X_AXIS: Vector = (1.0, 0.0, 0.0)
_ROUNDING = 0.05  # of the number of elements: above what a data sheet rounds


class Axis(Declared):
    """An axis (level in the papers): the coaxial links, and the direction of their common line.

    ``through`` is a point of the line in mm; ``copies`` repeats the axis round its carrier, at ``spacing_deg``.
    """

    name: Name
    links: Annotated[tuple[Name, ...], Field(min_length=2)]
    direction: Vector | None = None
    parallel_to: Name | None = None
    through: Vector | None = None
    copies: Annotated[int, Field(ge=2)] | None = None
    spacing_deg: tuple[float, ...] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(set(self.links)) != len(self.links):
            raise ValueError("a link is listed twice; list each link of the axis once")
        if self.direction is not None and self.parallel_to is not None:
            raise ValueError("direction and parallel_to are both given; keep one")
        if self.direction is not None and not (any(self.direction) and all(map(math.isfinite, self.direction))):
            raise ValueError(f"direction = {list(self.direction)} is no direction; give a finite, non-zero vector")
        if self.spacing_deg is not None:
            if self.copies is None:
                raise ValueError("spacing_deg is given without copies; say how many copies there are")
            planet_angles(self.copies, self.spacing_deg)
        return self

    def instances(self) -> tuple[str, ...]:
        """Return the names of the copies of this axis, ``planet 1`` and so on; without copies, its own."""
        return tuple(f"{self.name} {number + 1}" for number in range(self.copies or 0)) or (self.name,)


class Gear(Declared):
    """One gear of a mesh: the link that carries its teeth, and their signed number."""

    link: Name
    teeth: int


class Mesh(Declared):
    """Two gears in contact, or one gear whose mate is unknown.

    ``position_mm`` is where the middle of the face lies along the first gear's axis, from that axis' ``through``;
    ``hand`` is the hand of the first gear's helix.
    """

    name: Name
    gears: Annotated[tuple[Gear, ...], Field(min_length=1, max_length=2)]
    carrier: Name | None = None
    kind: Literal["worm", "crossed_helical", "belt", "chain"] | None = None
    module_mm: Positive | None = None
    face_width_mm: Positive | None = None
    pressure_angle_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    helix_angle_deg: Annotated[float, Field(gt=-90, lt=90)] | None = None
    hand: Literal["left", "right"] | None = None
    profile_shift: tuple[float, ...] | None = None
    pitch_angle_deg: tuple[float, ...] | None = None
    position_mm: float | None = None

    @model_validator(mode="before")
    @classmethod
    def _teeth_to_gears(cls, table: Any) -> Any:  # noqa: ANN401
        """Read ``teeth = { sun = 27, planet = 36 }`` and name the mesh after its gears."""
        if not isinstance(table, dict) or "gears" in table:
            return table
        table = dict(table)
        valid = {*cls.model_fields, "teeth"} - {"gears"}
        for key in table:
            if key not in valid:
                raise ValueError(f'unknown key "{key}"{closest(str(key), valid)}')
        teeth = table.pop("teeth", None)
        if not isinstance(teeth, dict) or not teeth:
            raise ValueError(f"teeth = {teeth!r}: write teeth = {{ pinion = 20, wheel = 41 }}")
        table["gears"] = tuple({"link": link, "teeth": count} for link, count in teeth.items())
        table.setdefault("name", "-".join(teeth) if len(teeth) > 1 else f"{next(iter(teeth))}-unknown")
        return table

    @model_validator(mode="after")
    def _check(self) -> Self:
        for gear in self.gears:
            if gear.teeth == 0:
                raise ValueError(f'gear "{gear.link}" has 0 teeth; give a count, minus for an internal gear')
        if len(self.gears) == 1 and self.carrier is None:
            raise ValueError(
                f'mesh "{self.name}" has one gear, so its carrier cannot be found; add carrier = "..." '
                "(the link in which the contact point rests)"
            )
        if self.hand is not None and (self.helix_angle_deg is None or self.helix_angle_deg < 0):
            given = "no helix_angle_deg" if self.helix_angle_deg is None else f"{self.helix_angle_deg:g} degrees"
            raise ValueError(
                f'mesh "{self.name}": hand = "{self.hand}" goes with {given}; give helix_angle_deg without a sign'
            )
        return self


class Multiples(Declared):
    """Defect frequencies of a bearing as a data sheet prints them, per relative turn of its rings."""

    inner: Positive
    outer: Positive
    cage: Positive
    element_spin: Positive | None = None
    element_defect: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _refuse_ball(cls, table: Any) -> Any:  # noqa: ANN401
        if isinstance(table, dict):
            for word in ("ball", "roller", "element"):
                if word in table:
                    raise ValueError(
                        f'"{word}" is ambiguous; say element_spin (BSF: one turn of the element) '
                        "or element_defect (twice that: the defect meets both races)"
                    )
        return table

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.element_spin is None) == (self.element_defect is None):
            raise ValueError("give exactly one of element_spin and element_defect")
        if round(self.inner + self.outer) < 2:  # noqa: PLR2004
            raise ValueError(
                f"inner {self.inner:g} + outer {self.outer:g} is the number of elements, at least 2; "
                "give both per turn of one ring against the other"
            )
        if self.inner <= self.outer:
            raise ValueError(
                f"inner = {self.inner:g} is not above outer = {self.outer:g}; the inner race is struck more often, "
                "so see whether the two are exchanged"
            )
        return self

    @property
    def defect(self) -> float:
        """Impacts of one spot of a rolling element on the races per relative turn of the rings, twice its spin."""
        return self.element_defect if self.element_defect is not None else 2 * (self.element_spin or 0.0)


class Bearing(Declared):
    """A rolling bearing between two links, by geometry or by a data sheet's multiples.

    ``position_mm`` is where each one supports the shaft, along the shaft's axis from the axis' ``through``, in the
    order of ``names``; ``takes_axial`` lists those of the names that hold the shaft along its axis.
    """

    names: Annotated[tuple[Name, ...], Field(min_length=1)]
    inner_ring: Name
    outer_ring: Name
    elements: Annotated[int, Field(ge=2)] | None = None
    element_diameter_mm: Positive | None = None
    pitch_diameter_mm: Positive | None = None
    contact_angle_deg: Annotated[float, Field(ge=0, lt=90)] = 0.0
    multiples: Multiples | None = None
    position_mm: tuple[float, ...] | None = None
    takes_axial: tuple[Name, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _one_name(cls, table: Any) -> Any:  # noqa: ANN401
        """Accept ``name = "x"`` for ``names = ["x"]``."""
        if isinstance(table, dict) and "name" in table and "names" not in table:
            table = dict(table)
            table["names"] = (table.pop("name"),)
        return table

    @model_validator(mode="after")
    def _check(self) -> Self:
        geometry = (self.element_diameter_mm, self.pitch_diameter_mm)
        if self.multiples is not None and geometry != (None, None):
            raise ValueError("both multiples and diameters are given; keep one")
        if self.multiples is None and (None in geometry or self.elements is None):
            raise ValueError(
                "give elements, element_diameter_mm and pitch_diameter_mm, or "
                "multiples = { inner = ..., outer = ..., element_spin = ..., cage = ... }"
            )
        diameter, pitch = geometry
        if diameter is not None and pitch is not None and diameter >= pitch:
            raise ValueError(f"element_diameter_mm = {diameter} is not below pitch_diameter_mm = {pitch}")
        self._check_elements()
        self._check_positions()
        return self

    def _check_positions(self) -> None:
        if self.position_mm is not None and len(self.position_mm) != len(self.names):
            raise ValueError(
                f"position_mm = {list(self.position_mm)} does not fit the names {', '.join(self.names)}; "
                "give one position for each"
            )
        for name in self.takes_axial:
            if name not in self.names:
                raise ValueError(
                    f'takes_axial names "{name}", which is not one of its names{closest(name, list(self.names))}'
                )

    def _check_elements(self) -> None:
        """Refuse a number of elements that the multiples contradict, or that does not fit on the pitch circle."""
        if self.elements is None:
            return
        if self.multiples is not None:
            total = self.multiples.inner + self.multiples.outer
            if abs(total / self.elements - 1) > _ROUNDING:
                raise ValueError(
                    f"multiples inner {self.multiples.inner:g} + outer {self.multiples.outer:g} = {total:g} is not "
                    f"the number of elements, {self.elements}; correct one of them, or leave elements out"
                )
        elif self.element_diameter_mm is not None and self.pitch_diameter_mm is not None:
            circumference_mm = math.pi * self.pitch_diameter_mm
            if self.elements * self.element_diameter_mm > circumference_mm:
                raise ValueError(
                    f"{self.elements} elements of element_diameter_mm = {self.element_diameter_mm:g} do not fit on the "
                    f"pitch circle, which is {circumference_mm:.4g} mm round; correct elements or a diameter"
                )


def unit_vector(vector: Vector) -> Vector:
    """Return the vector divided by its length."""
    largest = max(abs(x) for x in vector)  # divided out first, so that no square overflows
    x, y, z = (x / largest for x in vector)
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length)
