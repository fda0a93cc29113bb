"""How the gears of a scene vibrate: the assembled system, what drives it, and what its bearings do to the sensors.

Whatever the fidelity, the gearbox is assembled in the plane or in space, and motions that a fidelity lacks are held.
Bearings feel the springs of the motions that are left, and the mesh forces along those that are held, as in statics:
so the force of a stiff bearing is the same at every fidelity.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from data_synth.assembly import Holding, Inertia, assemble
from data_synth.hearing import forces_on_sensors
from data_synth.housing import AHEAD, Housing
from data_synth.integrate import Accuracy, IntegrationError, Load, Output, Problem, Splitting, Steps
from data_synth.layout import contacts_of
from data_synth.mechanics import Array, System
from data_synth.mesh import Constant
from data_synth.meshing import Gears, Teeth, declared_of, geared, gears_of, passes_s
from data_synth.modal import mode_pairs, places, with_modal_damping
from data_synth.scene import Scene, SceneError, Sensor
from data_synth.stage import Stage
from hums.kinematics import Kinematics

LEVELS = ("torsional", "lateral", "full")
_KEPT = {"torsional": ("rotation",), "lateral": ("x", "y", "rotation")}
_BLOCK = 8192
_TRIAL = 4096
_MOST_DENSE = 8


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Gears ready to run.

    Attributes
    ----------
    system : System
    load : Load
    output : Output
        A force in N for each sensor: what moves the housing as it hears it.
    teeth : mapping of mesh to Teeth
    denser : int
        How many times as densely as the channels the force is sampled, before path and chain: fast modes ring, and
        mesh forces jump, beyond what the channels' rate can tell apart. Lines that fold back from jumps are about
        1/h of the jump, h the first mesh harmonic beyond that rate.
    settle_s : float
        How long the motion runs before time zero, so that what is left of its start is less than the error.
    error : float
        Relative RMS error of the forces that steps may make.
    """

    stage: Stage
    system: System
    load: Load
    output: Output
    teeth: Mapping[str, Teeth] = field(repr=False)
    denser: int
    settle_s: float
    error: float

    def channels(self, *, samples: int) -> Iterator[Array]:
        """Yield the channels (sensor, n) from time zero in blocks, behind the linear part of their chains.

        Raises
        ------
        SceneError
            Where the motion cannot be integrated.
        """
        from data_synth.integrate import integrate_blocks  # noqa: PLC0415

        scene = self.stage.scene
        early = math.ceil(self.settle_s * scene.rate_hz)
        housings = [self.housing(sensor) for sensor in scene.sensors]
        last = (early + samples - 1) * self.denser + AHEAD
        problem = self._problem(-early / scene.rate_hz, last / self.output.rate_hz)
        steps = Steps(per_sample=self.steps())
        dropped = early * self.denser + AHEAD
        try:
            for block in integrate_blocks(
                problem, method=Splitting(), output=self.output, tolerance=steps, block=_BLOCK
            ):
                heard = np.stack(
                    [way.push(np.ascontiguousarray(f)) for way, f in zip(housings, block.values.T, strict=True)]
                )
                count = heard.shape[1]
                if dropped < count:
                    yield heard[:, dropped :: self.denser]
                dropped = dropped - count if dropped >= count else (dropped - count) % self.denser
        except IntegrationError as caught:
            raise SceneError(f"the gears cannot be followed in time: {caught}") from None

    def steps(self) -> int:
        """Return how many steps to a sample keep the error, judged on 4096 from a standstill at time zero."""
        from data_synth.integrate import integrate  # noqa: PLC0415

        scene = self.stage.scene
        try:
            return (
                integrate(
                    self._problem(0.0, max(1, min(scene.samples - 1, _TRIAL)) / scene.rate_hz),
                    method=Splitting(),
                    output=self.output,
                    tolerance=Accuracy(relative=self.error, trial=1.0),
                )
                .checked()
                .steps_per_sample
            )
        except IntegrationError as caught:
            raise SceneError(f"the gears cannot be followed in time: {caught}") from None

    def housing(self, sensor: Sensor) -> Housing:
        """Return the way from force to channel of a sensor, at rest."""
        scene, declared = self.stage.scene, declared_of(self.stage.scene)
        return Housing(
            mass_kg=declared.housing_kg,
            mounts=declared.mounts,
            path=scene.path,
            sensor=sensor,
            rate_hz=self.output.rate_hz,
        )

    def _problem(self, start_s: float, duration_s: float) -> Problem:
        from data_synth.integrate.assembled import assemble as assembled  # noqa: PLC0415
        from data_synth.integrate.shooting import equilibrium  # noqa: PLC0415

        drive, load = self.stage.drive, self.load
        if load.varying is not None:
            first = load.varying(np.array([start_s]))[0]
            varying = load.varying
            load = Load(constant=first, varying=lambda times_s: varying(times_s) - first)
        problem = Problem(system=self.system, turning=drive.angle, load=load, duration_s=duration_s, start_s=start_s)
        # the equilibrium is that of mean stiffnesses
        at_rest = tuple(replace(m, stiffness=Constant(mean=m.stiffness.mean), error=None) for m in self.system.meshes)
        ready = assembled(replace(problem, system=replace(self.system, meshes=at_rest)))
        return replace(problem, start=ready.physical(equilibrium(ready)))


def prepared(stage: Stage) -> Gears:
    """Return the gears of a scene, for `motion_of`.

    Raises
    ------
    SceneError
        For what does not vibrate yet: planets, axes that cross, a run-up; and for what is missing.
    """
    kinematics = geared(stage.scene)
    refuse_unfit(stage.scene, kinematics)
    return gears_of(stage, kinematics)


def motion_of(stage: Stage, gears: Gears, *, levels: Mapping[str, str], springs: Collection[str] = ()) -> Motion:
    """Return the motion of a scene's gears.

    Parameters
    ----------
    stage : Stage
    gears : Gears
    levels : mapping of mesh to "torsional", "lateral" or "full"
        A body has the motions of the highest of its meshes.
    springs : collection of mesh
        Whose teeth are but a spring of their mean stiffness.

    Raises
    ------
    SceneError
        What `data_synth.assembly.assemble` refuses, and a torque or a sensor that is out of place.
    """
    scene, kinematics, teeth = stage.scene, gears.kinematics, gears.teeth
    properties = {name: item.properties for name, item in teeth.items()}
    for name in springs:
        mean = properties[name].stiffness
        assert mean is not None  # noqa: S101 - teeth_of gives each mesh one
        properties[name] = replace(properties[name], stiffness=Constant(mean=mean.mean), error=None)
    declared = declared_of(scene)
    space = "full" in levels.values()
    try:
        whole = assemble(
            kinematics,
            motions="space" if space else "plane",
            inertias={
                name: Inertia(mass_kg=item.mass_kg, inertia_kgm2=item.inertia_kg_m2) for name, item in declared.links
            },
            supports={
                name: Holding(
                    radial=item.radial_n_m, axial=item.axial_n_m, tilt=item.tilt_nm_rad, damping_s=item.damping_s
                )
                for name, item in declared.bearings
            },
            meshes=properties,
            speed_rad_s=2 * math.pi * float(np.mean(stage.speed_hz)) if space else 0.0,
        )
    except ValueError as caught:
        raise SceneError(f"dynamics: {caught}") from None
    kept = _kept(kinematics, whole, levels)
    system = _held(whole, kept)
    damped = with_modal_damping(system, ratio=declared.damping_ratio)
    angular, _ = mode_pairs(system, [mesh.stiffness.mean for mesh in system.meshes])
    slowest = min(
        declared.damping_ratio * float(np.min(angular[angular > 0], initial=np.inf)),
        2 * math.pi * declared.mounts.frequency_hz * declared.mounts.damping_ratio,
    )
    output = forces_on_sensors(scene, kinematics, whole, kept)
    denser = 1
    if output.mesh_force is not None:
        denser = _MOST_DENSE if any(mesh.stiffness.jumps for mesh in system.meshes) else 2
    while denser < _MOST_DENSE and np.max(angular) / (2 * math.pi) > denser * scene.rate_hz / 4:
        denser *= 2
    return Motion(
        stage=stage,
        system=replace(damped, damping=damped.damping + system.damping),
        load=_load(stage, kinematics, system),
        output=replace(output, rate_hz=denser * scene.rate_hz),
        teeth=teeth,
        denser=denser,
        settle_s=math.log(1 / declared.error) / slowest,
        error=declared.error,
    )


def refuse_unfit(scene: Scene, kinematics: Kinematics) -> None:
    """Raise SceneError for a scene whose gears cannot vibrate here, and say what to do."""
    what = f'fidelity = "{scene.fidelity}"'
    kinematic = 'write fidelity = "kinematic"'
    frame = kinematics.mechanism.frame
    if any(joint.carried_by != frame for joint in kinematics.joints.values()):
        raise SceneError(
            f"{what}: bearings of planets turn with their carrier, and have no way to a sensor yet; {kinematic}."
        )
    if scene.speed.run_up is not None:
        raise SceneError(f"{what}: gears need a speed before time zero to settle; give speed.rpm, or {kinematic}.")
    if scene.torque is None:
        raise SceneError(f"{what}: teeth that carry nothing stay silent; add torque = {{ link = ..., nm = ... }}.")
    for name, value in (("sampling_jitter", scene.sampling_jitter), ("planet_pass", scene.planet_pass)):
        if value is not None:
            raise SceneError(f"{what} has no {name}; leave it out, or {kinematic}.")
    for sensor in scene.sensors:
        if sensor.direction is None:
            raise SceneError(f'{what}: sensor "{sensor.name}" needs a direction, as [x, y, z] across the shafts.')
        if sensor.cross_axis is not None:
            raise SceneError(f'{what}: sensor "{sensor.name}" has cross_axis; turn its direction instead.')


def fault_passes(motion: Motion) -> dict[int, tuple[Array, float]]:
    """Return, for each fault of teeth, when its tooth is in the middle of its mesh, s, and half a pass, rev."""
    scene = motion.stage.scene
    last_s = (scene.samples - 1) / scene.rate_hz
    cycles = {mesh.name: mesh.cycles_per_rev for mesh in motion.system.meshes}
    return {
        number: (times_s, half_rev)
        for name, teeth in motion.teeth.items()
        for number, times_s, half_rev in passes_s(motion.stage, teeth, cycles_per_rev=cycles[name], stop_s=last_s)
    }


# ---- which motions are held ----------------------------------------------------------------------------------


def _kept(kinematics: Kinematics, whole: System, levels: Mapping[str, str]) -> Array:
    """Return the numbers of the degrees of freedom that move, (k,)."""
    highest: dict[str, int] = {}
    for contact in contacts_of(kinematics, {}):
        for link in contact.links:
            body = kinematics.bodies[link]
            highest[body] = max(highest.get(body, 0), LEVELS.index(levels[contact.mesh]))
    numbers = []
    for number, (body, motion) in enumerate(places(whole)):
        kept = _KEPT.get(LEVELS[highest.get(body, 0)])
        if kept is None or motion in kept:
            numbers.append(number)
    return np.array(numbers)


def _held(whole: System, kept: Array) -> System:
    """Return a system without the motions that are held."""
    square = np.ix_(kept, kept)
    gyroscopic = None if whole.gyroscopic is None else whole.gyroscopic[square]
    return System(
        mass=whole.mass[square],
        damping=whole.damping[square],
        stiffness=whole.stiffness[square],
        gyroscopic=gyroscopic if gyroscopic is not None and gyroscopic.any() else None,
        meshes=tuple(replace(mesh, direction=mesh.direction[kept]) for mesh in whole.meshes),
        names=tuple(whole.names[number] for number in kept),
        springs=tuple(
            replace(spring, direction=spring.direction[kept])
            for spring in whole.springs
            if spring.direction[kept].any()
        ),
    )


# ---- what drives ---------------------------------------------------------------------------


def _load(stage: Stage, kinematics: Kinematics, system: System) -> Load:
    """Return the torque on the load, and what the drive brings for it."""
    scene, torque = stage.scene, stage.drive.torque
    declared = declared_of(scene)
    assert torque is not None and scene.torque is not None  # noqa: S101, PT018 - refuse_unfit
    bodies = kinematics.bodies
    drives = bodies[str(scene.gearbox.reference)]
    loaded = declared.load_on or scene.torque.link
    if loaded not in bodies or bodies[loaded] in (drives, kinematics.mechanism.frame):
        raise SceneError(
            f'torque acts on "{scene.torque.link}", and the reference "{scene.gearbox.reference}" drives; name the '
            "link that takes the power out as dynamics.load_on."
        )
    rates = {link: float(scene.ratio(link)) for link in (drives, loaded, scene.torque.link)}
    # the same power, wherever a torque is counted
    share = abs(rates[scene.torque.link] / rates[loaded])
    unit = np.zeros(system.dof)
    unit[system.names.index(f"{bodies[loaded]} rotation")] = -math.copysign(share, rates[loaded])
    unit[system.names.index(f"{drives} rotation")] = share * abs(rates[loaded]) / rates[drives]
    if np.ptp(torque.values) == 0:
        return Load(constant=unit * abs(float(torque.values[0])))
    return Load(constant=0 * unit, varying=lambda times_s: np.multiply.outer(np.abs(torque.at(times_s)), unit))
