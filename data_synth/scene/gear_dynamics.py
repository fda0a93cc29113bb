"""Masses, stiffnesses and the structure between gears and sensors, as declared in a scene whose gears vibrate.

A kinematic scene needs none of these. Values left out have the defaults below, or those of
`data_synth.dynamics.assembly`, a first estimate in steel from module and face width.
"""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from data_synth.gears.lost_contact import FlankModification, closed_cycles
from data_synth.scene.operation import ByName, Finite, Knots, NotNegative, Share, csv_rows
from data_synth.scene.sensors import Mode
from hums.gearbox.components import Declared, Name, Positive

_NUMBERS_OF_SHAPE = {
    "trapezoid": ("contact_ratio",),
    "rectangular": ("step_n_m", "contact_ratio"),
    "fourier": ("harmonics_n_m",),
}


class LinkDynamics(Declared):
    """Mass of a link with everything mounted on it, and its moment of inertia about the axis."""

    mass_kg: Positive | None = None
    inertia_kg_m2: Positive | None = None


class MeshDynamics(Declared):
    """Stiffness and errors of a mesh.

    Geometry may be declared here if the gearbox leaves it out. `stiffness_n_m` is the mean mesh stiffness along the
    line of action and `shape` its variation over a mesh cycle: from the strain energy of the teeth (spur gears without
    undercut or profile shift, whose bodies are clamped at 0.4 of the reference radius), trapezoidal according to the
    contact ratio, rectangular, a Fourier series, or constant. The default is `teeth` if the geometry permits, otherwise
    `trapezoid`. `backlash_um` is the backlash along the line of action (default: the minimum recommended by ISO/TR
    10064-2; with 0, teeth pull as well as push). `error_um` is the amplitude of the first mesh harmonic of the
    transmission error, `friction_coefficient` that of sliding between the flanks (external gears on parallel axes).
    `transmission_error` is a measured one, [[mesh cycles, um], ...] starting at 0, linear in between and repeating
    after the last row; ``csv`` is the same in a file. Positive values let the gears approach.

    Flanks are involutes except for `tip_relief_um` of both gears, linear over `tip_relief_pitches` base pitches of the
    path of contact (default: from the highest point of single-tooth contact), and `crowning_um`, the relief at both
    ends of the face. Their effect on stiffness and transmission error follows from the mean static force.

    A rectangular stiffness is high for the fractional part of `contact_ratio` (default: that of the geometry) of each
    cycle, and lower by `step_n_m` for the rest (default: the stiffness of one of `contact_ratio` equal tooth pairs).
    A Fourier series is ``c cos + s sin`` of each mesh harmonic, `harmonics_n_m` = [[c, s], ...], peak values in N/m.
    """

    module_mm: Positive | None = None
    face_width_mm: Positive | None = None
    pressure_angle_deg: Positive | None = None
    profile_shift: tuple[float, float] | None = None
    shape: Literal["teeth", "trapezoid", "rectangular", "fourier", "constant"] | None = None
    stiffness_n_m: Positive | None = None
    step_n_m: Positive | None = None
    contact_ratio: Annotated[float, Field(gt=1)] | None = None
    harmonics_n_m: Annotated[tuple[tuple[Finite, Finite], ...], Field(min_length=1)] | None = None
    backlash_um: NotNegative | None = None
    error_um: NotNegative = 0.0
    transmission_error: Annotated[Knots, AfterValidator(closed_cycles)] | None = None
    tip_relief_um: NotNegative = 0.0
    tip_relief_pitches: Positive | None = None
    crowning_um: NotNegative = 0.0
    friction_coefficient: Annotated[float, Field(ge=0, lt=1)] = 0.0

    @model_validator(mode="before")
    @classmethod
    def _read(cls, table: Any) -> Any:  # noqa: ANN401
        if not isinstance(table, dict) or "csv" not in table:
            return table
        read = {"transmission_error": csv_rows(Path(table["csv"]), "mesh cycles", "um")}
        return {key: item for key, item in table.items() if key != "csv"} | read

    @property
    def modification(self) -> FlankModification | None:
        """Deviation of the flanks from involutes; None if there is none."""
        if not self.tip_relief_um and not self.crowning_um:
            return None
        relief_m, crowning_m = 1e-6 * self.tip_relief_um, 1e-6 * self.crowning_um
        return FlankModification(relief_tip_m=relief_m, relief_pitches=self.tip_relief_pitches, crowning_m=crowning_m)

    @model_validator(mode="after")
    def _check_shape(self) -> Self:
        """Refuse numbers without effect on the shape, and a Fourier series without lines."""
        if self.shape == "fourier" and self.harmonics_n_m is None:
            raise ValueError('shape = "fourier" needs harmonics_n_m = [[c, s], ...]')
        used = _NUMBERS_OF_SHAPE.get(self.shape or "", ())
        for key in ("step_n_m", "contact_ratio", "harmonics_n_m"):
            value = getattr(self, key)
            if value is not None and key not in used:
                shown = f"{value:g}" if isinstance(value, float) else value
                shape = f'shape = "{self.shape}"' if self.shape else "no shape"
                raise ValueError(f"{key} = {shown} has no effect with {shape}; leave it out, or choose another shape")
        return self


class SupportDynamics(Declared):
    """Support stiffness of a bearing, or of a link without one; `damping_s` is the ratio of damping to stiffness.

    A ring gear rigid with the housing becomes a separate body if it is named here, with the torsional stiffness
    `torsion_nm_rad`.
    """

    radial_n_m: Positive = 1e8
    axial_n_m: Positive = 1e8
    tilt_nm_rad: Positive = 1e5
    torsion_nm_rad: NotNegative = 0.0
    damping_s: NotNegative = 0.0


class ShaftDynamics(Declared):
    """A round steel shaft that bends between two bearings of a link, `to_bearings_mm` on either side of its gears."""

    diameter_mm: Positive
    bore_mm: NotNegative = 0.0
    to_bearings_mm: tuple[Positive, Positive]

    @model_validator(mode="after")
    def _check_bore(self) -> Self:
        if self.bore_mm >= self.diameter_mm:
            raise ValueError(f"bore_mm = {self.bore_mm:g} must be below diameter_mm = {self.diameter_mm:g}; reduce it")
        return self


class SensorWeights(Declared):
    """Weights of the bearing forces of each link at a sensor: 1 is the response of the rigid housing."""

    sensor: Name
    links: ByName[NotNegative]


class Dynamics(Declared):
    """Masses, stiffnesses, and the structure between bearings and sensors.

    A link in `shafts` bends between two bearings, each with the radial stiffness declared for that link in `bearings`.
    Bearing forces move a housing of `housing_kg` on its `mounts`: below `rigid_below_hz` as a rigid body, so that
    balanced internal forces do not move it. Above, a sensor responds fully to the bearing forces of its own link (both
    links of a mesh), and with the weight `elsewhere` to those of others, unless `sensor_weights` states them; the
    response then passes through the `path` of the scene. Every mode of the gears has `damping_ratio`, to which the
    damping of bearings and meshes is added; it may be 0 in a run-up. The torque of the scene acts on its link, or on
    `load_on` if that link is the reference; the reference shaft drives. The mesh phase follows the shafts, or with
    `mesh_rpm` a reference shaft at that constant speed, as in papers with ``k(Omega t)``.

    `error` is the relative RMS error of the channels permitted for time stepping. With ``fidelity = "auto"`` the linear
    response may differ from the motion in time by up to `floor_db`.
    """

    links: ByName[LinkDynamics] = ()
    meshes: ByName[MeshDynamics] = ()
    bearings: ByName[SupportDynamics] = ()
    shafts: ByName[ShaftDynamics] = ()
    damping_ratio: Annotated[float, Field(ge=0, lt=1)] = 0.03
    mesh_rpm: Positive | None = None
    load_on: Name | None = None
    housing_kg: Positive = 20.0
    mounts: Mode = Mode(frequency_hz=20.0, damping_ratio=0.2)
    rigid_below_hz: Positive = 200.0
    elsewhere: Share = 0.3
    sensor_weights: tuple[SensorWeights, ...] = ()
    error: Annotated[float, Field(gt=0, lt=0.1)] = 1e-3
    floor_db: Annotated[float, Field(lt=0)] = -40.0

    def mesh(self, name: str) -> MeshDynamics:
        """Return the declared values of a mesh, or the defaults."""
        return dict(self.meshes).get(name, MeshDynamics())
