"""The declaration of a gearbox, read from a TOML file: links, axes, meshes and bearings.

Numbers of teeth are signed so that every mesh obeys ``Z_i w_i + Z_j w_j = 0``, with speeds along the declared axes and
relative to the carrier. They are negative for an internal gear in a mesh with parallel axes, and for a gear on the
negative side of the apex in a bevel mesh.
"""

import tomllib
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from importlib.resources import files
from itertools import permutations
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from hums.gearbox.bearing_catalogue import CatalogueBearing, bearing_catalogue, bearings_named, typical_bearing
from hums.gearbox.components import (
    MOST_PARTS,
    X_AXIS,
    Axis,
    Bearing,
    Declared,
    Gear,
    Mesh,
    Name,
    Vector,
    assembly_warnings,
    closest,
    coaxial_warning,
    named_file,
    planet_angles,
    quoted,
    read_toml,
    shipped_files,
    unit_vector,
    validated,
)
from signals._validation import SentenceError, checked


class GearboxError(SentenceError):
    """A gearbox that cannot be read, or that is not a mechanism.

    Examples
    --------
    >>> import hums
    >>> try:
    ...     hums.load_gearbox("two-stag")
    ... except hums.GearboxError as error:
    ...     print(error)
    "two-stag" is neither a .toml file nor a gearbox of the catalogue; did you mean "two-stage"?
    """


class GearboxWarning(UserWarning):
    """A gearbox that can be solved, but whose numbers are contradictory or unusual.

    Examples
    --------
    >>> import warnings
    >>> import hums
    >>> axes = {"main": ["box", "sun", "ring", "arm"], "planet": {"links": ["arm", "planet"], "copies": 3}}
    >>> meshes = [{"teeth": {"sun": 20, "planet": 31}}, {"teeth": {"planet": 31, "ring": -80}}]
    >>> table = {"name": "planetary", "frame": "box", "axes": axes, "mesh": meshes}
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     gearbox = hums.Gearbox.from_mapping(table)
    >>> print(caught[0].message)
    planets "planet": 20 + 2 x 31 = 82, not the ring's 80 teeth: the meshes need profile shift.
    """


class Gearbox(Declared):
    """A gearbox as declared: links on axes, meshes and bearings.

    Built by `load_gearbox`, `Gearbox.from_toml` or `Gearbox.from_mapping`.

    Attributes
    ----------
    name : str
        Name of the gearbox.
    frame : str
        Link at rest.
    reference : str or None
        Reference shaft of orders.
    rigid : tuple of tuple of str
        Groups of rigidly connected links.
    link_order : tuple of str or None
        Order of the links in results. Default: order of declaration.
    axes : tuple of Axis
        Lines about which links rotate.
    meshes : tuple of Mesh
        Pairs of gears in mesh, TOML tables ``[[mesh]]``.
    bearings : tuple of Bearing
        Rolling bearings, TOML tables ``[[bearing]]``.

    Examples
    --------
    >>> import hums
    >>> gearbox = hums.load_gearbox("two-stage")
    >>> gearbox.links
    ('housing', 'input', 'intermediate', 'output', 'pinion')
    >>> gearbox.meshes[0].gears[1].teeth
    67
    """

    name: Name
    frame: Name
    reference: Name | None = None
    rigid: tuple[Annotated[tuple[Name, ...], Field(min_length=2)], ...] = ()
    link_order: tuple[Name, ...] | None = None
    axes: Annotated[tuple[Axis, ...], Field(min_length=1, max_length=MOST_PARTS)]
    meshes: tuple[Mesh, ...] = Field(default=(), alias="mesh", max_length=MOST_PARTS)
    bearings: tuple[Bearing, ...] = Field(default=(), alias="bearing", max_length=MOST_PARTS)

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

    @model_validator(mode="before")
    @classmethod
    def _named_bearings(cls, table: Any) -> Any:  # noqa: ANN401
        """Read ``bearing = "SKF 6205-2RS JEM"`` of a bearing, whose geometry is in the catalogue."""
        given = table.get("bearing") if isinstance(table, dict) else None
        if not isinstance(given, list | tuple):
            return table
        named = (isinstance(row, dict) and isinstance(row.get("bearing"), str) for row in given)
        rows = (_catalogue_geometry(row) | row if by_name else row for row, by_name in zip(given, named, strict=True))
        return table | {"bearing": tuple(rows)}

    @model_validator(mode="after")
    def _check(self) -> Self:
        known = {link for axis in self.axes for link in axis.links} | {x for group in self.rigid for x in group}
        for link, user in self._references_to_links():
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
            twice = _twice(names)
            if twice:
                raise ValueError(f'two items of kind {kind} are named "{min(twice)}"; distinguish them by name = "..."')
        self._check_copies()
        if self.link_order is not None and sorted(self.link_order) != sorted(known):
            wrong = sorted(set(self.link_order) ^ known)
            raise ValueError(f"link_order must list every link once; look at {', '.join(wrong) or 'the repeated ones'}")
        axis_names = {axis.name for axis in self.axes}
        for axis in self.axes:
            if axis.parallel_to is not None and axis.parallel_to not in axis_names - {axis.name}:
                raise ValueError(f'axis "{axis.name}": parallel_to = "{axis.parallel_to}" is not another axis')
        self.directions()  # refuses a cycle of parallel_to
        return self

    def _check_copies(self) -> None:
        copied = self.copied
        for key, link in (("frame", self.frame), ("reference", self.reference)):
            if link in copied:
                raise ValueError(f'{key} = "{link}" stands for {copied[link]} copies; name a link without copies')
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
            twice = _twice(names)
            if twice:
                raise ValueError(f'the {kind} "{min(twice)}" has the name of a numbered copy; rename it')

    def _references_to_links(self) -> list[tuple[str, str]]:
        """Return every use of a link outside the axes: its name and the part of the file that uses it."""
        uses = [(self.frame, "frame")]
        if self.reference is not None:
            uses.append((self.reference, "reference"))
        for mesh in self.meshes:
            uses += [(gear.link, f'mesh "{mesh.name}"') for gear in mesh.gears]
            uses += [(mesh.carrier, f'mesh "{mesh.name}"')] if mesh.carrier else []
        for bearing in self.bearings:
            uses += [(ring, f'bearing "{bearing.names[0]}"') for ring in (bearing.inner_ring, bearing.outer_ring)]
        return uses

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any], *, where: str = "gearbox") -> "Gearbox":
        """Build a gearbox from the tables of a gearbox file; emit a `GearboxWarning` if its numbers are contradictory.

        Parameters
        ----------
        table : mapping
            Keys and values as in the TOML file.
        where : str
            Name of the file or gearbox in error messages.

        Returns
        -------
        Gearbox

        Raises
        ------
        GearboxError
            If a key, a value or a combination of values is invalid.

        Examples
        --------
        >>> from hums import Gearbox
        >>> axes = {"one": ["housing", "pinion"], "two": ["housing", "wheel"]}
        >>> meshes = [{"teeth": {"pinion": 20, "wheel": 41}}]
        >>> table = {"name": "pair", "frame": "housing", "reference": "pinion", "axes": axes, "mesh": meshes}
        >>> Gearbox.from_mapping(table).meshes[0].name
        'pinion-wheel'
        """
        gearbox = validated(cls, dict(table), where=where, error=GearboxError)
        for sentence in (
            *_multiples_warnings(gearbox),
            *_designation_warnings(gearbox),
            *_planet_warnings(gearbox),
            *_sign_warnings(gearbox),
        ):
            warnings.warn(sentence if sentence.endswith("?") else f"{sentence}.", GearboxWarning, stacklevel=3)
        return gearbox

    @classmethod
    def from_toml(cls, path: str | Path) -> "Gearbox":
        """Read a gearbox from a TOML file.

        Parameters
        ----------
        path : str or Path
            A ``.toml`` file, whose stem is the default name of the gearbox.

        Returns
        -------
        Gearbox

        Raises
        ------
        GearboxError
            If the file is missing or not TOML, or the gearbox is invalid.

        Examples
        --------
        >>> import hums, tempfile, pathlib
        >>> gearbox = hums.load_gearbox("two-stage")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     file = pathlib.Path(folder) / "copy.toml"
        ...     _ = file.write_text(gearbox.to_toml(), encoding="utf-8")
        ...     hums.Gearbox.from_toml(file) == gearbox
        True
        """
        path = Path(path)
        return cls.from_mapping({"name": path.stem} | read_toml(path, error=GearboxError), where=str(path))

    def to_toml(self) -> str:
        """Return the text of a TOML file that `from_toml` reads back to an equal gearbox."""
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
        """Number of copies by link, for links such as planets that are only on axes with ``copies``.

        A link on no axis has as many copies as the links it is rigidly connected to.
        """
        return dict(self._copied)

    @cached_property
    def _copied(self) -> tuple[tuple[str, int], ...]:
        """Return the links with several copies, such as planets, and their number of copies."""
        single = {link for axis in self.axes if axis.copies is None for link in axis.links}
        copied = {
            link: axis.copies
            for axis in self.axes
            if axis.copies is not None
            for link in axis.links
            if link not in single
        }
        for group in self.rigid * len(self.rigid):  # so that counts propagate along a chain of groups
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
        """Return the names of the copies of a declared link, ``planet 1`` and so on; its own name without copies."""
        if link in self.copied:
            return tuple(f"{link} {number + 1}" for number in range(self.copied[link]))
        return (link,)

    def ring_links(self, bearing: Bearing) -> tuple[str, ...]:
        """Return the links of the inner ring of a bearing and those of the outer one, copies expanded."""
        return (*self.instances(bearing.inner_ring), *self.instances(bearing.outer_ring))

    @property
    def copy_links(self) -> dict[str, str]:
        """Declared link of each copy, ``planet`` for ``planet 1``, without links that have no copies."""
        return {copy: link for link in self.copied for copy in self.instances(link)}

    def direction(self, axis_name: str) -> Vector:
        """Return the unit vector of an axis, (3,); x by default."""
        return self.directions()[axis_name]

    def directions(self) -> dict[str, Vector]:
        """Return the unit vector of every axis, (3,), by name."""
        by_name = {axis.name: axis for axis in self.axes}
        found: dict[str, Vector] = {}
        for name in by_name:
            chain = [name]
            while (parallel := by_name[chain[-1]].parallel_to) is not None and chain[-1] not in found:
                if parallel in chain:
                    raise GearboxError(
                        f'axis "{name}": parallel_to is circular ({", ".join(sorted(chain))}); '
                        "give one of them a direction."
                    )
                chain.append(parallel)
            vector = found.get(chain[-1]) or unit_vector(by_name[chain[-1]].direction or X_AXIS)
            found |= dict.fromkeys(chain, vector)
        return found


def _twice(names: Iterable[str]) -> set[str]:
    return {name for name, times in Counter(names).items() if times > 1}


@checked
def load_gearbox(name_or_path: str | Path) -> Gearbox:
    """Load a gearbox from a TOML file, or by name from the catalogue of the package.

    Parameters
    ----------
    name_or_path : str or Path
        Path of a ``.toml`` file, or a catalogue name such as ``"two-stage"``.

    Returns
    -------
    Gearbox

    Raises
    ------
    GearboxError
        If there is no such file or name, or the gearbox is invalid.

    Examples
    --------
    >>> import hums
    >>> gearbox = hums.load_gearbox("planetary-27-36-99")
    >>> gearbox.reference, gearbox.copied
    ('sun', {'planet': 3})
    """
    return Gearbox.from_toml(named_file(name_or_path, shipped=catalogue(), thing="gearbox", error=GearboxError))


def catalogue() -> dict[str, Path]:
    """Return the files of the gearboxes in the catalogue, by name."""
    return shipped_files("hums")


def _multiples_warnings(gearbox: Gearbox) -> Iterator[str]:
    """Yield a warning for each bearing whose multiples do not add up to its number of elements."""
    tolerance = 0.0101  # data sheets print two decimals: inner + outer is whole within the rounding of both
    for bearing in gearbox.bearings:
        if bearing.multiples is None:
            continue
        inner, outer = bearing.multiples.inner, bearing.multiples.outer
        total = inner + outer
        elements = bearing.elements or round(total)
        if abs(total - elements) > tolerance:
            yield (
                f'bearing "{bearing.names[0]}": inner {inner:g} + outer {outer:g} = {total:g}, not a whole number of '
                f"elements ({elements}); the data sheet rounds, so expect its lines up to "
                f"{abs(total / elements - 1):.1%} from nominal"
            )


def _catalogue_bearing(name: str) -> CatalogueBearing:
    """Return the bearing of a name or designation; ValueError if there is none, or several with different elements."""
    found = bearings_named(name)
    if not found:
        known = {known for row in bearing_catalogue() for known in (row.name, *row.designations)}
        raise ValueError(
            f'bearing = "{name}" is not in the catalogue{closest(name, known)}; '
            "or give elements, element_diameter_mm and pitch_diameter_mm, or the frequencies of its data sheet: "
            "multiples = { inner = BPFI, outer = BPFO, element_spin = BSF, cage = FTF }"
        )
    if len({row.elements for row in found}) > 1:
        raise ValueError(
            f'bearing = "{name}" has several geometries; name one of {quoted(row.name for row in found)}, '
            "or give elements, element_diameter_mm and pitch_diameter_mm"
        )
    return typical_bearing(name, found)


def _catalogue_geometry(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the geometry of a bearing given by name, with which further declarations must agree."""
    found = _catalogue_bearing(table["bearing"])
    keys = ("elements", "element_diameter_mm", "pitch_diameter_mm", "contact_angle_deg")  # of a bearing
    geometry = {key: getattr(found, key) for key in keys}
    for key, value in geometry.items():
        if table.get(key) not in (None, value):
            raise ValueError(f"{key} = {table[key]} contradicts {found.name}, which has {value:g}; omit one of them")
    return {"order_tolerance": found.spread} | geometry


def _designation_warnings(gearbox: Gearbox) -> Iterator[str]:
    """Yield a warning for each bearing whose geometry is typical, and not published by its maker."""
    for bearing in gearbox.bearings:
        if bearing.bearing and bearing.order_tolerance:
            row = _catalogue_bearing(bearing.bearing)
            yield (
                f'bearing "{bearing.names[0]}", {row.name}: {row.source} Its orders may be off by up to '
                f"{bearing.order_tolerance:.1%}; multiples = {{ ... }} from its data sheet are more accurate"
            )


def _planet_warnings(gearbox: Gearbox) -> Iterator[str]:
    """Yield a warning for each set of planets that does not fit between its sun and ring.

    A ring that is no larger than the sun has no room for planets with any profile shift.
    """
    for axis in gearbox.axes:
        for link in axis.links if axis.copies is not None else ():
            meshes = [mesh for mesh in gearbox.meshes if link in [gear.link for gear in mesh.gears]]
            pairs = [sorted(mesh.gears, key=lambda gear: gear.link != link) for mesh in meshes if len(mesh.gears) > 1]
            suns = {other.teeth for own, other in pairs if other.teeth > 0 and other.link not in gearbox.copied}
            rings = {-other.teeth for own, other in pairs if other.teeth < 0}
            own = {own.teeth for own, _ in pairs}
            spur = all(_is_parallel(gearbox, axis, other) for _, other in pairs) and all(
                mesh.kind is None for mesh in meshes
            )
            if len(pairs) == 2 and len(suns) == len(rings) == len(own) == 1 and spur and min(own) > 0:  # noqa: PLR2004
                angles_deg = planet_angles(axis.copies or 1, axis.spacing_deg)
                sun, planet, ring = suns.pop(), own.pop(), rings.pop()
                if ring <= sun:
                    raise GearboxError(
                        f'{gearbox.name}: planets "{link}": there is no room for planets between a sun of {sun} and a '
                        f"ring of {ring} teeth; correct the numbers of teeth, or the minus of the internal gear."
                    )
                for sentence in assembly_warnings(sun, planet, ring, angles_deg):
                    yield f'planets "{link}": {sentence}'


def _sign_warnings(gearbox: Gearbox) -> Iterator[str]:
    """Yield a warning for each planet whose coaxial mates all have external teeth, but in different numbers.

    The largest of them may be a ring gear whose minus was forgotten.
    """
    at_rest = {link for group in gearbox.rigid if gearbox.frame in group for link in group} | {gearbox.frame}
    for axis in gearbox.axes:
        for link in axis.links if axis.copies is not None or not at_rest & set(axis.links) else ():
            if sum(link in other.links for other in gearbox.axes) > 1:
                continue  # the carrier, which rotates about its own axis
            external = [
                ((own.teeth, mesh.module_mm), mate)
                for mesh in gearbox.meshes
                for own, mate in permutations(mesh.gears, 2)
                if own.link == link and mesh.kind is None and own.teeth > 0 and mate.teeth > 0
            ]
            # only axes about which the planets' carrier rotates: the frame and its rigid links are on many
            for other in (other for other in gearbox.axes if _links_on(gearbox, other) & set(axis.links)):
                mates = [(own, mate) for own, mate in external if mate.link in _links_on(gearbox, other)]
                sizes = {own for own, _ in mates}
                parallel = gearbox.direction(axis.name) == gearbox.direction(other.name)
                if len(mates) > 1 and len(sizes) == 1 and parallel and other != axis:
                    sentence = coaxial_warning((link, sizes.pop()[0]), {mate.link: mate.teeth for _, mate in mates})
                    yield from [sentence] if sentence else []


def _links_on(gearbox: Gearbox, axis: Axis) -> set[str]:
    """Return the links on an axis and those rigidly connected to one of them."""
    return set(axis.links).union(*(group for group in gearbox.rigid if set(group) & set(axis.links)))


def _is_parallel(gearbox: Gearbox, axis: Axis, gear: Gear) -> bool:
    group = next((group for group in gearbox.rigid if gear.link in group), (gear.link,))
    directions = {gearbox.direction(other.name) for other in gearbox.axes if set(group) & set(other.links)}
    return gearbox.direction(axis.name) in directions


# ---- JSON schema of gearbox files, for validation in editors -----------------------------------------------------


def gearbox_schema() -> dict[str, Any]:
    """Return the JSON schema (2020-12) of a hand-written gearbox file."""
    schema: dict[str, Any] = Gearbox.model_json_schema(by_alias=True)
    parts = schema["$defs"]
    schema["description"] = "A gearbox as declared: links on axes, meshes and bearings."
    axis, mesh, bearing = parts["Axis"], parts["Mesh"], parts["Bearing"]
    # in a file an axis is a table under its name or, in short form, the list of its links
    del axis["properties"]["name"]
    axis["required"].remove("name")
    links = axis["properties"]["links"]
    schema["properties"]["axes"] = {
        "type": "object",
        "minProperties": 1,
        "additionalProperties": {"anyOf": [links, {"$ref": "#/$defs/Axis"}]},
    }
    # in a file the gears of a mesh are in the table `teeth`, and its name defaults to theirs
    del mesh["properties"]["gears"], parts["Gear"]
    mesh["properties"]["teeth"] = {
        "type": "object",
        "minProperties": 1,
        "maxProperties": 2,
        "additionalProperties": {"type": "integer", "not": {"const": 0}},
    }
    mesh["required"] = ["teeth"]
    bearing["properties"]["name"] = {"type": "string", "minLength": 1}
    bearing["required"].remove("names")
    bearing["oneOf"] = [{"required": ["names"]}, {"required": ["name"]}]
    # the name defaults to that of the file
    schema["required"].remove("name")
    described = (files("hums.gearbox") / "field_descriptions.toml").read_text(encoding="utf-8")
    for table, fields in tomllib.loads(described).items():
        properties = (schema if table == "Gearbox" else parts[table])["properties"]
        for field, description in fields.items():
            properties[field]["description"] = description
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    return schema
