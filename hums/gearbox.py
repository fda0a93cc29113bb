"""The declared mechanism: links, axes, meshes and bearings of a gearbox, read from a TOML file.

Teeth are signed so that every mesh obeys ``Z_i w_i + Z_j w_j = 0``, speeds along the declared axes and
relative to the carrier. A minus marks an internal gear on a parallel mesh, and a gear on the negative
side of the apex on a bevel mesh.
"""

import math
import warnings
from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import permutations
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from hums._planets import assembly_warnings, coaxial_warning, stations
from hums.declared import Declared, closest, named_file, read_toml, shipped_files, validated

# what every hand-written file shares is re-exported: `data_synth` enters by this door
__all__ = [
    "Axis",
    "Bearing",
    "Declared",
    "Gear",
    "Gearbox",
    "GearboxError",
    "GearboxWarning",
    "Mesh",
    "Multiples",
    "Name",
    "Positive",
    "Vector",
    "catalogue",
    "closest",
    "load_gearbox",
    "named_file",
    "read_toml",
    "shipped_files",
    "validated",
]

Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1)]
X_AXIS: Vector = (1.0, 0.0, 0.0)
_WHOLE = 0.0101  # a data sheet prints two decimals: inner + outer should be whole within the rounding of both
_ROUNDED = 0.05  # of the number of elements: more than this no data sheet rounds


class GearboxError(ValueError):
    """A gearbox that cannot be read, or that is not a mechanism."""


class GearboxWarning(UserWarning):
    """A gearbox that can be solved but whose numbers deserve a second look."""


class Axis(Declared):
    """A level: the links that turn about one common line, and that line's direction."""

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
        if self.direction is not None and not _is_direction(self.direction):
            raise ValueError(f"direction = {list(self.direction)} is no direction; give a finite, non-zero vector")
        if self.spacing_deg is not None:
            if self.copies is None:
                raise ValueError("spacing_deg is given without copies; say how many copies there are")
            stations(self.copies, self.spacing_deg)
        return self

    def instances(self) -> tuple[str, ...]:
        """Return the names of the axes this one stands for: itself, or its numbered copies."""
        return tuple(f"{self.name} {number + 1}" for number in range(self.copies or 0)) or (self.name,)


class Gear(Declared):
    """One gear of a mesh: the link that carries its teeth, and their signed number."""

    link: Name
    teeth: int


class Mesh(Declared):
    """Two gears in contact, or one gear whose mate is unknown.

    ``position_mm`` is where the middle of the face lies along the first gear's axis, from that axis' ``through``;
    ``hand`` is the sense of the first gear's helix.
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
    """Defect rates of a bearing as a data sheet prints them, per turn of one ring against the other."""

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
        """Rate at which one spot of a rolling element meets a race, twice its spin."""
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
        self._check_places()
        return self

    def _check_places(self) -> None:
        if self.position_mm is not None and len(self.position_mm) != len(self.names):
            raise ValueError(
                f"position_mm = {list(self.position_mm)} does not fit the names {', '.join(self.names)}; "
                "give one position for each"
            )
        for name in self.takes_axial:
            if name not in self.names:
                raise ValueError(f'takes_axial names "{name}", which is not here{closest(name, list(self.names))}')

    def _check_elements(self) -> None:
        """Refuse a number of elements that the multiples contradict, or that does not fit on the pitch circle."""
        if self.elements is None:
            return
        if self.multiples is not None:
            total = self.multiples.inner + self.multiples.outer
            if abs(total / self.elements - 1) > _ROUNDED:
                raise ValueError(
                    f"multiples inner {self.multiples.inner:g} + outer {self.multiples.outer:g} = {total:g} is not "
                    f"the number of elements, {self.elements}; correct one of them, or leave elements out"
                )
        elif self.element_diameter_mm is not None and self.pitch_diameter_mm is not None:
            room = math.pi * self.pitch_diameter_mm
            if self.elements * self.element_diameter_mm > room:
                raise ValueError(
                    f"{self.elements} elements of element_diameter_mm = {self.element_diameter_mm:g} do not fit on the "
                    f"pitch circle, which is {room:.4g} mm round; correct elements or a diameter"
                )


class Gearbox(Declared):
    """A mechanism of links, axes, meshes and bearings. Built by `load_gearbox` or `Gearbox.from_toml`."""

    name: Name
    frame: Name
    reference: Name | None = None
    rigid: tuple[Annotated[tuple[Name, ...], Field(min_length=2)], ...] = ()
    link_order: tuple[Name, ...] | None = None
    axes: Annotated[tuple[Axis, ...], Field(min_length=1)]
    meshes: tuple[Mesh, ...] = Field(default=(), alias="mesh")
    bearings: tuple[Bearing, ...] = Field(default=(), alias="bearing")

    @model_validator(mode="before")
    @classmethod
    def _tables_to_axes(cls, table: Any) -> Any:  # noqa: ANN401
        """Read ``[axes] main = [...]`` and ``planet = { links = [...], copies = 3 }``."""
        if isinstance(table, dict) and isinstance(table.get("axes"), dict):
            axes = tuple(
                {"name": name, **body} if isinstance(body, dict) else {"name": name, "links": body}
                for name, body in table["axes"].items()
            )
            table = table | {"axes": axes}
        return table

    @model_validator(mode="after")
    def _check(self) -> Self:
        known = {link for axis in self.axes for link in axis.links} | {x for group in self.rigid for x in group}
        for link, user in self._mentions():
            if link not in known:
                raise ValueError(
                    f'{user} names the link "{link}", which is on no axis{closest(link, known)}'
                    if user != "frame"
                    else f'frame = "{link}" is on no axis{closest(link, known)}'
                )
        for kind, names in (
            ("axis", [axis.name for axis in self.axes]),
            ("mesh", [mesh.name for mesh in self.meshes]),
            ("bearing", [name for bearing in self.bearings for name in bearing.names]),
        ):
            twice = {name for name in names if names.count(name) > 1}
            if twice:
                raise ValueError(f'two of kind {kind} are called "{min(twice)}"; add name = "..." to tell them apart')
        self._check_copies()
        if self.link_order is not None and sorted(self.link_order) != sorted(known):
            wrong = sorted(set(self.link_order) ^ known)
            raise ValueError(f"link_order must list every link once; look at {', '.join(wrong) or 'the repeated ones'}")
        axis_names = {axis.name for axis in self.axes}
        for axis in self.axes:
            if axis.parallel_to is not None and axis.parallel_to not in axis_names - {axis.name}:
                raise ValueError(f'axis "{axis.name}": parallel_to = "{axis.parallel_to}" is no other axis')
        self.directions()  # refuses a circle of parallel_to
        return self

    def _check_copies(self) -> None:
        copied = self.copied
        for key, link in (("frame", self.frame), ("reference", self.reference)):
            if link in copied:
                raise ValueError(f'{key} = "{link}" stands for {copied[link]} copies; name a link there is one of')
        for link, copies in copied.items():
            counts = {axis.copies for axis in self.axes if link in axis.links}
            if len(counts) > 1:
                raise ValueError(f'"{link}" is on axes with {copies} and {max(c or 1 for c in counts)} copies; use one')
        groups = [(f'mesh "{mesh.name}"', [gear.link for gear in mesh.gears]) for mesh in self.meshes]
        groups += [("rigid", list(group)) for group in self.rigid]
        for user, links in groups:
            several = {copied[link]: link for link in links if link in copied}
            if len(several) > 1:
                found = " and ".join(f'"{link}" of {copies} copies' for copies, link in sorted(several.items()))
                raise ValueError(f"{user} joins {found}; each copy needs its own mate, so give both the same copies")
        for kind, names in (
            ("link", list(self.links)),
            ("axis", [name for axis in self.axes for name in axis.instances()]),
        ):
            twice = {name for name in names if names.count(name) > 1}
            if twice:
                raise ValueError(f'the {kind} "{min(twice)}" has the name of a numbered copy; call it otherwise')

    def _mentions(self) -> list[tuple[str, str]]:
        mentions = [(self.frame, "frame")]
        if self.reference is not None:
            mentions.append((self.reference, "reference"))
        for mesh in self.meshes:
            mentions += [(gear.link, f'mesh "{mesh.name}"') for gear in mesh.gears]
            mentions += [(mesh.carrier, f'mesh "{mesh.name}"')] if mesh.carrier else []
        for bearing in self.bearings:
            mentions += [(ring, f'bearing "{bearing.names[0]}"') for ring in (bearing.inner_ring, bearing.outer_ring)]
        return mentions

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any], *, where: str = "gearbox") -> "Gearbox":
        """Validate a parsed gearbox file; `where` names it in errors. Warns of numbers that do not add up."""
        gearbox = validated(cls, dict(table), where=where, error=GearboxError)
        for sentence in (
            *_rounded_multiples(gearbox),
            *_planets_that_do_not_fit(gearbox),
            *_forgotten_minus(gearbox),
        ):
            warnings.warn(sentence if sentence.endswith("?") else f"{sentence}.", GearboxWarning, stacklevel=3)
        return gearbox

    @classmethod
    def from_toml(cls, path: str | Path) -> "Gearbox":
        """Read a gearbox file; without ``name`` in it, the gearbox is called like the file."""
        path = Path(path)
        return cls.from_mapping({"name": path.stem} | read_toml(path, error=GearboxError), where=str(path))

    def to_toml(self) -> str:
        """Write the gearbox as a file that `from_toml` reads back to an equal one."""
        import tomli_w  # noqa: PLC0415

        table = self.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_defaults=True)
        axes = {axis.pop("name"): axis for axis in table.pop("axes")}
        meshes = table.pop("mesh", [])
        for mesh in meshes:
            mesh["teeth"] = {gear["link"]: gear["teeth"] for gear in mesh.pop("gears")}
        bearings = table.pop("bearing", [])
        return tomli_w.dumps(table | {"axes": axes, "mesh": meshes, "bearing": bearings})

    @property
    def copied(self) -> dict[str, int]:
        """Links that exist several times, with how often: those on axes with ``copies`` and on no other axis.

        A link on no axis exists as often as the links it is rigid with.
        """
        return dict(self._copied)

    @cached_property
    def _copied(self) -> tuple[tuple[str, int], ...]:
        single = {link for axis in self.axes if axis.copies is None for link in axis.links}
        copied = {
            link: axis.copies
            for axis in self.axes
            if axis.copies is not None
            for link in axis.links
            if link not in single
        }
        for group in self.rigid * len(self.rigid):  # as often as a chain of groups can be long
            counts = {copied.get(link, 1) for link in group if link in copied or link in single}
            if len(counts) == 1 and counts != {1}:
                copied.update(dict.fromkeys(group, max(counts)))
        return tuple(copied.items())

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of all links, copies expanded to ``planet 1`` ... ``planet n``, in the order of declaration."""
        declared = self.link_order or dict.fromkeys(
            [link for axis in self.axes for link in axis.links] + [link for group in self.rigid for link in group]
        )
        return tuple(name for link in declared for name in self.instances(link))

    def instances(self, link: str) -> tuple[str, ...]:
        """Return the names a declared link stands for: itself, or its numbered copies."""
        if link in self.copied:
            return tuple(f"{link} {number + 1}" for number in range(self.copied[link]))
        return (link,)

    def direction(self, axis_name: str) -> Vector:
        """Return the unit vector of an axis; x where nothing else is declared."""
        return self.directions()[axis_name]

    def directions(self) -> dict[str, Vector]:
        """Return the unit vector of every axis."""
        by_name = {axis.name: axis for axis in self.axes}
        found: dict[str, Vector] = {}
        for name in by_name:
            chain = [name]
            while (next_one := by_name[chain[-1]].parallel_to) is not None and chain[-1] not in found:
                if next_one in chain:
                    raise GearboxError(
                        f'axis "{name}": parallel_to leads round in a circle ({", ".join(sorted(chain))}); '
                        "give one of them a direction."
                    )
                chain.append(next_one)
            vector = found.get(chain[-1]) or _unit(by_name[chain[-1]].direction or X_AXIS)
            found |= dict.fromkeys(chain, vector)
        return found


def load_gearbox(name_or_path: str | Path) -> Gearbox:
    """Load a gearbox from a TOML file or, by its name, from the catalogue that ships with the package.

    Parameters
    ----------
    name_or_path : str or Path
        Path of a ``.toml`` file, or a catalogue name such as ``"two-stage"``.

    Raises
    ------
    GearboxError
        With one sentence that names the thing, its value, what was needed and what to do.
    """
    return Gearbox.from_toml(named_file(name_or_path, shipped=catalogue(), thing="gearbox", error=GearboxError))


def catalogue() -> dict[str, Path]:
    """Return the gearboxes that ship with the package: name -> file."""
    return shipped_files("hums")


def _rounded_multiples(gearbox: Gearbox) -> Iterator[str]:
    """Inner and outer multiple of a rolling bearing add up to its whole number of elements."""
    for bearing in gearbox.bearings:
        if bearing.multiples is None:
            continue
        inner, outer = bearing.multiples.inner, bearing.multiples.outer
        total = inner + outer
        elements = bearing.elements or round(total)
        if abs(total - elements) > _WHOLE:
            yield (
                f'bearing "{bearing.names[0]}": inner {inner:g} + outer {outer:g} = {total:g}, not a whole number of '
                f"elements ({elements}); the data sheet rounds, so expect its lines up to "
                f"{abs(total / elements - 1):.1%} from nominal"
            )


def _planets_that_do_not_fit(gearbox: Gearbox) -> Iterator[str]:
    """Look at every planet that meshes with one sun and one ring on the same carrier."""
    for axis in gearbox.axes:
        for link in axis.links if axis.copies is not None else ():
            meshes = [mesh for mesh in gearbox.meshes if link in [gear.link for gear in mesh.gears]]
            pairs = [sorted(mesh.gears, key=lambda gear: gear.link != link) for mesh in meshes if len(mesh.gears) > 1]
            suns = {other.teeth for own, other in pairs if other.teeth > 0 and other.link not in gearbox.copied}
            rings = {-other.teeth for own, other in pairs if other.teeth < 0}
            own = {own.teeth for own, _ in pairs}
            parallel = {_spins_like(gearbox, axis, other) for _, other in pairs} == {True}
            flat = parallel and all(mesh.kind is None for mesh in meshes)
            if len(pairs) == 2 and len(suns) == len(rings) == len(own) == 1 and flat and min(own) > 0:  # noqa: PLR2004
                angles = stations(axis.copies or 1, axis.spacing_deg)
                for sentence in assembly_warnings(suns.pop(), own.pop(), rings.pop(), angles):
                    yield f'planets "{link}": {sentence}'


def _forgotten_minus(gearbox: Gearbox) -> Iterator[str]:
    """Look at every planet that meshes by outer teeth with several gears of one axis."""
    still = {link for group in gearbox.rigid if gearbox.frame in group for link in group} | {gearbox.frame}
    for axis in gearbox.axes:
        for link in axis.links if axis.copies is not None or not still & set(axis.links) else ():
            if sum(link in other.links for other in gearbox.axes) > 1:
                continue  # what carries the axis, on which it turns besides
            outer = [
                ((own.teeth, mesh.module_mm), mate)
                for mesh in gearbox.meshes
                for own, mate in permutations(mesh.gears, 2)
                if own.link == link and mesh.kind is None and own.teeth > 0 and mate.teeth > 0
            ]
            # only axes about which the planets' carrier turns: the frame, and what is rigid with it, is on many
            for other in (other for other in gearbox.axes if _on(gearbox, other) & set(axis.links)):
                mates = [(own, mate) for own, mate in outer if mate.link in _on(gearbox, other)]
                sizes = {own for own, _ in mates}
                flat = gearbox.direction(axis.name) == gearbox.direction(other.name)
                if len(mates) > 1 and len(sizes) == 1 and flat and other != axis:
                    sentence = coaxial_warning((link, sizes.pop()[0]), {mate.link: mate.teeth for _, mate in mates})
                    yield from [sentence] if sentence else []


def _on(gearbox: Gearbox, axis: Axis) -> set[str]:
    """Return the links that turn about an axis, by themselves or because they are rigid with one that does."""
    return set(axis.links).union(*(group for group in gearbox.rigid if set(group) & set(axis.links)))


def _spins_like(gearbox: Gearbox, axis: Axis, gear: Gear) -> bool:
    """Whether a gear's axis is parallel to another one."""
    group = next((group for group in gearbox.rigid if gear.link in group), (gear.link,))
    directions = {gearbox.direction(other.name) for other in gearbox.axes if set(group) & set(other.links)}
    return gearbox.direction(axis.name) in directions


def _is_direction(vector: Vector) -> bool:
    return any(vector) and all(math.isfinite(x) for x in vector)


def _unit(vector: Vector) -> Vector:
    largest = max(abs(x) for x in vector)  # taken out first, so that no square overflows
    x, y, z = (x / largest for x in vector)
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length)
