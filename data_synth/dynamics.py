"""What a scene declares of masses, stiffnesses and the way to its sensors, where its gears vibrate.

A kinematic scene needs none of it. Whatever is left out has the defaults of `data_synth.assembly`, a first guess in
steel from module and face width, or those below.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainSerializer

from data_synth.chain import Mode
from data_synth.driving import NotNegative, Share
from hums.gearbox import Declared, Name, Positive


def _pairs(value: Any) -> Any:  # noqa: ANN401
    return tuple(value.items()) if isinstance(value, Mapping) else value


class LinkDynamics(Declared):
    """Mass, and moment of inertia about the axis, of a link with everything on it."""

    mass_kg: Positive | None = None
    inertia_kg_m2: Positive | None = None


class MeshDynamics(Declared):
    """The teeth of a mesh.

    Geometry may be declared here where the gearbox leaves it out. `stiffness_n_m` is the mean along the line of action;
    `shape` how it varies in a cycle: with the strain energy of the teeth (straight ones without undercut or profile
    shift, held at `bore_share` of their reference radius), as a trapezoid by the contact ratio, or not at all. Left
    out, it is the first of these that the teeth allow. `error_um` is the amplitude of the first mesh harmonic of the
    transmission error; `fidelity` that of this stage, where it is lower than the scene's.
    """

    module_mm: Positive | None = None
    face_width_mm: Positive | None = None
    pressure_angle_deg: Positive | None = None
    profile_shift: tuple[float, float] | None = None
    shape: Literal["teeth", "trapezoid", "constant"] | None = None
    stiffness_n_m: Positive | None = None
    damping_n_s_m: NotNegative = 0.0
    backlash_um: NotNegative = 0.0
    error_um: NotNegative = 0.0
    bore_share: Annotated[float, Field(gt=0, lt=0.8)] = 0.4
    fidelity: Literal["kinematic", "torsional", "lateral", "full"] | None = None


class SupportDynamics(Declared):
    """How a bearing, or a link without one, is held; `damping_s` is damping over stiffness.

    A ring that is rigid with the housing becomes a body of its own where it is named here, `torsion_nm_rad` against
    turning.
    """

    radial_n_m: Positive = 1e8
    axial_n_m: Positive = 1e8
    tilt_nm_rad: Positive = 1e5
    torsion_nm_rad: NotNegative = 0.0
    damping_s: NotNegative = 0.0


Links = Annotated[tuple[tuple[Name, LinkDynamics], ...], BeforeValidator(_pairs), PlainSerializer(dict)]
Meshes = Annotated[tuple[tuple[Name, MeshDynamics], ...], BeforeValidator(_pairs), PlainSerializer(dict)]
Supports = Annotated[tuple[tuple[Name, SupportDynamics], ...], BeforeValidator(_pairs), PlainSerializer(dict)]
Weights = Annotated[tuple[tuple[Name, NotNegative], ...], BeforeValidator(_pairs), PlainSerializer(dict)]


class Hearing(Declared):
    """How loud a sensor hears the bearings of each link: 1 is as the rigid housing moves under their force."""

    sensor: Name
    links: Weights


class Dynamics(Declared):
    """Masses, stiffnesses, and what is between bearings and sensors.

    Bearing forces move a housing of `housing_kg` on its `mounts`. A sensor hears those of the link it stands on (both
    links of a mesh) in full and those of others `elsewhere` as loud, unless `hearing` says how loud; then they pass the
    scene's `path`. Every mode of the gears has `damping_ratio`, to which what bearings and meshes declare is added.
    The scene's torque acts on its link, or on `load_on` where that is the reference itself; the reference drives.

    `error` is the relative RMS error of the channels that steps in time may make. ``fidelity = "auto"`` allows
    differences up to `floor_db` from the full motion, found on the first `decide_s` of the scene.
    """

    links: Links = ()
    meshes: Meshes = ()
    bearings: Supports = ()
    damping_ratio: Annotated[float, Field(gt=0, lt=1)] = 0.03
    load_on: Name | None = None
    housing_kg: Positive = 20.0
    mounts: Mode = Mode(frequency_hz=20.0, damping_ratio=0.2)
    elsewhere: Share = 0.3
    hearing: tuple[Hearing, ...] = ()
    error: Annotated[float, Field(gt=0, lt=0.1)] = 1e-3
    floor_db: Annotated[float, Field(lt=0)] = -40.0
    decide_s: Positive = 0.25

    def mesh(self, name: str) -> MeshDynamics:
        """Return what is declared of a mesh, or the defaults."""
        return dict(self.meshes).get(name, MeshDynamics())
