"""The base of all hand-written files: strict, deeply frozen models, and validation errors in sentences."""

import difflib
import json
import tomllib
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any, Self, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import ErrorDetails

M = TypeVar("M", bound="Declared")


class Declared(BaseModel):
    """A table of a hand-written file: no coercion of types, no unknown keys, immutable."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, populate_by_name=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, table: Any) -> Any:  # noqa: ANN401
        if not isinstance(table, dict):
            return table
        valid = {field.alias or name for name, field in cls.model_fields.items()} | set(cls.model_fields)
        for key in table:
            if key not in valid:
                raise ValueError(f'unknown key "{key}"{closest(str(key), valid)}')
        return frozen(table)

    def changed(self, **values: object) -> Self:
        """Return a validated copy with some fields replaced."""
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        return type(self).model_validate(fields | values)


def count(number: int, thing: str) -> str:
    """Return ``1 thing`` or ``n things``."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


def quoted(names: Iterable[str]) -> str:
    """Return the names in quotation marks, each once, with commas between them."""
    return ", ".join(f'"{name}"' for name in dict.fromkeys(names))


def closest(word: str, valid: set[str] | list[str]) -> str:
    """Return the end of an error: the valid word closest to a misspelt one, else all valid words."""
    matches = difflib.get_close_matches(word, sorted(valid), n=1)
    if matches:
        return f'; did you mean "{matches[0]}"?'
    return f"; valid: {', '.join(sorted(valid))}"


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
    return text if text.endswith("?") else f"{text}."


def named_file(name_or_path: str | Path, *, shipped: dict[str, Path], thing: str, error: type[ValueError]) -> Path:
    """Return the file of a catalogue name or a path; a catalogue name has precedence over a file of that name."""
    name, path = str(name_or_path), Path(name_or_path)
    if name in shipped:
        return shipped[name]
    if path.suffix == ".toml" or path.exists():
        return path
    raise error(f'"{name}" is neither a .toml file nor a {thing} of the catalogue{closest(name, set(shipped))}')


def shipped_files(package: str) -> dict[str, Path]:
    """Return the TOML files in the folder `catalogue` of a package, by stem."""
    folder = Path(str(files(package))) / "catalogue"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def read_toml(path: Path, *, error: type[ValueError]) -> dict[str, Any]:
    """Return the tables of a TOML file; raise `error` where it cannot be read."""
    if path.is_dir():
        raise error(f"{path} is a directory; name a .toml file in it.")
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise error(f"{path}: there is no such file; check the path.") from None
    except UnicodeDecodeError as caught:
        raise error(f"{path} is not UTF-8 text (byte {caught.start}); save it as UTF-8.") from None
    if not text.strip():
        raise error(f"{path} is empty; it should declare its tables in TOML.")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as caught:
        raise error(f"{path} is not valid TOML: {caught}.") from None


def _causes(errors: list[ErrorDetails]) -> list[ErrorDetails]:
    """Leave out the errors that only follow from a nested one: a list too short for lack of its invalid items."""
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
    place = ".".join(str(part + 1) if isinstance(part, int) else part for part in details["loc"])
    message = details["msg"].removeprefix("Value error, ").rstrip(".")
    if details["type"] == "missing":
        return f"{place} is missing; add it"
    if details["type"] == "value_error":
        return f"{place}: {message}" if place else message
    if details["type"] == "tuple_type":
        given = details["input"]
        # JSON and TOML write text, numbers and booleans alike
        listed = f", as in [{json.dumps(given)}]" if isinstance(given, str | int | float) else ""
        return f"{place} = {given!r}: give a list in brackets{listed}"
    return f"{place} = {details['input']!r}: {message[0].lower()}{message[1:]}"
