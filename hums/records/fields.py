"""Validation of the fields of a record: units, names, numbers, times."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np

from signals._validation import SentenceError, brief, is_float, plain_text, real_array

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

SCHEMA = "hums-record/2"

UNITS: Mapping[str, tuple[str, ...]] = {
    "g": ("g0", "g_n", "gn"),
    "m s-2": ("m/s^2", "m/s2", "m/s²", "m/s**2", "m s^-2", "m s**-2", "m·s-2"),
    "m s-1": ("m/s", "m s^-1", "m s**-1", "m·s-1"),
    "mm s-1": ("mm/s", "mm s^-1", "mm s**-1", "mm·s-1"),
    "m": (),
    "mm": (),
    "µm": ("um", "\N{GREEK SMALL LETTER MU}m"),
    "V": ("volt", "volts", "Volt", "Volts"),
    "mV": (),
    "Pa": (),
    "N": (),
    "A": (),
    "1": (),
}
"""Units of channels, each with the other spellings that are accepted for it."""

CANONICAL_UNITS = {spelling: units for units, aliases in UNITS.items() for spelling in (units, *aliases)}

ANGLE_REMEDY = (
    "Give exactly one of: pulse times, angle=PulseTimes(times_s=..., shaft=..., pulses_per_rev=...), on the "
    "command line --tach-times NAME; a tachometer waveform, angle=TachometerWaveform(values=..., shaft=..., "
    "pulses_per_rev=...), --tach-waveform NAME; a declared constant speed, angle=NominalSpeed(rpm=..., "
    "shaft=...), --shaft-rpm RPM. If there is none, declare it, angle=UnknownAngle(), --no-tachometer: the speed is "
    "then estimated from the vibration."
)
UNKNOWN_ANGLE = "unknown"
RATE_REMEDY = "state the sampling rate in Hz, rate_hz=... (on the command line --rate-hz)"


def plain_cell(value: Any) -> Any:  # noqa: ANN401
    """Return a cell of a CSV file: text on one line, with an apostrophe if a spreadsheet would take it as a formula."""
    if not isinstance(value, str):
        return value
    value = plain_text(value)
    if not value.startswith(("=", "+", "-", "@")):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def file_name(text: str) -> str:
    """Return a name valid for a file or folder on every file system, of letters, digits, spaces and ``-_.``."""
    plain = "".join(sign if sign.isalnum() or sign in " -_." else "_" for sign in text).strip(" .") or "_"
    reserved = {"CON", "PRN", "AUX", "NUL", *(f"{port}{number}" for port in ("COM", "LPT") for number in range(10))}
    if plain.split(".")[0].strip().upper() in reserved:
        plain = f"_{plain}"
    longest_name_bytes = 200  # file systems allow 255
    if len(plain.encode()) <= longest_name_bytes:
        return plain
    return f"{plain[:40].strip(' .')} {sha256(plain.encode()).hexdigest()[:16]}"  # 40 letters have at most 160 bytes


def natural_key(text: str) -> tuple[tuple[int, str], ...]:
    """Return a sort key that compares numbers in names as numbers."""
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", text))


class RecordError(SentenceError):
    """A dataset, a file or an argument that is not a valid record.

    Examples
    --------
    >>> import numpy as np
    >>> import hums
    >>> try:
    ...     hums.make_record({"vib": np.zeros(100)}, rate_hz=0, angle=hums.UnknownAngle(), units="g")
    ... except hums.RecordError as error:
    ...     print(str(error).split(";")[0])
    rate_hz=0: a positive, finite number is needed
    """


class RecordWarning(UserWarning):
    """A record that another program wrote or changed."""


def real_vector(values: ArrayLike, what: str) -> NDArray[np.floating]:
    """Return a 1-D array of real numbers as float32 if it is float32, else as float64; masked samples become NaN."""
    try:
        array = real_array(values, name=what)
    except ValueError as error:
        raise RecordError(str(error)) from None
    if array.ndim != 1 or not array.size:
        raise RecordError(
            f"{what}: shape {array.shape}, but one row of at least one number is needed; give each column as a "
            "separate channel."
        )
    single = array.dtype.newbyteorder("=") == np.float32
    return array.astype(np.float32 if single else np.float64, copy=False)


def known_units(units: object, what: str) -> str:
    """Return units as spelled in `UNITS`; refuse unknown ones."""
    valid = ", ".join(f'"{name}"' for name in UNITS)
    if units is None or (isinstance(units, str) and not units):
        raise RecordError(
            f'{what}: no units. Declare them, Channel(values=..., units="g") or make_record(..., units="g"), '
            f"on the command line --units g. Units are one of {valid}."
        )
    if not isinstance(units, str) or units.strip() not in CANONICAL_UNITS:
        raise RecordError(f"{what}: units={units!r} are not known. Units are one of {valid}.")
    return CANONICAL_UNITS[units.strip()]


def direction_of(direction: Sequence[float] | str, what: str) -> str | list[float]:
    """Return a direction as a list of three finite numbers, or unchanged if in words."""
    if isinstance(direction, str):
        return direction
    given = list(direction) if np.iterable(direction) else []
    numbers = [float(one) for one in given if is_float(one)]
    if not (len(numbers) == len(given) == 3 and any(numbers) and np.all(np.isfinite(numbers))):  # noqa: PLR2004
        raise RecordError(f"{what}: direction={brief(direction)}; three numbers, not all zero, or a word are needed.")
    return numbers


def utc_text(moment: datetime | str | None) -> str:
    """Return a time as ISO 8601 in UTC, "" for None; refuse a time without a UTC offset."""
    if moment is None or (isinstance(moment, str) and not moment):
        return ""
    try:
        when = datetime.fromisoformat(moment) if isinstance(moment, str) else moment
        offset = when.utcoffset()
        utc = when.astimezone(UTC) if offset is not None else when
    except (ValueError, AttributeError, OverflowError) as error:  # the last of the years 1 and 9999
        raise RecordError(
            f"recorded_at={plain_repr(moment)}: a datetime or ISO 8601, such as 2013-03-11T03:00:24Z, is needed."
        ) from error
    if offset is None:
        raise RecordError(
            f"recorded_at={moment!s}: no time zone; add its UTC offset, such as {when.isoformat()}+01:00 or ...Z."
        )
    return utc.isoformat().replace("+00:00", "Z")


def positive_number(value: object, what: str, remedy: str) -> float:
    """Return a positive, finite number; refuse others with a remedy."""
    if is_float(value) and 0 < float(value) < math.inf:
        return float(value)
    raise RecordError(f"{what}={plain_repr(value)}: a positive, finite number is needed; {remedy}.")


def finite_number(value: object, what: str, kind: str = "number of seconds") -> float:
    """Return a finite number; refuse others."""
    if is_float(value) and math.isfinite(value):
        return float(value)
    raise RecordError(f"{what}={plain_repr(value)}: a finite {kind} is needed.")


def start_number(value: object, what: str, *, rate_hz: float) -> float:
    """Return the time of the first sample; refuse one so large that successive samples would have the same time."""
    start = finite_number(value, what)
    least_resolution = 0.5  # of a sample, in 64 bits: seconds since 1970 suffice up to 2 MHz
    if np.spacing(abs(start)) * rate_hz > least_resolution:
        raise RecordError(
            f"{what}={start:g}: times so large are resolved to {np.spacing(abs(start)):.2g} s, but samples at "
            f"{rate_hz:g} Hz are {1 / rate_hz:.2g} s apart; use start_s=0, and state the start as recorded_at."
        )
    return start


def plain_repr(value: object) -> str:
    """Return the `repr` of a value, shortened; that of the Python number for a numpy scalar."""
    return brief(value.item() if isinstance(value, np.generic) else value)


def is_utf8(name: str) -> bool:
    """Return whether a name was read as UTF-8; other bytes have become surrogates or replacement characters."""
    return "\ufffd" not in name and not any("\ud800" <= sign <= "\udfff" for sign in name)


def check_name(name: object, what: str) -> None:
    """Refuse names that HDF5 cannot store, names with a slash, which is a path of groups, and reserved names."""
    valid = isinstance(name, str) and name.strip() == name and name not in {"", ".", ".."}
    if not isinstance(name, str) or not valid or "/" in name or "\0" in name or not is_utf8(name):
        raise RecordError(f"{what}: the name {name!r} cannot be stored; use words without / and surrounding spaces.")
    if what != "truth" and (name in {"time", "nominal_speed"} or name.startswith("truth_")):
        raise RecordError(f'{what}: the name "{name}" is reserved in a record; choose another.')
