"""The declared scene: a gearbox, how it is driven, what is broken and what listens. Frozen, read from TOML.

Every default below is a choice of physics. None hides: `Scene.to_toml` writes each of them out, the gearbox
included, and a record carries that text. Amplitudes are peak values in the units of the sensors.
"""

import math
from collections.abc import Mapping
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from hums.gearbox import (
    Declared,
    Gearbox,
    Name,
    Positive,
    Vector,
    closest,
    load_gearbox,
    named_file,
    read_toml,
    shipped_files,
    validated,
)
from hums.kinematics import Kinematics, solve_kinematics
from hums.orders import BearingOrders, bearing_orders, defect_orders

FIDELITIES = ("kinematic", "torsional", "lateral", "full", "auto")
FAULT_KINDS = ("tooth_crack", "inner_race", "outer_race", "rolling_element", "cage")
_ROW_OF = {"tooth_crack": "tooth"}  # the kind of defect order that a fault repeats at, where not its own name


class SceneError(ValueError):
    """A scene that cannot be read, or that asks for what cannot be simulated."""


def _knots(value: Any) -> Any:  # noqa: ANN401
    """Read a single number as a constant."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return ((0.0, value),) if is_number else value


def _rising(knots: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    for (before, _), (after, _) in pairwise(knots):
        if after <= before:
            raise ValueError(f"the times must rise, but {after:g} s follows {before:g} s; sort the knots")
    return knots


def _csv_knots(path: Path) -> tuple[tuple[float, float], ...]:
    try:
        lines = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"csv = {str(path)!r} cannot be read ({error}); name a text file of s, rpm") from None
    try:
        knots = tuple((float(time_s), float(rpm)) for time_s, rpm in lines[1:])
        return ((float(lines[0][0]), float(lines[0][1])), *knots) if _is_number(lines[0][0]) else knots
    except (ValueError, IndexError):
        raise ValueError(
            f"csv = {str(path)!r} does not hold two columns of numbers, s and rpm, in every line"
        ) from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


Finite = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Knots = Annotated[
    tuple[tuple[Finite, Finite], ...], Field(min_length=1), BeforeValidator(_knots), AfterValidator(_rising)
]


class Speed(Declared):
    """Speed of a link: ``rpm = [[s, rpm], ...]``, linear between knots and held outside; or one number."""

    link: Name
    rpm: Knots

    @model_validator(mode="before")
    @classmethod
    def _read_csv(cls, table: Any) -> Any:  # noqa: ANN401
        """Read ``csv = "speed.csv"``, two columns s and rpm with or without a header line, as knots."""
        if not isinstance(table, dict) or "csv" not in table:
            return table
        if "rpm" in table:
            raise ValueError("both rpm and csv are given; keep one")
        return {key: value for key, value in table.items() if key != "csv"} | {"rpm": _csv_knots(Path(table["csv"]))}

    @model_validator(mode="after")
    def _check(self) -> Self:
        slowest = min(rpm for _, rpm in self.rpm)
        if slowest <= 0:
            raise ValueError(f"rpm = {slowest:g} at some time, but the shaft has to turn; keep rpm above 0")
        return self


class Torque(Declared):
    """Torque on a link: ``nm = [[s, N m], ...]``, linear between knots and held outside; or one number.

    What the teeth carry scales with ``u + (1 - u) abs(T) / max abs(T)``, u = `unloaded_share`: a mesh still
    rattles where it carries nothing. A scene without torque is at full load.
    """

    link: Name
    nm: Knots
    unloaded_share: Share = 0.3

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not any(nm for _, nm in self.nm):
            raise ValueError("nm is 0 throughout, so no load can be relative to it; leave torque out")
        return self


class Tachometer(Declared):
    """Pulses on a link. Its first pulse is revolution zero of every phase in the record.

    `offset_rev` is the turn of the link between the first sample and that pulse; drawn at random if left out.
    """

    link: Name
    pulses_per_rev: Annotated[int, Field(ge=1)]
    offset_rev: NotNegative | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.offset_rev is not None and self.offset_rev >= 1 / self.pulses_per_rev:
            raise ValueError(
                f"offset_rev = {self.offset_rev:g} is a pulse spacing or more; "
                f"keep it below {1 / self.pulses_per_rev:g}"
            )
        return self


class Excitation(Declared):
    """Amplitudes at the source of the healthy gearbox: harmonic k has ``decay ** (k - 1)`` of the first.

    Shafts speak with `shaft_amplitude` each, whatever the load; meshes with `mesh_amplitude` at full load.
    """

    shaft_amplitude: NotNegative = 0.05
    mesh_amplitude: NotNegative = 0.5
    harmonics: Annotated[int, Field(ge=1)] = 3
    decay: Share = 0.5


class Mode(Declared):
    """One damped mode of the structure: undamped natural frequency and damping ratio."""

    frequency_hz: Positive
    damping_ratio: Annotated[float, Field(gt=0, lt=1)]


class Noise(Declared):
    """White Gaussian noise of each sensor, `rms` in its units."""

    rms: NotNegative = 0.05


class ToothCrack(Declared):
    """A cracked tooth: the mesh modulated once a revolution over about one tooth, and one impact in it.

    The depth in mm times each of the three factors gives the relative rise of the mesh amplitude, the lag of
    the first mesh harmonic's phase (harmonic h: h times), and the amplitude of the impact, at full load. The
    factors are illustrative: a kinematic scene has no tooth stiffness to derive them from.
    """

    kind: Literal["tooth_crack"]
    component: Name
    depth_mm: Positive
    amplitude_per_mm: NotNegative = 0.2
    phase_rad_per_mm: NotNegative = 0.1
    impact_per_mm: NotNegative = 1.0


class BearingFault(Declared):
    """A defect of a rolling bearing that is struck time and again, with slip.

    Intervals between impacts scatter by `slip_std` of the mean, independently, so their errors add up
    (Antoni and Randall 2003, J. Vib. Acoust. 125); `mean_slip` lowers the mean rate below that of pure rolling. Where
    the struck part turns through the load zone, impacts follow Stribeck's load distribution with the factor
    `load_distribution` (0.5: half of the ring carries). Their amplitude at
    full load is `size_mm` times `impact_per_mm`, an illustrative factor.
    """

    kind: Literal["inner_race", "outer_race", "rolling_element", "cage"]
    component: Name
    size_mm: Positive
    slip_std: Annotated[float, Field(ge=0, le=0.1)] = 0.01
    mean_slip: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0
    load_distribution: Annotated[float, Field(gt=0, le=1)] = 0.5
    impact_per_mm: NotNegative = 1.0


class Sensor(Declared):
    """An accelerometer on a bearing, link or mesh. In a kinematic scene place and direction are labels."""

    name: Name
    on: Name
    direction: Vector | None = None
    units: Literal["g", "m s-2"]


Fault = Annotated[ToothCrack | BearingFault, Field(discriminator="kind")]


class Scene(Declared):
    """What is simulated. Built by `load_scene`, `Scene.from_toml` or `Scene.from_mapping`.

    `resonance` is the mode that impacts ring; `path` the one that shaft and mesh lines pass on their way to
    the sensors, so that their amplitude and phase change with speed (left out: a rigid path).
    """

    gearbox: Gearbox
    rate_hz: Positive
    duration_s: Positive
    fidelity: str
    speed: Speed
    torque: Torque | None = None
    tachometer: Tachometer
    excitation: Excitation = Excitation()
    path: Mode | None = None
    resonance: Mode = Mode(frequency_hz=8000.0, damping_ratio=0.03)
    noise: Noise = Noise()
    faults: tuple[Fault, ...] = Field(default=(), alias="fault")
    sensors: tuple[Sensor, ...] = Field(alias="sensor", min_length=1)

    @field_validator("gearbox", mode="before")
    @classmethod
    def _load_gearbox(cls, value: Any) -> Any:  # noqa: ANN401
        """Read a catalogue name, a path or an inline table."""
        if isinstance(value, Mapping):
            return Gearbox.from_mapping(value)
        return load_gearbox(value) if isinstance(value, str | Path) else value

    @field_validator("fidelity")
    @classmethod
    def _kinematic_only(cls, value: str) -> str:
        if value == "kinematic":
            return value
        state = "is planned but does not exist yet" if value in FIDELITIES else "is not known"
        raise ValueError(f'"{value}" {state}; "kinematic" is what exists, write fidelity = "kinematic"')

    @field_validator("faults", mode="before")
    @classmethod
    def _known_kinds(cls, tables: Any) -> Any:  # noqa: ANN401
        """Refuse an unknown kind in words, before the union of models has to."""
        for number, table in enumerate(tables if isinstance(tables, tuple) else (), start=1):
            kind = table.get("kind") if isinstance(table, Mapping) else getattr(table, "kind", None)
            if kind not in FAULT_KINDS:
                what = f'kind = "{kind}" is not known' if kind is not None else "kind is missing"
                raise ValueError(f"number {number}: {what}; valid: {', '.join(FAULT_KINDS)}")
        return tables

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.gearbox.reference is None:
            raise ValueError(
                f'gearbox "{self.gearbox.name}" declares no reference to count orders by; add reference = "LINK" to it'
            )
        self._check_links()
        self._check_faults()
        self._check_sensors()
        return self

    def _check_links(self) -> None:
        users = [("speed", self.speed.link), ("tachometer", self.tachometer.link)]
        users += [("torque", self.torque.link)] if self.torque is not None else []
        for user, link in users:
            if link not in self.gearbox.links:
                raise ValueError(f'{user} names the link "{link}"{closest(link, list(self.gearbox.links))}')
            if user != "torque" and self.ratio(link) == 0:
                raise ValueError(f'{user} names the link "{link}", which does not turn; name one that does')

    def _check_faults(self) -> None:
        for number, fault in enumerate(self.faults, start=1):
            valid = self.components(fault.kind)
            if fault.component not in valid:
                raise ValueError(
                    f'fault {number}: {fault.kind} has no component "{fault.component}"; valid: '
                    + (", ".join(f'"{name}"' for name in valid) or "none in this gearbox")
                )
            if self.orders[fault.component, _ROW_OF.get(fault.kind, fault.kind)] == 0:
                raise ValueError(
                    f'fault {number}: {fault.kind} of "{fault.component}" never comes round; choose another'
                )
        if self.faults and self.resonance.frequency_hz >= self.rate_hz / 2:
            raise ValueError(
                f"resonance.frequency_hz = {self.resonance.frequency_hz:g} is not below half of "
                f"rate_hz = {self.rate_hz:g}; raise rate_hz or lower the resonance that impacts ring"
            )

    def _check_sensors(self) -> None:
        bearings = [name for bearing in self.gearbox.bearings for name in bearing.names]
        places = {*bearings, *self.gearbox.links, *(mesh.name for mesh in self.gearbox.meshes)}
        names = [sensor.name for sensor in self.sensors]
        for sensor in self.sensors:
            if sensor.on not in places:
                raise ValueError(
                    f'sensor "{sensor.name}" is on "{sensor.on}", which is no bearing, link or mesh of '
                    f'gearbox "{self.gearbox.name}"{closest(sensor.on, places)}'
                )
            if names.count(sensor.name) > 1:
                raise ValueError(f'two sensors are called "{sensor.name}"; give each a name of its own')
            if sensor.units != self.sensors[0].units:
                raise ValueError(
                    f'sensor "{sensor.name}" has units "{sensor.units}" and "{names[0]}" '
                    f'"{self.sensors[0].units}"; amplitudes are in the units of the sensors, so use one for all'
                )

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any], *, where: str = "scene") -> "Scene":
        """Validate a parsed scene file; `where` names it in errors."""
        return validated(cls, dict(table), where=where, error=SceneError)

    @classmethod
    def from_toml(cls, path: str | Path) -> "Scene":
        """Read a scene file. Relative paths of a gearbox or a speed table are looked for beside the scene first."""
        path = Path(path)
        table = read_toml(path, error=SceneError)
        gearbox = table.get("gearbox")
        if isinstance(gearbox, str) and (path.parent / gearbox).is_file():
            table["gearbox"] = str(path.parent / gearbox)
        speed = table.get("speed")
        if isinstance(speed, dict) and isinstance(speed.get("csv"), str) and (path.parent / speed["csv"]).is_file():
            table["speed"] = speed | {"csv": str(path.parent / speed["csv"])}
        return cls.from_mapping(table, where=str(path))

    def to_toml(self) -> str:
        """Write the scene with the gearbox and every default in it; `from_mapping` reads it back."""
        import tomli_w  # noqa: PLC0415 - only provenance needs it

        return tomli_w.dumps(self.model_dump(mode="json", by_alias=True, exclude_none=True))

    @cached_property
    def kinematics(self) -> Kinematics:
        """The solved mechanism."""
        return solve_kinematics(self.gearbox)

    @cached_property
    def orders(self) -> dict[tuple[str, str], Fraction | float]:
        """Defect orders by component and kind, exact where teeth define them."""
        table = defect_orders(self.kinematics)
        return {
            (component, kind): exact if isinstance(exact, Fraction) else float(order)
            for component, kind, exact, order in zip(
                table["component"], table["kind"], table["exact"], table["order"], strict=True
            )
        }

    def exact_orders(self, kind: str) -> dict[str, Fraction]:
        """Return the orders of one kind that teeth alone define, by component; those at rest left out."""
        return {
            component: order
            for (component, row_kind), order in self.orders.items()
            if row_kind == kind and isinstance(order, Fraction) and order
        }

    def bearing(self, name: str) -> BearingOrders:
        """Return the rates of one bearing in orders."""
        return next(rates for rates in bearing_orders(self.kinematics) if rates.name == name)

    def components(self, fault_kind: str) -> list[str]:
        """Return the components that can have a fault of this kind."""
        row_kind = _ROW_OF.get(fault_kind, fault_kind)
        return [component for component, kind in self.orders if kind == row_kind]

    def ratio(self, link: str) -> Fraction:
        """Return the turns of a link, in the frame, for one turn of the reference: signed and exact."""
        of_link, of_reference = (
            self.kinematics.relative_speed(name, seen_from=self.gearbox.frame)
            for name in (link, self.gearbox.reference or link)
        )
        return of_link / of_reference

    def speed_knots_hz(self) -> tuple[tuple[float, float], ...]:
        """Return the knots of the reference shaft's speed, (s, rev s-1)."""
        turns = float(abs(self.ratio(self.speed.link))) * 60
        return tuple((time_s, rpm / turns) for time_s, rpm in self.speed.rpm)

    @property
    def samples(self) -> int:
        """Number of samples of each channel."""
        return max(1, round(self.duration_s * self.rate_hz))

    @property
    def truth_times(self) -> int:
        """Number of instants, evenly from 0 to `duration_s`, at which the truth is stated: 20 a second."""
        return math.ceil(20 * self.duration_s - 1e-9) + 1


def load_scene(name_or_path: str | Path) -> Scene:
    """Load a scene from a TOML file or, by its name, from the catalogue that ships with the package.

    Parameters
    ----------
    name_or_path : str or Path
        Path of a ``.toml`` file, or a catalogue name such as ``"demo"``.

    Raises
    ------
    SceneError
        With one sentence that names the thing, its value, what was needed and what to do.
    """
    return Scene.from_toml(named_file(name_or_path, shipped=catalogue(), thing="scene", error=SceneError))


def catalogue() -> dict[str, Path]:
    """Return the scenes that ship with the package: name -> file."""
    return shipped_files("data_synth")
