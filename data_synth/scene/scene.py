"""The declared scene: a gearbox, its drive, its faults and its sensors. Frozen, read from TOML.

Every default below is a physical choice. `Scene.to_toml` writes all of them out, including the gearbox, and each record
carries that text. Amplitudes are peak values in the units of the sensors.
"""

import math
from collections.abc import Mapping
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from data_synth.scene.faults import FAULT_KINDS, ROW_OF, Fault
from data_synth.scene.gear_dynamics import Dynamics
from data_synth.scene.imperfections import Imperfections
from data_synth.scene.machine_faults import BearingFault, ShaftFault
from data_synth.scene.operation import ByName, NotNegative, Share, Speed, Tachometer, Torque
from data_synth.scene.sensors import Mode, Noise, PlanetPass, Sensor, Transfer, check_chain, check_transfers
from hums.gearbox.bearing_catalogue import BearingOrders
from hums.gearbox.components import (
    Declared,
    Positive,
    closest,
    named_file,
    read_toml,
    sentences,
    shipped_files,
    sibling_file,
    validated,
)
from hums.gearbox.defect_orders import bearing_orders, defect_orders
from hums.gearbox.kinematics import Kinematics, solve_kinematics
from hums.gearbox.model import Gearbox, load_gearbox
from signals._validation import SentenceError, checked

# ---- Source amplitudes of the healthy gearbox, as a scene declares them ----------------------------------------------


class Excitation(Declared):
    """Source amplitudes of the healthy gearbox; harmonic k has ``decay ** (k - 1)`` times the amplitude of the first.

    Each shaft has `shaft_amplitude`, independent of the load; each mesh has `mesh_amplitude` at full load. `shafts` and
    `meshes` override individual ones, as in ``meshes = { "stage 2" = 0.2 }``. All amplitudes are proportional to
    ``(speed / top speed) ** speed_exponent``: 0 keeps them constant; 2, the law of imbalance, suits a run-up from rest.
    """

    shaft_amplitude: NotNegative = 0.05
    mesh_amplitude: NotNegative = 0.5
    shafts: ByName[NotNegative] = ()
    meshes: ByName[NotNegative] = ()
    harmonics: Annotated[int, Field(ge=1)] = 3
    decay: Share = 0.5
    speed_exponent: NotNegative = 0.0

    def amplitude(self, kind: str, component: str) -> float:
        """Return the amplitude of the first harmonic of a shaft (kind `shaft`) or a mesh (kind `gear_mesh`)."""
        own, common = (self.shafts, self.shaft_amplitude) if kind == "shaft" else (self.meshes, self.mesh_amplitude)
        return dict(own).get(component, common)


# ---- Scene -----------------------------------------------------------------------------------------------------------


class SceneError(SentenceError):
    """A scene that cannot be read or simulated.

    Examples
    --------
    >>> from data_synth import SceneError, load_scene
    >>> try:
    ...     load_scene("demonstration")
    ... except SceneError as error:
    ...     print("demonstration" in str(error))
    True
    """


class Scene(Declared):
    """A gearbox with its drive, faults and sensors: everything that `simulate` needs.

    Built by `load_scene`, `Scene.from_toml` or `Scene.from_mapping`; invalid values raise `SceneError`.

    `resonance` is the mode excited by impacts. `path` is the mode through which shaft and mesh harmonics reach the
    sensors, so that their amplitude and phase change with speed (default: a rigid path). Each of `transfers` is a
    transfer function from one source to one sensor. With `planet_pass`, planets modulate their meshes as they pass the
    sensors (default: the transfer function of a planet does not depend on its position, and there are no sidebands).
    With a `fidelity` other than kinematic the gears vibrate, and `dynamics` replaces the mesh amplitudes of
    `excitation`. `imperfections` are those of healthy machines and their measurement.

    Examples
    --------
    >>> from data_synth import Scene
    >>> table = {
    ...     "gearbox": "two-stage", "rate_hz": 5000, "duration_s": 2, "fidelity": "kinematic",
    ...     "speed": {"link": "input", "rpm": 1200}, "tachometer": {"link": "input", "pulses_per_rev": 1},
    ...     "sensor": [{"name": "input", "on": "input bearing", "units": "g"}],
    ... }
    >>> scene = Scene.from_mapping(table)
    >>> scene.samples, scene.speed.rpm
    (10000, ((0.0, 1200.0),))
    """

    gearbox: Gearbox
    rate_hz: Positive
    duration_s: Positive
    fidelity: Literal["kinematic", "dynamic", "auto"]
    speed: Speed
    torque: Torque | None = None
    tachometer: Tachometer
    excitation: Excitation = Excitation()
    dynamics: Dynamics | None = None
    path: Mode | None = None
    resonance: Mode = Mode(frequency_hz=8000.0, damping_ratio=0.03)
    planet_pass: PlanetPass | None = None
    transfers: tuple[Transfer, ...] = Field(default=(), alias="transfer")
    noise: Noise = Noise()
    imperfections: Imperfections | None = None
    faults: tuple[Fault, ...] = Field(default=(), alias="fault")
    sensors: tuple[Sensor, ...] = Field(alias="sensor", min_length=1)

    @field_validator("gearbox", mode="before")
    @classmethod
    def _load_gearbox(cls, value: Any) -> Any:  # noqa: ANN401
        """Load a catalogue name, a path or an inline table."""
        if isinstance(value, Mapping):
            return Gearbox.from_mapping(value)
        return load_gearbox(value) if isinstance(value, str | Path) else value

    @model_validator(mode="before")
    @classmethod
    def _write_out_dynamics(cls, table: Any) -> Any:  # noqa: ANN401
        """Add the defaults of `dynamics` to a scene whose gears vibrate, so that they are written out."""
        if not isinstance(table, Mapping) or table.get("fidelity", "kinematic") == "kinematic":
            return table
        return dict(table) | {"dynamics": table.get("dynamics") or Dynamics()}

    @field_validator("faults", mode="before")
    @classmethod
    def _known_kinds(cls, tables: Any) -> Any:  # noqa: ANN401
        """Refuse an unknown kind of fault concisely, before pydantic lists every model of the union."""
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
                f'gearbox "{self.gearbox.name}" declares no reference shaft for orders; add reference = "LINK" to it'
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
                need = (
                    "which does not turn, so that it transmits no power" if user == "torque" else "which does not turn"
                )
                raise ValueError(f'{user} names the link "{link}", {need}; name one that does')
        if self.speed.run_up is not None and self.torque is None:
            raise ValueError("speed.run_up requires a driving torque; add torque = { link = ..., nm = ... }")

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
                    f'fault {number}: {fault.kind} of "{fault.component}" never repeats; choose another component'
                )
            link = getattr(fault, "load_turns_with", None)
            if link is not None and link not in self.gearbox.links:
                raise ValueError(
                    f'fault {number}: load_turns_with names "{link}"{closest(link, list(self.gearbox.links))}'
                )
        if any(self._rings(fault) for fault in self.faults) and self.resonance.frequency_hz >= self.rate_hz / 2:
            raise ValueError(
                f"resonance.frequency_hz = {self.resonance.frequency_hz:g} is not below half of "
                f"rate_hz = {self.rate_hz:g}; raise rate_hz, or lower the resonance excited by impacts"
            )

    def _rings(self, fault: Fault) -> bool:
        """Return whether impacts of a fault excite the resonance, as they do unless the teeth of its gear vibrate."""
        if isinstance(fault, BearingFault | ShaftFault):
            return isinstance(fault, BearingFault)
        return self.fidelity == "kinematic"

    @property
    def _places(self) -> set[str]:
        """Names of bearings, links and meshes, where a sensor or a source can be."""
        bearings = [name for bearing in self.gearbox.bearings for name in bearing.names]
        return {*bearings, *self.gearbox.links, *(mesh.name for mesh in self.gearbox.meshes)}

    def _check_ways(self) -> None:
        sources = self._places
        if self.fidelity == "kinematic":  # of links, only rotating shafts are sources
            sources -= {*self.gearbox.links} - {*self.exact_orders("shaft")}
        check_transfers(self.transfers, sources=sources, sensors=[sensor.name for sensor in self.sensors])

    def _check_sensors(self) -> None:
        places = self._places
        names = [sensor.name for sensor in self.sensors]
        for sensor in self.sensors:
            if sensor.on not in places:
                raise ValueError(
                    f'sensor "{sensor.name}" is on "{sensor.on}", which is not a bearing, link or mesh of '
                    f'gearbox "{self.gearbox.name}"{closest(sensor.on, places)}'
                )
            if names.count(sensor.name) > 1:
                raise ValueError(f'two sensors are named "{sensor.name}"; give each its own name')
            check_chain(sensor, first=self.sensors[0], rate_hz=self.rate_hz)

    @classmethod
    def from_mapping(cls, table: Mapping[str, Any], *, where: str = "scene") -> "Scene":
        """Return the scene of a parsed scene file.

        Parameters
        ----------
        table : mapping
            The keys of a scene file with their values.
        where : str
            Name of the scene in error messages.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            An invalid key or value.

        Examples
        --------
        >>> import tomllib
        >>> from data_synth import Scene, load_scene
        >>> scene = load_scene("demo")
        >>> Scene.from_mapping(tomllib.loads(scene.to_toml())) == scene
        True
        """
        return validated(cls, dict(table), where=where, error=SceneError)

    def changed(self, **values: object) -> Self:
        """Return a validated copy with some fields replaced; raise SceneError if they are invalid."""
        try:
            return super().changed(**values)
        except ValidationError as caught:
            raise SceneError(f"scene: {sentences(caught)}") from None

    @classmethod
    def from_toml(cls, path: str | Path) -> "Scene":
        """Read a scene file.

        Parameters
        ----------
        path : str or Path
            The file. Relative paths in it, of a gearbox or a table, are first looked up in its folder.

        Returns
        -------
        Scene

        Raises
        ------
        SceneError
            A file that cannot be read, or an invalid key or value.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> from data_synth import Scene, load_scene
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "scene.toml"
        ...     _ = path.write_text(load_scene("demo").to_toml(), encoding="utf-8")
        ...     Scene.from_toml(path).rate_hz
        50000.0
        """
        path = Path(path)
        table = read_toml(path, error=SceneError)
        gearbox = table.get("gearbox")
        if isinstance(gearbox, str):
            table["gearbox"] = sibling_file(path, gearbox)
        for history in ("speed", "torque"):
            if isinstance(table.get(history), dict):
                table[history] = _with_file(table[history], path)
        if isinstance(table.get("transfer"), list):
            table["transfer"] = [_with_file(item, path) for item in table["transfer"]]
        if isinstance(meshes := dict(table.get("dynamics") or {}).get("meshes"), dict):
            table["dynamics"]["meshes"] = {name: _with_file(mesh, path) for name, mesh in meshes.items()}
        return cls.from_mapping(table, where=str(path))

    def to_toml(self) -> str:
        """Return the scene as TOML text, with the gearbox and every default written out.

        Returns
        -------
        str
            Text that `Scene.from_mapping` reads back after `tomllib.loads`.

        Examples
        --------
        >>> from data_synth import load_scene
        >>> load_scene("demo").to_toml().splitlines()[:2]
        ['rate_hz = 50000.0', 'duration_s = 10.0']
        """
        import tomli_w  # noqa: PLC0415 - only provenance needs it

        return tomli_w.dumps(self.model_dump(mode="json", by_alias=True, exclude_none=True))

    @property
    def dynamics_or_default(self) -> Dynamics:
        """Declared masses and stiffnesses, or the defaults.

        Examples
        --------
        >>> from data_synth import load_scene
        >>> load_scene("demo").dynamics_or_default.housing_kg
        20.0
        """
        return self.dynamics or Dynamics()

    @cached_property
    def kinematics(self) -> Kinematics:
        """The solved kinematics of the gearbox, a `hums.gearbox.kinematics.Kinematics`.

        Examples
        --------
        >>> from data_synth import load_scene
        >>> load_scene("demo").kinematics.relative_speed("input", seen_from="housing")
        Fraction(1, 1)
        """
        return solve_kinematics(self.gearbox)

    @cached_property
    def orders(self) -> dict[tuple[str, str], Fraction | float]:
        """Defect orders by (component, kind): a Fraction if tooth numbers define it, otherwise a float.

        Examples
        --------
        In a bearing with 9 elements the orders of both races add up to 9:

        >>> from data_synth import load_scene
        >>> orders = load_scene("demo").orders
        >>> round(orders["input bearing", "inner_race"] + orders["input bearing", "outer_race"], 9)
        9.0
        """
        table = defect_orders(self.kinematics)
        return {
            (component, kind): exact if isinstance(exact, Fraction) else float(order)
            for component, kind, exact, order in zip(
                table["component"], table["kind"], table["exact"], table["order"], strict=True
            )
        }

    def exact_orders(self, kind: str) -> dict[str, Fraction]:
        """Return the non-zero orders of one kind that are defined by tooth numbers alone.

        Parameters
        ----------
        kind : str
            A kind of defect order: ``"shaft"``, ``"gear_mesh"``, ``"tooth"``, ...

        Returns
        -------
        dict of str to Fraction
            Orders by component, in cycles per revolution of the reference shaft.

        Examples
        --------
        >>> from data_synth import load_scene
        >>> load_scene("demo").exact_orders("gear_mesh")
        {'stage 1': Fraction(23, 1), 'stage 2': Fraction(437, 67)}
        """
        return {
            component: order
            for (component, row_kind), order in self.orders.items()
            if row_kind == kind and isinstance(order, Fraction) and order
        }

    def bearing(self, name: str) -> BearingOrders:
        """Return the kinematic orders of one bearing.

        Parameters
        ----------
        name : str
            Name of the bearing in the gearbox.

        Returns
        -------
        hums.gearbox.bearing_catalogue.BearingOrders

        Examples
        --------
        >>> from data_synth import load_scene
        >>> load_scene("demo").bearing("input bearing").elements
        9
        """
        return next(rates for rates in bearing_orders(self.kinematics) if rates.name == name)

    def components(self, fault_kind: str) -> list[str]:
        """Return the components that can have a fault of one kind.

        Parameters
        ----------
        fault_kind : str
            A kind of fault, as in ``[[fault]]`` of a scene file.

        Returns
        -------
        list of str

        Examples
        --------
        >>> from data_synth import load_scene
        >>> load_scene("demo").components("inner_race")
        ['input bearing', 'intermediate bearing']
        """
        row_kind = ROW_OF.get(fault_kind, fault_kind)
        return [component for component, kind in self.orders if kind == row_kind]

    def ratio(self, link: str) -> Fraction:
        """Return the signed speed ratio of a link to the reference shaft, both relative to the frame.

        Parameters
        ----------
        link : str
            A link of the gearbox.

        Returns
        -------
        Fraction
            Revolutions of the link per revolution of the reference shaft; negative for opposite rotation.

        Examples
        --------
        Gears of 23 and 67, then 19 and 61 teeth, each pair reversing the rotation:

        >>> from data_synth import load_scene
        >>> load_scene("demo").ratio("output")
        Fraction(437, 4087)
        """
        of_link, of_reference = (
            self.kinematics.relative_speed(name, seen_from=self.gearbox.frame)
            for name in (link, self.gearbox.reference or link)
        )
        return of_link / of_reference

    @property
    def samples(self) -> int:
        """Number of samples of each channel.

        Examples
        --------
        >>> from data_synth import load_scene
        >>> load_scene("demo").samples  # 10 s at 50 kHz
        500000
        """
        return max(1, round(self.duration_s * self.rate_hz))

    @property
    def truth_times(self) -> int:
        """Number of uniform instants of the truth: 20 per second and the last.

        If gears vibrate, steady motion and ramps have fewer, and changes of speed or torque more.

        Examples
        --------
        >>> from data_synth import load_scene
        >>> load_scene("demo").truth_times  # in 10 s
        201
        """
        return math.ceil(20 * self.duration_s - 1e-9) + 1


def declared_size_mm(scene: Scene, mesh: str, key: str) -> float | None:
    """Return a size of a mesh such as `face_width_mm`, from `dynamics.meshes` or the gearbox; None if undeclared."""
    own = getattr(scene.dynamics.mesh(mesh), key) if scene.dynamics is not None else None
    found = own if own is not None else getattr({each.name: each for each in scene.gearbox.meshes}[mesh], key)
    return None if found is None else float(found)


def _with_file(table: Any, path: Path) -> Any:  # noqa: ANN401
    """Return a table with the full path of its csv file, if that is in the folder of the scene."""
    if not isinstance(table, dict) or not isinstance(file := table.get("csv"), str):
        return table
    return table | {"csv": sibling_file(path, file)}


@checked
def load_scene(name_or_path: str | Path) -> Scene:
    """Load a scene from a TOML file, or from the catalogue by its name.

    Parameters
    ----------
    name_or_path : str or Path
        Path of a ``.toml`` file, or the name of a scene in the catalogue, such as ``"demo"``.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError
        With the key, its value, the bound and the remedy.

    Examples
    --------
    >>> from data_synth import load_scene
    >>> [fault.kind for fault in load_scene("demo").faults]
    ['tooth_crack', 'inner_race']
    """
    return Scene.from_toml(named_file(name_or_path, shipped=catalogue(), thing="scene", error=SceneError))


def catalogue() -> dict[str, Path]:
    """Return the scenes of the catalogue, files by name."""
    return shipped_files("data_synth")
