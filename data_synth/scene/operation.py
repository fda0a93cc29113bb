"""The drive as declared in a scene: time histories of speed and torque, and the tachometer."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeAlias, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, model_validator

from hums.gearbox.components import Declared, Name, Positive

Finite = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Turns = Annotated[float, Field(ge=0, lt=1)]
Rows = tuple[tuple[float, float], ...]


def _pairs(value: Any) -> Any:  # noqa: ANN401
    if not isinstance(value, Mapping | tuple):
        raise ValueError(f"{value!r}: give a table of values by name, as in {{ input = 1 }}")  # noqa: TRY004 - pydantic's
    return tuple(value.items()) if isinstance(value, Mapping) else value


T = TypeVar("T")
ByName: TypeAlias = Annotated[tuple[tuple[Name, T], ...], BeforeValidator(_pairs), PlainSerializer(dict)]
"""A table of values by name, stored as pairs so that scenes can be hashed."""


def _rows(value: Any) -> Any:  # noqa: ANN401
    """Return a single number as a constant time history."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return ((0.0, value),) if is_number else value


def _rising(rows: Rows) -> Rows:
    for (before, _), (after, _) in pairwise(rows):
        if after <= before:
            raise ValueError(f"the times must rise, but {after:g} s follows {before:g} s; sort the knots")
    return rows


Knots = Annotated[
    tuple[tuple[Finite, Finite], ...], Field(min_length=1), BeforeValidator(_rows), AfterValidator(_rising)
]


class Turbulence(Declared):
    """A Gaussian random fluctuation added to a time history, with no spectrum above `highest_hz`.

    `rms` is in the unit of the time history (rpm or N m), `time_scale_s` its time constant. Its spectrum is that of the
    longitudinal wind component (Kaimal).
    """

    rms: Positive
    time_scale_s: Positive
    highest_hz: Positive = 1.0


def csv_rows(path: Path, *columns: str) -> tuple[tuple[float, ...], ...]:
    """Read `columns` of numbers from a file with or without a header line."""
    what, names = f"csv = {str(path)!r}", ", ".join(columns)
    try:
        rows = [row.split(",") for row in path.read_text(encoding="utf-8-sig").splitlines() if row.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{what} cannot be read ({error}); name a text file of {names}") from None
    found = [_numbers(row) for row in rows]
    found = found[1:] if found and found[0] is None else found
    for number, (row, cells) in enumerate(zip(found, rows[-len(found) :], strict=False), start=1):
        if row is None or len(row) != len(columns):
            raise ValueError(f"{what}: data row {number}, {','.join(cells)!r}, does not have the columns {names}")
    return tuple(row for row in found if row is not None)


def _numbers(cells: list[str]) -> tuple[float, ...] | None:
    try:
        return tuple(map(float, cells))
    except ValueError:
        return None


class TimeHistory(Declared):
    """Common fields of speed and torque: link, steps instead of knots, added turbulence."""

    link: Name
    steps: Annotated[tuple[tuple[Finite, Finite], ...], Field(min_length=1), AfterValidator(_rising)] | None = None
    rise_s: NotNegative = 0.0
    turbulence: Turbulence | None = None
    quantity: ClassVar[str]

    @model_validator(mode="before")
    @classmethod
    def _read(cls, table: Any) -> Any:  # noqa: ANN401
        """Refuse a history given more than once, as knots, steps or a file; read it from a file."""
        if not isinstance(table, dict):
            return table
        value = cls.quantity
        given = [key for key in (value, "steps", "csv", "run_up") if table.get(key) is not None]
        if len(given) != 1:
            raise ValueError(
                f"{' and '.join(given)} are both given; keep one"
                if given
                else f"its values are missing; give {value} = a number or [[s, {value}], ...], steps or csv"
            )
        if "csv" not in table:
            return table
        return {key: item for key, item in table.items() if key != "csv"} | {
            value: csv_rows(Path(table["csv"]), "s", value)
        }

    @property
    def rows(self) -> Rows:
        """Times in s and values of knots or steps; empty in a run-up."""
        return getattr(self, self.quantity) or self.steps or ()

    @property
    def knots(self) -> Rows:
        """Times in s and values between which the history is linear; a step without rise has two knots at one time."""
        if self.steps is None:
            return self.rows
        pairs = pairwise(self.steps)
        return (
            self.steps[0],
            *(knot for (_, low), (at, high) in pairs for knot in ((at, low), (at + self.rise_s, high))),
        )

    @model_validator(mode="after")
    def _check_steps(self) -> Self:
        if self.rise_s and self.steps is None:
            raise ValueError(
                f"rise_s = {self.rise_s:g} is the duration of a step, but there are no steps; leave it out"
            )
        for (before, _), (after, _) in pairwise(self.steps or ()):
            if after < before + self.rise_s:
                raise ValueError(
                    f"rise_s = {self.rise_s:g}: the step at {before:g} s would extend beyond the next one at "
                    f"{after:g} s; reduce it to {after - before:g} or less"
                )
        return self


class RunUp(Declared):
    """A run-up under the torque of the scene, with a rigid drive train: ``J w' = T - (a + b w + c w abs(w))``.

    J = `inertia_kg_m2`, a = `load_nm`, b = `load_nm_s` and c = `load_nm_s2` of the whole train are referred to the link
    of the speed; w is the speed of that link in rad s-1, and T the torque referred to it by the speed ratio. The
    initial speed is `rpm`.
    """

    inertia_kg_m2: Positive
    load_nm: NotNegative = 0.0
    load_nm_s: NotNegative = 0.0
    load_nm_s2: NotNegative = 0.0
    rpm: NotNegative = 0.0


class Speed(TimeHistory):
    """Speed of a link against time.

    ``rpm`` is one number, or ``[[s, rpm], ...]``, linear between knots and constant outside; ``csv`` is the same in a
    file; ``steps = [[s, rpm], ...]`` changes to each level at its time, within `rise_s`; ``run_up`` computes the speed
    from the torque.
    """

    quantity: ClassVar[str] = "rpm"
    rpm: Knots | None = None
    run_up: RunUp | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.run_up is not None:
            if self.turbulence is not None:
                raise ValueError("a run-up follows from its torque; move turbulence to the torque")
            return self
        slowest = min(rpm for _, rpm in self.rows)
        if slowest <= 0:
            raise ValueError(f"rpm = {slowest:g} at some time, but the shaft must turn; keep rpm above 0")
        if self.turbulence is not None and slowest <= _DEVIATIONS * self.turbulence.rms:
            raise ValueError(
                f"turbulence.rms = {self.turbulence.rms:g}: {_DEVIATIONS} times that would stop a shaft at "
                f"{slowest:g} rpm; lower it below {slowest / _DEVIATIONS:g}"
            )
        return self


_DEVIATIONS = 8  # exceeded by a Gaussian variable once in 1e15


class Torque(TimeHistory):
    """Torque on a link against time, declared like a speed: ``nm``, ``csv`` or ``steps``.

    The tooth load is proportional to ``u + (1 - u) abs(T) / T_full`` with u = `unloaded_share`, since an unloaded mesh
    still rattles, and T_full = `full_load_nm`, by default the largest torque of knots or steps. A torque of 0
    throughout is the load u. A scene without torque is at full load.
    """

    quantity: ClassVar[str] = "nm"
    nm: Knots | None = None
    unloaded_share: Share = 0.3
    full_load_nm: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.full_load_nm is None and self.turbulence is not None and not any(nm for _, nm in self.rows):
            raise ValueError("turbulence about nm = 0 has no full load as a reference; give full_load_nm")
        return self


class Missing(Declared):
    """Missing pulses: each except the first is lost with probability `share`."""

    share: Annotated[float, Field(gt=0, lt=1)]


class Spurious(Declared):
    """Spurious pulses at random instants after the first pulse, on average `per_second`."""

    per_second: Positive


class PulseJitter(Declared):
    """Independent Gaussian errors of the pulse times."""

    std_s: Positive


class Uneven(Declared):
    """Unevenly spaced marks, each except the first displaced by the same angle in every revolution.

    Displacements are drawn once, Gaussian with `std_deg` of the angle of the link, or given in `deg`, one per mark.
    """

    std_deg: Positive | None = None
    deg: tuple[Finite, ...] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.std_deg is None) == (self.deg is None):
            raise ValueError("give either std_deg, to draw the displacements of the marks, or deg, one for each mark")
        return self


class Tachometer(Declared):
    """Tachometer pulses of a link. The first pulse is revolution zero of every phase in the record.

    `offset_rev` is the rotation of the link between the first sample and that pulse, drawn at random by default. Errors
    are applied in the order of the fields: uneven spacing of marks, missing pulses, spurious pulses, jitter of each
    pulse time, and finally the timer, delayed by `delay_s` and with a clock that gains `clock_ppm` on that of the
    channels. Revolution zero remains at the true passage of the first mark.
    """

    link: Name
    pulses_per_rev: Annotated[int, Field(ge=1)]
    offset_rev: NotNegative | None = None
    uneven: Uneven | None = None
    missing: Missing | None = None
    spurious: Spurious | None = None
    jitter: PulseJitter | None = None
    delay_s: Annotated[float, Field(ge=-1, le=1)] = 0.0
    clock_ppm: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        spacing = 1 / self.pulses_per_rev
        if self.offset_rev is not None and self.offset_rev >= spacing:
            raise ValueError(f"offset_rev = {self.offset_rev:g} must be below the pulse spacing, {spacing:g}")
        if self.uneven is not None:
            self._check_marks(self.uneven)
        return self

    def _check_marks(self, uneven: Uneven) -> None:
        spacing_deg = 360 / self.pulses_per_rev
        if uneven.std_deg is not None and _DEVIATIONS * uneven.std_deg >= spacing_deg / 2:
            raise ValueError(
                f"uneven.std_deg = {uneven.std_deg:g} allows marks {spacing_deg:g} degrees apart to change order; "
                f"keep it below {spacing_deg / 2 / _DEVIATIONS:g}"
            )
        if uneven.deg is None:
            return
        if len(uneven.deg) != self.pulses_per_rev:
            raise ValueError(
                f"uneven.deg has {len(uneven.deg)} numbers for pulses_per_rev = {self.pulses_per_rev}; "
                "give one for each mark"
            )
        places = [spacing_deg * mark + off for mark, off in enumerate((*uneven.deg, uneven.deg[0]))]
        if any(after <= before for before, after in pairwise(places)):
            raise ValueError(
                f"uneven.deg = {uneven.deg} changes the order of marks {spacing_deg:g} degrees apart; reduce the values"
            )
