"""The declared scene: a gearbox, how it is driven, what is broken and what listens. Frozen, read from TOML.

Every default below is a choice of physics. None hides: `Scene.to_toml` writes each of them out, the gearbox
included, and a record carries that text. Amplitudes are peak values in the units of the sensors.
"""

import math
from collections.abc import Mapping
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from pydantic import Field, field_validator, model_validator

from data_synth.chain import Mode, Noise, PlanetPass, SamplingJitter, Sensor, check_chain
from data_synth.defects import FAULT_KINDS, ROW_OF, BearingFault, Fault, ShaftFault
from data_synth.driving import Speed, Tachometer, Torque
from data_synth.dynamics import Dynamics
from data_synth.excitation import Excitation
from data_synth.frf import Transfer, check_transfers
from data_synth.gear_faults import GearFault, ToothCrack
from hums.gearbox import (
    Declared,
    Gearbox,
    Positive,
    closest,
    load_gearbox,
    named_file,
    read_toml,
    shipped_files,
    validated,
)
from hums.kinematics import Kinematics, solve_kinematics
from hums.orders import BearingOrders, bearing_orders, defect_orders

__all__ = [
    "BearingFault",
    "Excitation",
    "Fault",
    "GearFault",
    "Mode",
    "Noise",
    "Scene",
    "SceneError",
    "Sensor",
    "ShaftFault",
    "Speed",
    "Tachometer",
    "ToothCrack",
    "Torque",
    "catalogue",
    "load_scene",
]

_DEVIATIONS = 8  # that a Gaussian error never goes beyond: once in 1e15
FIDELITIES = ("kinematic", "torsional", "lateral", "full", "auto")


class SceneError(ValueError):
    """A scene that cannot be read, or that asks for what cannot be simulated."""


class Scene(Declared):
    """What is simulated. Built by `load_scene`, `Scene.from_toml` or `Scene.from_mapping`.

    `resonance` is the mode that impacts ring; `path` the one that shaft and mesh lines pass on their way to
    the sensors, so that their amplitude and phase change with speed (left out: a rigid path); `transfers` are ways of
    their own from one source to one sensor. `planet_pass` lets planets pass the sensors (left out: they are heard alike
    wherever they are, and have no sidebands). Where `fidelity` is other than kinematic, gears vibrate: `dynamics` takes
    the place of what `excitation` declares of meshes.
    """

    gearbox: Gearbox
    rate_hz: Positive
    duration_s: Positive
    fidelity: str
    speed: Speed
    torque: Torque | None = None
    tachometer: Tachometer
    excitation: Excitation = Excitation()
    dynamics: Dynamics | None = None
    path: Mode | None = None
    resonance: Mode = Mode(frequency_hz=8000.0, damping_ratio=0.03)
    planet_pass: PlanetPass | None = None
    transfers: tuple[Transfer, ...] = Field(default=(), alias="transfer")
    sampling_jitter: SamplingJitter | None = None
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
    def _known_fidelity(cls, value: str) -> str:
        if value in FIDELITIES:
            return value
        raise ValueError(f'"{value}" is not known{closest(value, [*FIDELITIES])}')

    @model_validator(mode="before")
    @classmethod
    def _write_out_dynamics(cls, table: Any) -> Any:  # noqa: ANN401
        """Give a scene whose gears vibrate all that it takes, so that no default hides."""
        if not isinstance(table, Mapping) or table.get("fidelity", "kinematic") == "kinematic":
            return table
        return dict(table) | {"dynamics": table.get("dynamics") or Dynamics()}

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
        self._check_excitation()
        self._check_faults()
        self._check_sensors()
        self._check_ways()
        return self

    def _check_links(self) -> None:
        users = [("speed", self.speed.link), ("tachometer", self.tachometer.link)]
        users += [("torque", self.torque.link)] if self.torque is not None else []
        for user, link in users:
            if link not in self.gearbox.links:
                raise ValueError(f'{user} names the link "{link}"{closest(link, list(self.gearbox.links))}')
            if self.ratio(link) == 0:
                need = "so no path takes its power on" if user == "torque" else "which does not turn"
                stands = "which does not turn, " if user == "torque" else ""
                raise ValueError(f'{user} names the link "{link}", {stands}{need}; name one that does')
        if self.speed.run_up is not None and self.torque is None:
            raise ValueError("speed.run_up asks for a torque that drives it; add torque = { link = ..., nm = ... }")

    def _check_excitation(self) -> None:
        for field, kind in (("shafts", "shaft"), ("meshes", "gear_mesh")):
            valid = list(self.exact_orders(kind))
            for component, _ in getattr(self.excitation, field):
                if component not in valid:
                    raise ValueError(f'excitation.{field} names "{component}"{closest(component, valid)}')

    def _check_faults(self) -> None:
        for number, fault in enumerate(self.faults, start=1):
            valid = self.components(fault.kind)
            if fault.component not in valid:
                raise ValueError(
                    f'fault {number}: {fault.kind} has no component "{fault.component}"; valid: '
                    + (", ".join(f'"{name}"' for name in valid) or "none in this gearbox")
                )
            if self.orders[fault.component, ROW_OF.get(fault.kind, fault.kind)] == 0:
                raise ValueError(
                    f'fault {number}: {fault.kind} of "{fault.component}" never comes round; choose another'
                )
            link = getattr(fault, "load_turns_with", None)
            if link is not None and link not in self.gearbox.links:
                raise ValueError(
                    f'fault {number}: load_turns_with names "{link}"{closest(link, list(self.gearbox.links))}'
                )
        if self.faults and self.resonance.frequency_hz >= self.rate_hz / 2:
            raise ValueError(
                f"resonance.frequency_hz = {self.resonance.frequency_hz:g} is not below half of "
                f"rate_hz = {self.rate_hz:g}; raise rate_hz or lower the resonance that impacts ring"
            )

    @property
    def _places(self) -> set[str]:
        """Bearings, links and meshes."""
        bearings = [name for bearing in self.gearbox.bearings for name in bearing.names]
        return {*bearings, *self.gearbox.links, *(mesh.name for mesh in self.gearbox.meshes)}

    def _check_ways(self) -> None:
        sources = self._places
        if self.fidelity == "kinematic":  # of links, only shafts sound
            sources -= {*self.gearbox.links} - {*self.exact_orders("shaft")}
        check_transfers(self.transfers, sources=sources, sensors=[sensor.name for sensor in self.sensors])
        if self.sampling_jitter is None:
            return
        moves = any(isinstance(fault, BearingFault) and fault.five_dof is not None for fault in self.faults)
        if moves or any(transfer.lines is not None for transfer in self.transfers):
            what = "a bearing with five_dof" if moves else "a measured transfer"
            raise ValueError(f"sampling_jitter does not go with {what}, which is sampled evenly; leave one of them out")

    def _check_sensors(self) -> None:
        places = self._places
        names = [sensor.name for sensor in self.sensors]
        for sensor in self.sensors:
            if sensor.on not in places:
                raise ValueError(
                    f'sensor "{sensor.name}" is on "{sensor.on}", which is no bearing, link or mesh of '
                    f'gearbox "{self.gearbox.name}"{closest(sensor.on, places)}'
                )
            if names.count(sensor.name) > 1:
                raise ValueError(f'two sensors are called "{sensor.name}"; give each a name of its own')
            check_chain(sensor, first=self.sensors[0], rate_hz=self.rate_hz)
        if self.sampling_jitter is not None and _DEVIATIONS * self.sampling_jitter.std_s * self.rate_hz > 1:
            raise ValueError(
                f"sampling_jitter.std_s = {self.sampling_jitter.std_s:g} lets samples change places; "
                f"keep it below {1 / (_DEVIATIONS * self.rate_hz):g}"
            )

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any], *, where: str = "scene") -> "Scene":
        """Validate a parsed scene file; `where` names it in errors."""
        return validated(cls, dict(table), where=where, error=SceneError)

    @classmethod
    def from_toml(cls, path: str | Path) -> "Scene":
        """Read a scene file. Relative paths of a gearbox or a table are looked for beside the scene first."""
        path = Path(path)
        table = read_toml(path, error=SceneError)
        gearbox = table.get("gearbox")
        if isinstance(gearbox, str) and (path.parent / gearbox).is_file():
            table["gearbox"] = str(path.parent / gearbox)
        for course in ("speed", "torque"):
            if isinstance(table.get(course), dict):
                table[course] = _with_file(table[course], path.parent)
        if isinstance(table.get("transfer"), list):
            table["transfer"] = [_with_file(item, path.parent) for item in table["transfer"]]
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
        row_kind = ROW_OF.get(fault_kind, fault_kind)
        return [component for component, kind in self.orders if kind == row_kind]

    def ratio(self, link: str) -> Fraction:
        """Return the turns of a link, in the frame, for one turn of the reference: signed and exact."""
        of_link, of_reference = (
            self.kinematics.relative_speed(name, seen_from=self.gearbox.frame)
            for name in (link, self.gearbox.reference or link)
        )
        return of_link / of_reference

    def speed_knots_hz(self) -> tuple[tuple[float, float], ...]:
        """Return the knots of the reference shaft's declared speed, (s, rev s-1); none in a run-up."""
        turns = float(abs(self.ratio(self.speed.link))) * 60
        return tuple((time_s, rpm / turns) for time_s, rpm in self.speed.knots)

    @property
    def samples(self) -> int:
        """Number of samples of each channel."""
        return max(1, round(self.duration_s * self.rate_hz))

    @property
    def truth_times(self) -> int:
        """Number of instants, evenly from 0 to `duration_s`, at which the truth is stated: 20 a second."""
        return math.ceil(20 * self.duration_s - 1e-9) + 1


def _with_file(table: Any, beside: Path) -> Any:  # noqa: ANN401
    """Return a table with its csv file looked for beside the scene first."""
    if not isinstance(table, dict) or not isinstance(file := table.get("csv"), str):
        return table
    return table | {"csv": str(beside / file if (beside / file).is_file() else file)}


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
