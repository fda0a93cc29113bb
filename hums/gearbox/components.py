"""Parts of a declared gearbox: axes, gears, meshes and bearings, and checks of their numbers."""

import ast
import difflib
import inspect
import json
import math
import os
import re
import tomllib
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from importlib.resources import files
from itertools import pairwise
from math import radians, sin
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, ValidationError, model_validator
from pydantic_core import CoreSchema, ErrorDetails

from signals._validation import brief

# ---- The base of all hand-written files: strict, deeply frozen models, and validation errors in sentences ------------


M = TypeVar("M", bound="Declared")
N = TypeVar("N", bound=Hashable)
_DEEPEST = 50  # nested tables and lists: ours have 6


class Declared(BaseModel):
    """A table of a hand-written file: no coercion of types, no unknown keys, immutable."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, table: Any) -> Any:  # noqa: ANN401
        if not isinstance(table, dict):
            return table
        refuse_unknown_keys(table, {field.alias or name for name, field in cls.model_fields.items()}, cls.model_fields)
        return frozen(table)

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        schema = handler.resolve_ref_schema(found := handler(core))
        if cls.__doc__ is None:  # python -OO
            schema["description"] = ast.get_docstring(ast.parse(inspect.getsource(cls)).body[0])  # type: ignore[arg-type]
        return found

    def changed(self, **values: object) -> Self:
        """Return a validated copy with some fields replaced."""
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self).model_validate(fields | values)


def count(number: int, thing: str) -> str:
    """Return ``1 thing`` or ``n things``."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


def quoted(names: Iterable[str]) -> str:
    """Return the distinct names in quotation marks, separated by commas."""
    return ", ".join(f'"{name}"' for name in dict.fromkeys(names))


def first_of(names: Sequence[str], most: int) -> str:
    """Return the first names, separated by commas, and the number of others."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def united(groups: Iterable[Iterable[N]]) -> list[list[N]]:
    """Return the unions of groups that share members, in the order of their first members."""
    union_of: dict[N, list[N]] = {}
    for group in groups:
        members = list(dict.fromkeys(one for name in group for one in union_of.get(name, [name])))
        union_of |= dict.fromkeys(members, members)
    unions: dict[int, list[N]] = {}
    for name, members in union_of.items():
        unions.setdefault(id(members), []).append(name)
    return list(unions.values())


def closest(word: str, valid: set[str] | list[str]) -> str:
    """Return the end of an error message: the valid word closest to a misspelt one, else all valid words."""
    return _meant(word, valid) or f"; valid: {first_of(sorted(valid), 20)}"


def _meant(word: str, valid: Iterable[str]) -> str:
    return "".join(f'; did you mean "{match}"?' for match in difflib.get_close_matches(word, sorted(valid), n=1))


def refuse_unknown_keys(table: Mapping[str, Any], allowed: set[str], others: Iterable[str] = ()) -> None:
    """Refuse a key that is neither in `allowed`, which the message lists, nor in `others`."""
    for key in (key for key in table if key not in allowed.union(others)):
        meant, keys = _meant(str(key), allowed) or ".", ", ".join(sorted(allowed))
        raise ValueError(f'unknown key "{key}"{meant} Its value is {brief(table[key])}; allowed keys: {keys}')


def frozen(value: Any) -> Any:  # noqa: ANN401
    """Turn the lists of a parsed file into tuples, so that strict validation accepts them."""
    if isinstance(value, dict):
        return {key: frozen(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return tuple(frozen(item) for item in value)
    return value


def validated(model: type[M], table: dict[str, Any], *, where: str, error: type[ValueError]) -> M:
    """Validate a parsed table; on failure raise `error` with one clause for each invalid value."""
    try:
        return model.model_validate(table)
    except ValidationError as caught:
        raise error(f"{where}: {sentences(caught)}") from None


def sentences(caught: ValidationError) -> str:
    """Return the message of a validation error: one clause for each invalid value."""
    text = "; ".join(dict.fromkeys(_clause(details) for details in _causes(caught.errors())))
    longest_message = 800  # characters, below 1,000 with the name of a file
    if len(text) > longest_message:
        return f"{text[:longest_message]}... (cut)."
    return text if text.endswith("?") else f"{text}."


def named_file(name_or_path: str | Path, *, shipped: dict[str, Path], thing: str, error: type[ValueError]) -> Path:
    """Return the file for a catalogue name or a path; a catalogue name takes precedence over a file of that name."""
    name, path = str(name_or_path), Path(name_or_path)
    if name in shipped:
        return shipped[name]
    if path.suffix == ".toml" or path.exists():
        return path
    raise error(f'"{name}" is neither a .toml file nor a {thing} of the catalogue{closest(name, set(shipped))}')


def sibling_file(path: Path, name: str) -> str:
    """Return the path of a file named by another in the same folder; the name itself if there is no such file."""
    sibling = path.parent / name
    return str(sibling) if os.path.isfile(sibling) else name  # noqa: PTH113 - false also for invalid names


def shipped_files(package: str) -> dict[str, Path]:
    """Return the TOML files in the folder `catalogue` of a package, by stem."""
    folder = Path(str(files(package))) / "catalogue"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def read_toml(path: Path, *, error: type[ValueError]) -> dict[str, Any]:
    """Return the tables of a TOML file; raise `error` if it cannot be read."""
    first, *more = str(path).splitlines() or [""]
    if more:
        raise error(
            f'"{first} ..." is text, not a file name; write it to a file, or pass the tables of tomllib.loads to '
            "from_mapping."
        )
    if path.is_dir():
        raise error(f"{path} is a directory; name a .toml file in it.")
    most_bytes = 1_000_000  # parsed in half a second; the largest file of the catalogues has 4,000
    try:
        if not path.is_file() and path.exists():  # a device may have no end
            raise error(f"{path} is not a regular file; write its text to one.")
        if path.stat().st_size > most_bytes:
            raise error(f"{path} has {path.stat().st_size} bytes; a hand-written file has at most {most_bytes}.")
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise error(f"{path}: there is no such file; check the path.") from None
    except OSError as caught:
        raise error(f"{path} cannot be read ({caught.strerror}); check its permissions.") from None
    except UnicodeDecodeError as caught:
        raise error(f"{path} is not UTF-8 text (byte {caught.start}); save it as UTF-8.") from None
    if not text.strip():
        raise error(f"{path} is empty; declare its tables in TOML.")
    return parsed_toml(text, where=str(path), error=error)


def parsed_toml(text: str, *, where: str, error: type[ValueError]) -> dict[str, Any]:
    """Return the tables of a TOML text; raise `error` if it is not TOML, or too deep for a hand-written one."""
    try:
        tables = tomllib.loads(text)
        _refuse_deep(tables, where=where, error=error)
    except tomllib.TOMLDecodeError as caught:
        raise error(f"{where} is not valid TOML: {caught}.") from None
    except RecursionError:
        raise error(f"{where} nests tables or lists over {_DEEPEST} levels deep, more than any valid file.") from None
    except error:
        raise
    except ValueError as caught:  # Python's own bound on the digits of a number
        raise error(f"{where} has a value out of range: {str(caught)[:200]}.") from None
    return tables


def _refuse_deep(tables: dict[str, Any], *, where: str, error: type[ValueError]) -> None:
    """Refuse tables and lists nested too deeply for recursive readers."""
    level: list[Any] = [tables]
    for _ in range(_DEEPEST):
        inner = [item for one in level for item in (one.values() if isinstance(one, dict) else one)]
        level = [item for item in inner if isinstance(item, dict | list)]
        if not level:
            return
    raise error(f"{where} nests tables or lists over {_DEEPEST} levels deep, more than any valid file.")


def _causes(errors: list[ErrorDetails]) -> list[ErrorDetails]:
    """Leave out errors that only follow from a nested one: a list that is too short because its items are invalid."""
    places = [details["loc"] for details in errors]
    return [
        details
        for details in errors
        if details["type"] != "too_short"
        or not any(
            len(place) > len(details["loc"]) and place[: len(details["loc"])] == details["loc"] for place in places
        )
    ]


def _clause(details: ErrorDetails) -> str:
    """Return a clause of an error message on one field of a declaration, with the remedy."""
    # without pydantic's names of alternative types
    named = (part for part in details["loc"] if isinstance(part, int) or not re.match("constrained-|function-", part))
    place = ".".join(str(part + 1) if isinstance(part, int) else part[:120] for part in named)
    message = details["msg"].removeprefix("Value error, ").rstrip(".")
    if details["type"] == "missing":
        return f"{place} is missing; add it"
    if details["type"] == "value_error":
        return f"{place}: {message}" if place else message
    if details["type"] in ("model_type", "model_attributes_type"):
        return f"{place} = {brief(details['input'])}: give a table, {{ }} for its defaults"
    if details["type"] == "tuple_type":
        given = details["input"]
        # JSON and TOML write text, numbers and booleans alike
        listed = f", as in [{json.dumps(given)}]" if isinstance(given, str | int | float) else ""
        return f"{place} = {brief(given)}: give a list in brackets{listed}"
    return f"{place} = {brief(details['input'])}: {message[0].lower()}{message[1:]}"


# ---- Assembly conditions of a planetary stage: tooth numbers, spacing of the planets, clearance between neighbours ---


_TOLERANCE_DEG = 0.02  # drawings print angles with two decimals


def planet_angles(copies: int, spacing_deg: Sequence[float] | None) -> list[float]:
    """Return the angle of each planet about its carrier's axis, in degrees from the first one.

    `spacing_deg` holds either these angles, the first of which is 0, or the gaps from each planet to the next, which
    add up to 360.

    Raises
    ------
    ValueError
        If it holds neither.
    """
    if spacing_deg is None:
        return [360 * number / copies for number in range(copies)]
    given = list(spacing_deg)
    if len(given) != copies:
        raise ValueError(f"spacing_deg has {len(given)} angles for {copies} copies; give one for each")
    if given[0] == 0 and all(a < b for a, b in pairwise([*given, 360.0])):
        return given
    if min(given) > 0 and abs(sum(given) - 360) < copies * _TOLERANCE_DEG:
        return [sum(given[:number]) for number in range(copies)]
    raise ValueError(
        f"spacing_deg = {given}: give the angle of each copy, rising from 0 and below 360, or the gaps between "
        f"them, which add up to 360 (these add up to {sum(given):g})"
    )


def coaxial_warning(planet: tuple[str, int], mates: Mapping[str, int]) -> str | None:
    """Return a warning if a planet's coaxial mates have different numbers of external teeth, else None.

    With the same module their centre distances differ as ``mate + planet``. The larger mate is assumed to be a ring
    without its minus if its teeth are closer to those of a ring, ``smaller + 2 planet``, than to the smaller mate's.

    Parameters
    ----------
    planet : (str, int)
        Link and number of teeth.
    mates : mapping of str to int
        Number of teeth by link.
    """
    link, teeth = planet
    (small, fewest), *_, (large, most) = sorted(mates.items(), key=lambda mate: mate[1])
    if fewest == most:
        return None
    cure = "the meshes need profile shift"
    if abs(fewest + 2 * teeth - most) < most - fewest:
        cure = f"internal teeth are negative, did you mean {large} = -{most}?"
    return (
        f'planets "{link}": {small} and {large} are coaxial and both mesh with {link} by external teeth, but '
        f"{fewest} + {teeth} = {fewest + teeth} is not {most} + {teeth} = {most + teeth}: {cure}"
    )


def assembly_warnings(sun: int, planet: int, ring: int, angles_deg: Sequence[float]) -> Iterator[str]:
    """Yield a warning for each assembly condition that planets between a sun and a ring violate.

    With teeth cut at the same centre distance the ring needs ``sun + 2 planet`` teeth, or profile shift. A planet
    meshes with both gears only at multiples of ``360 / (sun + ring)`` degrees. Standard tip circles, a module outside
    the pitch circle, must not touch.
    """
    if ring != sun + 2 * planet:
        yield f"{sun} + 2 x {planet} = {sun + 2 * planet}, not the ring's {ring} teeth: the meshes need profile shift"
    copies, step = len(angles_deg), 360 / (sun + ring)
    teeth_per_copy = Fraction(sun + ring, copies)
    if teeth_per_copy.denominator != 1:
        yield (
            f"({sun} + {ring}) / {copies} = {float(teeth_per_copy):g} is not whole, so {copies} planets cannot be "
            f"evenly spaced; possible are multiples of {step:.4g} degrees"
        )
    even = all(abs(angle - 360 * number / copies) < _TOLERANCE_DEG for number, angle in enumerate(angles_deg))
    for number, angle in enumerate([] if even else angles_deg):
        off = abs(angle - round(angle / step) * step)
        if off > _TOLERANCE_DEG:
            yield (
                f"planet {number + 1} at {angle:.4g} degrees is {off:.3g} degrees from the nearest possible position, "
                f"a multiple of {step:.4g} degrees"
            )
    gaps = [(later - earlier) for earlier, later in pairwise([*angles_deg, 360.0 + angles_deg[0]])]
    centres = (sun + planet) * sin(radians(min(gaps) / 2)) if copies > 1 else float("inf")
    if planet + 2 >= centres:
        yield (
            f"neighbouring planets {min(gaps):.4g} degrees apart touch: tip circles of {planet} + 2 modules, centres "
            f"{centres:.4g} modules apart"
        )


# ---- Components ------------------------------------------------------------------------------------------------------


Vector = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=200)]
MOST_PARTS = 1000  # axes, meshes, bearings, or names of one of them: ten times as many as in any gearbox
X_AXIS: Vector = (1.0, 0.0, 0.0)


class Axis(Declared):
    """An axis (level in the papers): coaxial links, and the direction of their common line.

    ``through`` is a point on the line in mm; ``copies`` repeats the axis around its carrier, at ``spacing_deg``.
    """

    name: Name
    links: Annotated[tuple[Name, ...], Field(min_length=2, max_length=MOST_PARTS)]
    direction: Vector | None = None
    parallel_to: Name | None = None
    through: Vector | None = None
    copies: Annotated[int, Field(ge=2, le=100)] | None = None  # a dozen is many
    spacing_deg: tuple[float, ...] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(set(self.links)) != len(self.links):
            raise ValueError("a link is listed twice; list each link of the axis once")
        if self.direction is not None and self.parallel_to is not None:
            raise ValueError("direction and parallel_to are both given; keep one")
        if self.direction is not None and not (any(self.direction) and all(map(math.isfinite, self.direction))):
            raise ValueError(f"direction = {list(self.direction)} is not a direction; give a finite, non-zero vector")
        if self.spacing_deg is not None:
            if self.copies is None:
                raise ValueError("spacing_deg is given without copies; give the number of copies")
            planet_angles(self.copies, self.spacing_deg)
        return self

    def instances(self) -> tuple[str, ...]:
        """Return the names of the copies of this axis, ``planet 1`` and so on; its own name without copies."""
        return tuple(f"{self.name} {number + 1}" for number in range(self.copies or 0)) or (self.name,)


class Gear(Declared):
    """One gear of a mesh: the link that carries its teeth, and their signed number."""

    link: Name
    teeth: Annotated[int, Field(ge=-100_000, le=100_000)]  # the largest gears have a few thousand


class Mesh(Declared):
    """Two gears in mesh, or one gear whose mate is unknown.

    ``position_mm`` is the position of mid-face along the first gear's axis, from that axis' ``through``; ``hand`` is
    the hand of the first gear's helix.
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
        refuse_unknown_keys(table, {*cls.model_fields, "teeth"} - {"gears"})
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
                "(the link relative to which the contact point is at rest)"
            )
        if self.hand is not None and (self.helix_angle_deg is None or self.helix_angle_deg < 0):
            given = "no helix_angle_deg" if self.helix_angle_deg is None else f"{self.helix_angle_deg:g} degrees"
            raise ValueError(
                f'mesh "{self.name}": hand = "{self.hand}" is given with {given}; give helix_angle_deg without a sign'
            )
        return self


class Multiples(Declared):
    """Defect frequencies of a bearing from its data sheet, per relative revolution of its rings."""

    inner: Positive
    outer: Positive
    cage: Positive
    element_spin: Positive | None = None
    element_defect: Positive | None = None

    @model_validator(mode="before")
    @classmethod
    def _refuse_ball(cls, table: Any) -> Any:  # noqa: ANN401
        data_sheet = {"bpfi": "inner", "bpfo": "outer", "ftf": "cage"}
        if isinstance(table, dict):
            for word in table:
                if str(word).lower() in ("ball", "roller", "element", "bsf"):
                    raise ValueError(
                        f'"{word}" is ambiguous; write element_spin (BSF, rotation of the element) or element_defect '
                        "(twice that, as the defect strikes both races)"
                    )
                if key := data_sheet.get(str(word).lower()):
                    raise ValueError(f'"{word}" is called {key} here; write {key} = {table[word]}')
        return table

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.element_spin is None) == (self.element_defect is None):
            raise ValueError("give exactly one of element_spin and element_defect")
        if round(self.inner + self.outer) < 2:  # noqa: PLR2004
            raise ValueError(
                f"inner {self.inner:g} + outer {self.outer:g} must be the number of elements, at least 2; "
                "give both per relative revolution of the rings"
            )
        if self.inner <= self.outer:
            raise ValueError(
                f"inner = {self.inner:g} is not above outer = {self.outer:g}, but the inner race is struck more often; "
                "check whether the two are interchanged"
            )
        self._check_rolling()
        return self

    def _check_rolling(self) -> None:
        """Refuse a cage or spin frequency that is incompatible with elements rolling at `inner` and `outer`.

        With Z elements, ``g = (inner - outer) / Z`` is the projected diameter ratio ``d/D cos a``; the cage rotates at
        ``(1 - g) / 2`` and an element at ``cos a (1 - g^2) / (2 g)``, at most that for ``a = 0``. Its diameter is at
        most ``D sin(pi / Z)``, where neighbours touch, so it rotates at ``(1 - g^2) / (2 sin(pi / Z))`` or more.
        """
        count, ratio = self.inner + self.outer, (self.inner - self.outer) / (self.inner + self.outer)
        cage = (1 - ratio) / 2
        cage_rounding = 0.05  # of the cage: some data sheets print one decimal
        if abs(self.cage - cage) > cage_rounding:
            held = " (that relative to the inner ring)" if abs(1 - self.cage - cage) < cage_rounding else ""
            raise ValueError(
                f"cage = {self.cage:g}{held} contradicts inner {self.inner:g} and outer {self.outer:g}, for which the "
                f"cage rotates at {cage:.3g} with the outer ring at rest; correct one of the three"
            )
        key, spin = ("element_spin", self.element_spin) if self.element_spin else ("element_defect", self.defect / 2)
        least = (1 - ratio**2) / (2 * sin(math.pi / max(2.0, count)))
        most = (1 - ratio**2) / (2 * ratio)
        # a spin rests on the small difference inner - outer; a factor of two is no rounding
        spin_rounding = 1.25
        if spin is not None and not least / spin_rounding <= spin <= most * spin_rounding:
            times = 2 if key == "element_defect" else 1
            hint = (
                "; if it is the defect on both races, twice the spin, call it element_defect"
                if times == 1 and least <= spin / 2 <= most * spin_rounding
                else "; if it is the rotation of the element, call it element_spin"
                if times == 2 and least <= 2 * spin <= most * spin_rounding  # noqa: PLR2004
                else ""
            )
            raise ValueError(
                f"{key} = {times * spin:g} contradicts inner {self.inner:g} and outer {self.outer:g}, for which "
                f"elements that fit side by side have {times * least:.3g} to {times * most:.3g}{hint}"
            )

    @property
    def defect(self) -> float:
        """Impacts of a rolling-element defect on both races per relative revolution of the rings, twice the spin."""
        return self.element_defect if self.element_defect is not None else 2 * (self.element_spin or 0.0)


class Bearing(Declared):
    """A rolling bearing between two links, by geometry, data-sheet multiples, or name in the catalogue.

    ``bearing`` is a name printed by ``hums bearings``, which gives the geometry and ``order_tolerance``, the relative
    deviation that the true defect orders may have. ``position_mm`` is the position of each bearing along the shaft's
    axis, from the axis' ``through``, in the order of ``names``; ``takes_axial`` lists the names that locate the shaft
    axially.
    """

    names: Annotated[tuple[Name, ...], Field(min_length=1, max_length=MOST_PARTS)]
    inner_ring: Name
    outer_ring: Name
    bearing: Name | None = None
    elements: Annotated[int, Field(ge=2)] | None = None
    element_diameter_mm: Positive | None = None
    pitch_diameter_mm: Positive | None = None
    contact_angle_deg: Annotated[float, Field(ge=0, lt=90)] = 0.0
    multiples: Multiples | None = None
    order_tolerance: Annotated[float, Field(ge=0, lt=0.5)] = 0.0
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
                "give elements, element_diameter_mm and pitch_diameter_mm, bearing = a name from `hums bearings`, or "
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
                f"position_mm = {list(self.position_mm)} does not match the names {', '.join(self.names)}; "
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
        rounding = 0.05  # of the number of elements: above what a data sheet rounds
        if self.multiples is not None:
            total = self.multiples.inner + self.multiples.outer
            if abs(total / self.elements - 1) > rounding:
                raise ValueError(
                    f"multiples inner {self.multiples.inner:g} + outer {self.multiples.outer:g} = {total:g} is not "
                    f"the number of elements, {self.elements}; correct one of them, or omit elements"
                )
        elif self.element_diameter_mm is not None and self.pitch_diameter_mm is not None:
            circumference_mm = math.pi * self.pitch_diameter_mm
            if self.elements * self.element_diameter_mm > circumference_mm:
                raise ValueError(
                    f"{self.elements} elements of element_diameter_mm = {self.element_diameter_mm:g} do not fit on the "
                    f"pitch circle of circumference {circumference_mm:.4g} mm; correct elements or a diameter"
                )


def unit_vector(vector: Vector) -> Vector:
    """Return the vector divided by its length."""
    largest = max(abs(x) for x in vector)  # divided out first, so that no square overflows
    x, y, z = (x / largest for x in vector)
    length = math.hypot(x, y, z)
    return (x / length, y / length, z / length)
