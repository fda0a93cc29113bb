"""The declared mechanism: links, axes, meshes and bearings of a gearbox, read from a TOML file.

Teeth are signed so that every mesh obeys ``Z_i w_i + Z_j w_j = 0``, speeds along the declared axes and
relative to the carrier. A minus marks an internal gear on a parallel mesh, and a gear on the negative
side of the apex on a bevel mesh.
"""

import warnings
from collections.abc import Iterator, Mapping
from functools import cached_property
from itertools import permutations
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from hums._planets import assembly_warnings, coaxial_warning, stations
from hums.components import X_AXIS, Axis, Bearing, Gear, Mesh, Multiples, Name, Positive, Vector, unit_vector
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

_WHOLE = 0.0101  # a data sheet prints two decimals: inner + outer should be whole within the rounding of both


class GearboxError(ValueError):
    """A gearbox that cannot be read, or that is not a mechanism."""


class GearboxWarning(UserWarning):
    """A gearbox that can be solved but whose numbers deserve a second look."""


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
            vector = found.get(chain[-1]) or unit_vector(by_name[chain[-1]].direction or X_AXIS)
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
