"""Imperfections of healthy machines: pitch deviations, planets, residual imbalance, waviness, sensor differences."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from data_synth.gears.quality import cumulative_pitch_m, runout_tolerance_m, single_pitch_tolerance_m
from data_synth.kinematic.gear_faults import SIDEBAND_CUTOFF, fold_negative_orders
from data_synth.kinematic.harmonics import HarmonicFamily, RotatingForce, shaft_fault_family
from data_synth.operation.shaft_angle import Array
from data_synth.scene.imperfections import GearQuality, Imperfections, RaceWaviness, ResidualImbalance
from data_synth.scene.random_streams import RandomStreams
from data_synth.scene.scene import Scene, SceneError, declared_size_mm
from data_synth.scene.sensors import STANDARD_GRAVITY, Mode
from hums.gearbox.components import Axis, Bearing, Mesh

_FINE = 8  # points per tooth at which the modulation by pitch deviations is evaluated


def imperfections_of(scene: Scene) -> Imperfections:
    """Return the declared imperfections of a scene, or an empty set."""
    return scene.imperfections or Imperfections()


def imperfect_families(
    scene: Scene, healthy: Sequence[HarmonicFamily], *, top_speed_hz: float, rng_for: RandomStreams
) -> list[HarmonicFamily]:
    """Return the families that the imperfections of a scene add to the healthy ones.

    Parameters
    ----------
    scene : Scene
    healthy : sequence of HarmonicFamily
    top_speed_hz : float
        Top speed of the reference shaft in rev s-1.
    rng_for : callable

    Raises
    ------
    SceneError
        Deviations of gears without a module, or a source with transfers to only some of the sensors.
    """
    declared = imperfections_of(scene)
    if declared.planets is not None:
        _check_planets(scene)
    families: list[HarmonicFamily] = []
    if declared.gears is not None and scene.fidelity == "kinematic":
        meshes = {family.component: family for family in healthy if family.kind == "gear_mesh"}
        for mesh in scene.gearbox.meshes:
            if mesh.name in meshes:
                families += _pitch_families(scene, declared.gears, mesh, meshes[mesh.name], rng_for=rng_for)
    if declared.imbalance is not None:
        families += _imbalance_families(scene, declared.imbalance, top_speed_hz=top_speed_hz, rng_for=rng_for)
    if declared.bearings is not None:
        families += _waviness_families(scene, declared.bearings, rng_for=rng_for)
    return families


# ---- Gears -----------------------------------------------------------------------------------------------------------


def gear_deviations_m(scene: Scene, mesh: Mesh, gear: int, *, instance: str, rng_for: RandomStreams) -> Array:
    """Draw the cumulative pitch deviations (teeth,) in m of gear 0 or 1 of a mesh along its pitch circle.

    `instance` is its link or copy of it. The deviations are zero if the scene declares none.

    Raises
    ------
    SceneError
        A grade without a module, or sizes outside the range of the standard.
    """
    quality, teeth = imperfections_of(scene).gears, abs(mesh.gears[gear].teeth)
    if quality is None:
        return np.zeros(teeth)
    runout_m, pitch_m = ((None if um is None else 1e-6 * um) for um in (quality.runout_um, quality.single_pitch_um))
    if runout_m is None or pitch_m is None:
        if mesh.kind is not None or mesh.pitch_angle_deg is not None:
            raise SceneError(
                f'imperfections.gears: mesh "{mesh.name}" has no cylindrical gears, to which ISO 1328-1 is limited; '
                "give runout_um and single_pitch_um."
            )
        module_m, transverse_m = _modules_m(scene, mesh)
        size = {"diameter_m": teeth * transverse_m, "module_m": module_m}
        try:
            runout_m = runout_tolerance_m(**size, grade=quality.grade) if runout_m is None else runout_m
            pitch_m = single_pitch_tolerance_m(**size, grade=quality.grade) if pitch_m is None else pitch_m
        except ValueError as caught:
            raise SceneError(f'imperfections.gears, mesh "{mesh.name}": {caught}') from None
    rng = rng_for("imperfection", "pitch", mesh.name, instance)
    return cumulative_pitch_m(teeth=teeth, runout_m=runout_m, single_pitch_m=pitch_m, rng=rng)


def _modules_m(scene: Scene, mesh: Mesh) -> tuple[float, float]:
    module_mm = declared_size_mm(scene, mesh.name, "module_mm")
    if module_mm is None:
        raise SceneError(
            f'imperfections need the module of mesh "{mesh.name}"; declare module_mm in the gearbox or in '
            "dynamics.meshes."
        )
    return 1e-3 * module_mm, 1e-3 * module_mm / math.cos(math.radians(mesh.helix_angle_deg or 0.0))


def _pitch_families(
    scene: Scene, quality: GearQuality, mesh: Mesh, family: HarmonicFamily, *, rng_for: RandomStreams
) -> Iterator[HarmonicFamily]:
    """Yield the sidebands due to the deviations of each gear of a mesh; all planets share those of one."""
    _, transverse_m = _modules_m(scene, mesh)
    for number, gear in enumerate(mesh.gears):
        yield pitch_family(
            family,
            component=f"{mesh.name}/{gear.link}",
            cumulative_m=gear_deviations_m(scene, mesh, number, instance=gear.link, rng_for=rng_for),
            pitch_m=math.pi * transverse_m,
            deflection_m=1e-6 * quality.deflection_um,
        )


def pitch_family(
    mesh: HarmonicFamily, *, component: str, cumulative_m: Array, pitch_m: float, deflection_m: float
) -> HarmonicFamily:
    """Return the sidebands that the pitch deviations of a gear add to its mesh, at multiples of its rotation.

    Harmonic h of the mesh is multiplied by ``(1 + f / deflection) exp(-2j pi h F / pitch)``, with F the cumulative and
    f the single pitch deviation in mesh: a tooth displaced by a fraction of the pitch is late by that fraction of a
    cycle. Both are band-limited between teeth.

    Parameters
    ----------
    mesh : HarmonicFamily
        The healthy mesh, with coefficients (k,).
    component : str
        The gear.
    cumulative_m : (teeth,) array
        Cumulative pitch deviations along the pitch circle in m.
    pitch_m : float
        Transverse pitch in m.
    deflection_m : float
        Deflection of loaded teeth in m.
    """
    teeth = cumulative_m.size
    points = _FINE * teeth
    cumulative, single = (
        _between_teeth(values, points) for values in (cumulative_m, cumulative_m - np.roll(cumulative_m, 1))
    )
    harmonics = np.arange(1, mesh.coefficients.shape[0] + 1)
    changed = (1 + single / deflection_m) * np.exp(-2j * np.pi * np.outer(harmonics, cumulative / pitch_m)) - 1
    sidebands = np.arange(-teeth + 1, teeth)
    lines = mesh.coefficients[:, None] * (np.fft.fft(changed, axis=1) / points)[:, sidebands]
    kept = np.abs(lines) >= SIDEBAND_CUTOFF * np.max(np.abs(lines))
    kept &= np.abs(lines) > 0
    multiples = teeth * harmonics[:, None] + sidebands
    return replace(
        mesh,
        component=component,
        kind="pitch_deviation",
        base_order=mesh.base_order / teeth,
        coefficients=fold_negative_orders(multiples[kept], lines[kept][:, None])[:, 0],
    )


def _between_teeth(values: Array, points: int) -> Array:
    """Return the band-limited function through a value at each tooth (teeth,), at `points` angles per revolution."""
    spectrum = np.fft.rfft(values)
    if values.size % 2 == 0:
        spectrum[-1] /= 2  # it stands for both signs in the longer transform
    return np.asarray(np.fft.irfft(spectrum, points) * (points / values.size))


# ---- Planets ---------------------------------------------------------------------------------------------------------


def planet_displacements_m(scene: Scene, axis: Axis, *, rng_for: RandomStreams) -> Array:
    """Draw the tangential displacements (planets,) in m of planets on their carrier; zero if none are declared."""
    declared, planets = imperfections_of(scene).planets, axis.copies or 1
    if declared is None:
        return np.zeros(planets)
    drawn = rng_for("imperfection", "planet positions", axis.name).standard_normal(planets)
    return np.asarray(1e-6 * declared.position_um * drawn)


def carrier_radius_m(scene: Scene, ring_mesh: Mesh) -> float:
    """Return the radius in m of the circle of planets that mesh with a ring, ``m (z_ring - z_planet) / 2``."""
    _, transverse_m = _modules_m(scene, ring_mesh)
    return transverse_m * (max(teeth := [abs(gear.teeth) for gear in ring_mesh.gears]) - min(teeth)) / 2


def planet_loads(scene: Scene, axis: Axis, *, rng_for: RandomStreams) -> Array:
    """Draw the relative load of each planet, (planets,); ones if no unequal planets are declared."""
    declared, planets = imperfections_of(scene).planets, axis.copies or 1
    if declared is None or planets == 1:
        return np.ones(planets)
    drawn = rng_for("imperfection", "planet loads", axis.name).standard_normal(planets)
    return np.asarray(1 + declared.load_std * (drawn - np.mean(drawn)) / np.std(drawn))


def _check_planets(scene: Scene) -> None:
    """Raise SceneError for unequal planets without any effect."""
    if not scene.gearbox.copied:
        raise SceneError(f'imperfections.planets: gearbox "{scene.gearbox.name}" has no planets; leave it out.')
    if scene.fidelity == "kinematic" and scene.planet_pass is None:
        raise SceneError(
            "imperfections.planets: without planet_pass all planets of a kinematic scene have the same path; "
            "add planet_pass = { half_width_deg = 40 }, or leave it out."
        )


# ---- Shafts and bearings ---------------------------------------------------------------------------------------------


def _imbalance_families(
    scene: Scene, declared: ResidualImbalance, *, top_speed_hz: float, rng_for: RandomStreams
) -> Iterator[HarmonicFamily]:
    shafts, each_kg = scene.exact_orders("shaft"), declared.rotor_kg
    masses = dict.fromkeys(shafts, each_kg) if isinstance(each_kg, float) else dict(each_kg)
    if {*masses} != {*shafts}:
        raise SceneError(
            f"imperfections.imbalance.rotor_kg names {', '.join(sorted(masses))}, but the shafts are "
            f"{', '.join(shafts)}; give the mass of each, or one number for all."
        )
    rated_hz = top_speed_hz if declared.rated_rpm is None else declared.rated_rpm / 60
    for shaft, order in shafts.items():
        yield imbalance_family(
            scene,
            shaft,
            mass_kg=masses[shaft],
            eccentricity_m=1e-3 * declared.grade / (2 * math.pi * float(order) * rated_hz),
            top_speed_hz=top_speed_hz,
            offset=float(rng_for("imperfection", "imbalance", shaft).random()),
        )


def imbalance_family(
    scene: Scene,
    shaft: str,
    *,
    mass_kg: float,
    eccentricity_m: ArrayLike,
    top_speed_hz: float,
    offset: float,
) -> HarmonicFamily:
    """Return the line of a shaft imbalance, a force that rotates with the shaft.

    Parameters
    ----------
    scene : Scene
    shaft : str
    mass_kg : float
    eccentricity_m : float or (instant,) array
    top_speed_hz : float
        Top speed of the reference shaft in the record, in rev s-1.
    offset : float
        Angle of the heavy side at revolution zero, in revolutions.
    """
    order = scene.exact_orders("shaft")[shaft]
    per_m = mass_kg * (2 * math.pi * (float(order) * top_speed_hz)) ** 2
    family = shaft_fault_family(
        "imbalance",
        component=shaft,
        order=order,
        amplitude=amplitude_of_force(scene, shaft, per_m) * np.asarray(eccentricity_m),
        reference_speed_hz=top_speed_hz,
        offset=offset,
    )
    return replace(family, force=_rotating_force(scene, shaft, sense=float(scene.ratio(shaft))))


def _waviness_families(scene: Scene, declared: RaceWaviness, *, rng_for: RandomStreams) -> Iterator[HarmonicFamily]:
    held = {name: each for each in scene.gearbox.bearings for name in each.names}
    for bearing, each in held.items():
        rates, rng = scene.bearing(bearing), rng_for("imperfection", "waviness", bearing)
        turning = _turning_ring(scene, each)
        sense = float(scene.ratio(turning))
        for number in range(1, declared.harmonics + 1):
            turned = abs(rates.inner_ring)
            orders = (number * rates.outer_race, number * rates.inner_race - turned, number * rates.inner_race + turned)
            senses = (sense, -sense, sense)  # n Z + 1 lobes of the outer race, n Z - 1 and n Z + 1 of the inner one
            force_n = 1e-6 * declared.waviness_um / number * declared.stiffness_n_m
            amplitude = amplitude_of_force(scene, bearing, force_n)
            for order, way, turn in zip(orders, senses, rng.random(len(orders)), strict=True):
                if order > 0:
                    yield HarmonicFamily(
                        component=bearing,
                        kind="waviness",
                        source=bearing,
                        base_order=Fraction(order),
                        coefficients=np.array([amplitude * np.exp(2j * np.pi * turn)]),
                        load_dependent=False,
                        force=_rotating_force(scene, turning, sense=way),
                    )


def _turning_ring(scene: Scene, bearing: Bearing) -> str:
    bodies = scene.kinematics.bodies
    return next(link for link in scene.gearbox.ring_links(bearing) if bodies[link] != bodies[str(scene.gearbox.frame)])


def _rotating_force(scene: Scene, link: str, *, sense: float) -> RotatingForce:
    kinematics = scene.kinematics
    axis = kinematics.mechanism.directions[kinematics.joints[kinematics.bodies[link]].axis]
    return RotatingForce.across(link, axis=np.array(axis), sense=sense)


def in_units(scene: Scene, acceleration_m_s2: float) -> float:
    """Return an acceleration in the units of the sensors of a scene."""
    return acceleration_m_s2 / (STANDARD_GRAVITY if scene.sensors[0].units == "g" else 1.0)


def amplitude_of_force(scene: Scene, source: str, force_n: float) -> float:
    """Return the amplitude of a force at its source: divided by the housing mass, or itself if transfers are declared.

    Raises
    ------
    SceneError
        Transfers to only some of the sensors.
    """
    reached = {transfer.sensor for transfer in scene.transfers if transfer.source == source}
    if not reached:
        return in_units(scene, force_n / scene.dynamics_or_default.housing_kg)
    if missing := [sensor.name for sensor in scene.sensors if sensor.name not in reached]:
        raise SceneError(
            f'imperfections: "{source}" has a transfer to "{min(reached)}" but none to "{missing[0]}", where the '
            "response to its force is undefined; declare both or neither."
        )
    return force_n


# ---- Sensors ---------------------------------------------------------------------------------------------------------


def with_drawn_sensors(scene: Scene, *, rng_for: RandomStreams) -> Scene:
    """Return a scene whose sensors have the gains and mounting resonances drawn by its imperfections."""
    declared = imperfections_of(scene)
    if declared.gains is None and declared.mounts is None:
        return scene
    sensors = []
    for sensor in scene.sensors:
        drawn: dict[str, object] = {}
        if declared.gains is not None:
            error_db = declared.gains.std_db * rng_for("imperfection", "gain", sensor.name).standard_normal()
            drawn["gain"] = (sensor.gain or 1.0) * 10 ** (float(error_db) / 20)
        if declared.mounts is not None and sensor.resonance is None:
            spread = declared.mounts.spread * rng_for("imperfection", "mount", sensor.name).standard_normal()
            drawn["resonance"] = Mode(
                frequency_hz=declared.mounts.frequency_hz * math.exp(float(spread)),
                damping_ratio=declared.mounts.damping_ratio,
            )
        sensors.append(sensor.changed(**drawn))
    return scene.model_copy(update={"sensors": tuple(sensors)})
