"""Linear response of gears to mesh excitation: spectral lines of each mesh in the channels.

Under the static force F, teeth of stiffness k and transmission error e, which follow the mesh phase, deflect by
F / k + e. On a spring of the mean stiffness, the same deflection is caused by a force

    p = F (1 - k_mean / k) - k_mean e

along the line of action: the loaded static transmission error as excitation (Ozguven and Houser 1988, J. Sound Vib.
125, 71). With vibration the deflection is d, and the force on the spring of the mean stiffness is

    q = k (d - e) - k_mean d

whose periodic solution `Response.excitations` finds: the parametric excitation of a mesh by its own vibration, and loss
of contact. The parametric excitation by other meshes is neglected.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property

import numpy as np

from data_synth.dynamics.modes import undamped_modes
from data_synth.dynamics.system import Mesh
from data_synth.kinematic.harmonics import ComplexArray, HarmonicFamily
from data_synth.operation.shaft_angle import Array
from data_synth.scene.faults import Fault, GearFault
from data_synth.scene.scene import SceneError
from data_synth.sources.families import mesh_name
from data_synth.sources.prepared import PreparedScene
from data_synth.vibration.run import Motion, contacts_in, motion_of

_POINTS = 64  # per period of the highest line, whose error is then half a percent for a stiffness with jumps
COARSE = 8  # the same for an error of a few percent
_LINES_OF_CYCLE = 8  # fewest lines per mesh cycle that the points resolve
MIN_STIFFNESS = 0.25  # of the mean stiffness: below it, teeth are losing contact
_LONGEST = 256  # mesh cycles per period: each adds lines
_NEGLIGIBLE = 1e-5  # of the largest line of a mesh: -100 dB
_SPEED_STEP, _SLOW = 0.02, 0.2
"""Step between speeds at which vibration is computed, relative to the speed: two per half-bandwidth of a mode of
damping 0.02; and the least speed relative to the top speed, below which the vibration of that speed is used."""
_TAKES_PART = 1e-4  # of the compliance of a mesh: modes with a smaller share deflect statically
_CONTACTS, _SETTLED = 60, 0.02  # iterations of tooth contact, at most, and its change at convergence


@dataclass(frozen=True, kw_only=True)
class ToothForces:
    """The exciting force p of one mesh, as spectral lines at the multiples of `base`.

    Attributes
    ----------
    mesh : str
    base_order : Fraction
        Order of the first line: that of the mesh divided by the cycles after which it repeats.
    loaded : (line,) complex array
        Per N of static force; phase zero is that of the reference's angle.
    unloaded : (line,) complex array
        From the transmission error, in N.
    static_n : (instant,) array
        Static force at the instants of the truth.
    stiffness, error : (point,) arrays
        k in N/m and e in m at equidistant phases of a period, `COARSE` per period of the highest line.
    """

    mesh: str
    base_order: Fraction
    loaded: ComplexArray = field(metadata={"dims": ("line",), "units": "1"})
    unloaded: ComplexArray = field(metadata={"dims": ("line",), "units": "N"})
    static_n: Array = field(metadata={"dims": ("instant",), "units": "N"})
    stiffness: Array = field(repr=False, metadata={"dims": ("point",), "units": "N/m"})
    error: Array = field(repr=False, metadata={"dims": ("point",), "units": "m"})

    @property
    def orders(self) -> Array:
        """Orders of all lines, (line,)."""
        return np.asarray(float(self.base_order) * np.arange(1, self.loaded.size + 1))


@dataclass(frozen=True, kw_only=True)
class Response:
    """Linear response of gears at mean mesh stiffness to a force p in a mesh, as a sum over poles.

    Attributes
    ----------
    motion : Motion
    poles : (pole,) complex array
        rad/s; without rigid-body modes, which mesh forces do not excite.
    outputs : (reading, pole) complex array
        Contribution of each pole to the readings: without planets, the forces on the routes.
    deflections : (mesh, pole) complex array
        Contribution to the deflections of meshes.
    inputs : (pole, mesh) complex array
        Excitation of each pole per N of p.
    direct : (reading, mesh) array
        Readings per N of p: forces on gears of the frame, and of meshes among the outputs.
    means : (mesh,) array
        Mean mesh stiffness in N/m.
    """

    motion: Motion
    poles: ComplexArray = field(metadata={"dims": ("pole",), "units": "rad/s"})
    outputs: ComplexArray = field(repr=False, metadata={"dims": ("listener", "pole"), "units": "N"})
    deflections: ComplexArray = field(repr=False, metadata={"dims": ("mesh", "pole"), "units": "m"})
    inputs: ComplexArray = field(repr=False, metadata={"dims": ("pole", "mesh"), "units": "N-1"})
    direct: Array = field(repr=False, metadata={"dims": ("listener", "mesh"), "units": "1"})
    means: Array = field(repr=False, metadata={"dims": ("mesh",), "units": "N/m"})

    def channels(self, mesh: int, frequency_hz: Array) -> ComplexArray:
        """Return the complex amplitudes in the channels for 1 N of p at frequencies (...), (sensor, ...)."""
        readings = self._resolvent(frequency_hz) @ (self.outputs * self.inputs[:, mesh]).T + self.direct[:, mesh]
        outputs = np.zeros((len(self.motion.stage.scene.sensors), *frequency_hz.shape), dtype=np.complex128)
        for reading, (channel, response) in zip(np.moveaxis(readings, -1, 0), self._routes, strict=True):
            outputs[channel] += reading * response(frequency_hz)
        return outputs

    @cached_property
    def _routes(self) -> list[tuple[int, Callable[[Array], ComplexArray]]]:
        """Channel and response of each route to a sensor."""
        scene = self.motion.stage.scene
        return [(route.number, route.response_in(scene)) for route in self.motion.sensor_forces.routes]

    def lines(self, forces: ToothForces) -> ComplexArray:
        """Return the complex amplitudes in the channels of the lines of a mesh, (sensor, line, instant).

        Raises
        ------
        SceneError
            If the varying stiffness makes the motion unstable.
        """
        stage, number = self.motion.stage, self._number(forces)
        excitations = self.excitations(forces)
        outputs = np.empty((len(stage.scene.sensors), *excitations.shape), dtype=np.complex128)
        for instant, speed_hz in enumerate(stage.speed_hz):
            if instant == 0 or speed_hz != stage.speed_hz[instant - 1]:
                transfer = self.channels(number, forces.orders * speed_hz)
            outputs[:, :, instant] = transfer * excitations[:, instant]
        return outputs

    def _number(self, forces: ToothForces) -> int:
        return [mesh.name for mesh in self.motion.system.meshes].index(forces.mesh)

    def excitations(self, forces: ToothForces, instants: Sequence[int] | slice = slice(None)) -> ComplexArray:
        """Return the lines of q, (line, instant) in N: those of p plus those of vibration, linear between speeds."""
        speeds_hz = np.abs(self.motion.stage.speed_hz[instants])
        place = np.log(np.maximum(speeds_hz, _SLOW * np.max(speeds_hz))) / _SPEED_STEP
        grid = np.linspace(np.min(place), np.max(place), math.ceil(np.ptp(place)) + 1)
        shares = np.maximum(1 - np.abs(place[:, None] - grid) * (grid.size - 1) / max(np.ptp(grid), 1e-12), 0)
        used = np.flatnonzero(np.any(shares, axis=0))
        added = np.stack([self._vibration(forces, math.exp(_SPEED_STEP * grid[number])) for number in used], axis=1)
        p = forces.static_n[instants] * forces.loaded[:, None] + forces.unloaded[:, None]
        return np.asarray(p + added @ shares[:, used].T)

    def _vibration(self, forces: ToothForces, speed_hz: float) -> ComplexArray:
        """Return the contribution of vibration at a speed to the lines of p, (line,) in N.

        Modes vibrate freely between points, at which q acts as an impulse; those too fast for the step deflect
        statically.
        """
        number, forward = self._number(forces), 1 if np.sum(self.motion.stage.speed_hz) > 0 else -1
        mean, static_n = float(self.means[number]), float(np.mean(forces.static_n))
        stiffness, error = forces.stiffness[::forward], forces.error[::forward]
        step_s = 1 / (float(forces.base_order) * speed_hz * stiffness.size)
        compliances = self.deflections[number] * self.inputs[:, number] / self.poles
        free = (np.abs(self.poles) * step_s < 1) & (np.abs(compliances) > _TAKES_PART / mean)
        seen, kick = self.deflections[number, free], self.inputs[free, number] * step_s
        turn = np.exp(self.poles[free] * step_s)
        # remaining static compliance: teeth follow slow errors with almost no deflection
        rest = -float(np.sum(compliances).real + np.sum(seen * kick * turn / (1 - turn)).real)
        parts = self.motion.system.meshes[number].backlash_m > 0 and static_n != 0
        touching, solutions = np.ones(stiffness.size), []
        for _ in range(_CONTACTS if parts else 1):
            # q = k (d - e) - mean d, d = static / mean + vibration + rest q
            change = stiffness * touching - mean
            constant = change * static_n / mean - stiffness * touching * error
            change, constant = (each / (1 - change * rest) for each in (change, constant))
            vibration, growth = _periodic(change, constant, seen=seen, kick=kick, turn=turn)
            q = change * vibration + constant
            solutions.append((q, growth))
            now = (static_n / mean + vibration + rest * q - error) * static_n > 0
            if np.max(np.abs(now - touching)) < _SETTLED:
                break
            touching = (touching + now) / 2  # without under-relaxation, contacts would alternate
        else:
            q, growth = solutions[0]  # no motion with loss of contact was found
        if growth >= 1:
            raise SceneError(
                f'the stiffness of "{forces.mesh}" makes its vibration grow at {60 * speed_hz:.4g} rpm; write '
                'fidelity = "dynamic".'
            )
        p = static_n * (1 - mean / stiffness) - mean * error
        return spectral_lines((q - p)[::forward], forces.orders.size)

    def deflections_by(self, mesh: int, frequency_hz: Array) -> ComplexArray:
        """Return the complex amplitudes of the deflections of all meshes in m for 1 N of p in one, (mesh, ...)."""
        return np.moveaxis(self._resolvent(frequency_hz) @ (self.deflections * self.inputs[:, mesh]).T, -1, 0)

    def _resolvent(self, frequency_hz: Array) -> ComplexArray:
        """Return the response (..., pole) of each pole to a unit of its excitation."""
        return np.asarray(1 / (2j * np.pi * np.asarray(frequency_hz, dtype=np.float64)[..., None] - self.poles))


def _periodic(
    change: Array, constant: Array, *, seen: ComplexArray, kick: ComplexArray, turn: ComplexArray
) -> tuple[Array, float]:
    """Return the periodic motion `seen` z of modes z under impulses q = change (seen z) + constant, (point,).

    Between points z is multiplied by `turn`. Blocks of points are integrated in parallel as affine maps of their
    initial values; that of the first follows from periodicity. The last result is the growth factor of a deviation per
    period.
    """
    modes, blocks = seen.size, math.gcd(change.size, 1 << (change.size.bit_length() // 2))
    change, constant = change.reshape(blocks, -1), constant.reshape(blocks, -1)
    still = np.append(np.eye(modes), np.zeros((modes, 1)), axis=1).astype(np.complex128)
    maps = np.tile(still, (blocks, 1, 1))
    for share, force in zip(change.T, constant.T, strict=True):
        q = share[:, None] * (seen @ maps)
        q[:, -1] += force
        maps = (maps + kick[:, None] * q[:, None]) * turn[:, None]
    at_blocks = [still]
    for own in maps:
        at_blocks.append(own[:, :-1] @ at_blocks[-1])
        at_blocks[-1][:, -1] += own[:, -1]
    over_period, pushed = at_blocks[-1][:, :-1], at_blocks[-1][:, -1]
    start = np.append(np.linalg.solve(np.eye(modes) - over_period, pushed), 1.0)
    z, found = np.array(at_blocks[:-1]) @ start, np.empty(change.shape)
    for point, (share, force) in enumerate(zip(change.T, constant.T, strict=True)):
        found[:, point] = (z @ seen).real
        z = (z + kick * (share * found[:, point] + force)[:, None]) * turn
    return found.ravel(), float(np.max(np.abs(np.linalg.eigvals(over_period)), initial=0.0))


def response_of(motion: Motion) -> Response:
    """Return the linear response of gears from their equations of motion in elastic modes.

    With planets, whose routes to a sensor rotate with their carrier, it is that of the readings, not of the channels.
    """
    system, output = motion.system, motion.output
    means = np.array([mesh.stiffness.mean for mesh in system.meshes])
    angular, shapes = undamped_modes(system, means)
    angular, shapes = angular[angular > 0], shapes[:, angular > 0]
    damping = system.damping if system.gyroscopic is None else system.damping + system.gyroscopic
    count = angular.size
    matrix = np.zeros((2 * count, 2 * count))
    matrix[:count, count:] = np.eye(count)
    matrix[count:, :count] = -np.diag(angular**2)
    matrix[count:, count:] = -(shapes.T @ damping @ shapes)
    poles, vectors = np.linalg.eig(matrix)
    directions = np.array([mesh.direction for mesh in system.meshes])
    every = np.zeros((output.channels, means.size)) if output.mesh_force is None else output.mesh_force
    rows = (every * means) @ directions
    rows = rows if output.displacement is None else rows + output.displacement
    velocity_rows = np.zeros_like(rows) if output.velocity is None else output.velocity
    readings = np.hstack([rows @ shapes, velocity_rows @ shapes]) @ vectors
    pushes = -directions @ shapes
    inputs = np.linalg.solve(vectors, np.vstack([np.zeros_like(pushes.T), pushes.T]).astype(np.complex128))
    return Response(
        motion=motion,
        poles=poles.astype(np.complex128),
        outputs=readings,
        deflections=(directions @ shapes) @ vectors[:count],
        inputs=inputs,
        direct=every,
        means=means,
    )


def obstacle(motion: Motion) -> str:
    """Return why the response of the gears cannot be linear and periodic, or an empty string."""
    if motion.sensor_forces.rotate:
        return "planets rotate with their carrier"
    if motion.drive_load.full_rotation:
        return "speed follows from torque"
    torque = motion.stage.drive.torque
    if torque is not None and np.ptp(torque.values):
        return "the torque changes"
    for mesh in motion.system.meshes:
        period, why = period_of(mesh), ""
        if mesh.history is not None:
            why = "change with time"
        elif period > _LONGEST:
            why = f"repeat after {period} cycles only"
        elif mesh.friction:
            why = "rub"
        if why:
            return f'the teeth of "{mesh.name}" {why}'
    return ""


def tooth_forces(motion: Motion, name: str, *, points: int = _POINTS) -> ToothForces:
    """Return the exciting force p of a mesh, with all lines below half the sampling rate at top speed.

    Parameters
    ----------
    motion : Motion
        Without planets.
    name : str
    points : int
        Values of the stiffness per period of the highest line: a multiple of `COARSE`.
    """
    stage = motion.stage
    number = contacts_in(motion.system, name)[0]
    mesh = motion.system.meshes[number]
    period = period_of(mesh)
    base_order = stage.scene.exact_orders("gear_mesh")[name] / period
    top_hz = stage.drive.angle.top_speed_hz(0.0, stage.scene.duration_s)
    lines = max(0, math.ceil(stage.scene.rate_hz / 2 / (float(base_order) * top_hz)) - 1)
    # the same number in every cycle, sound or damaged: else the sampling of jumps would differ
    of_cycle = points * max(_LINES_OF_CYCLE, math.ceil(stage.scene.rate_hz / 2 / (float(base_order) * period * top_hz)))
    count = period << (of_cycle - 1).bit_length()
    phases = (np.arange(count) + 0.5) * period / count
    mean = mesh.stiffness.mean
    stiffness = mesh.stiffness(phases)
    error = mesh.error(phases) if mesh.error is not None else np.zeros(phases.size)
    return ToothForces(
        mesh=name,
        base_order=base_order,
        loaded=spectral_lines(1 - mean / stiffness, lines),
        unloaded=spectral_lines(-mean * error, lines),
        static_n=motion.static_n[number],
        stiffness=np.mean(stiffness.reshape(-1, points // COARSE), axis=1),
        error=np.mean(error.reshape(-1, points // COARSE), axis=1),
    )


def period_of(mesh: Mesh) -> int:
    """Return the mesh cycles after which stiffness and transmission error both repeat."""
    return math.lcm(int(mesh.stiffness.period), int(mesh.error.period) if mesh.error is not None else 1)


def spectral_lines(values: Array, count: int) -> ComplexArray:
    """Return the first lines (count,) of values at equidistant phases of a period, half a step from its ends."""
    cycles = np.arange(1, count + 1) / values.size
    return np.asarray(np.fft.rfft(values)[1 : count + 1] * (2 / values.size) * np.exp(-1j * np.pi * cycles))


def _family(
    outputs: ComplexArray, forces: ToothForces, *, component: str, kind: str, weakest: float
) -> tuple[HarmonicFamily, ComplexArray]:
    """Return the significant lines (sensor, line, instant) of a mesh as a family, and their amplitudes."""
    loud = np.max(np.abs(outputs), axis=(0, 2)) > weakest
    values = (outputs * loud[:, None])[:, : int(np.max(np.flatnonzero(loud), initial=-1)) + 1]
    family = HarmonicFamily(
        component=component,
        kind=kind,
        source=forces.mesh,
        base_order=forces.base_order,
        coefficients=values[0],
        load_dependent=True,
    )
    return family, values


def with_lines(stage: PreparedScene, motion: Motion) -> PreparedScene:
    """Return a stage with the lines of all meshes added.

    The lines at multiples of the mesh order belong to the mesh, those between them to its damaged gears.
    """
    families, amplitudes, response = [*stage.families], [*stage.amplitudes], response_of(motion)
    for mesh, order in stage.scene.exact_orders("gear_mesh").items():
        forces = tooth_forces(motion, mesh)
        outputs = response.lines(forces)
        own = np.arange(1, forces.orders.size + 1) % round(order / forces.base_order) == 0
        damaged = [fault.component for fault in stage.scene.faults if mesh_name(fault.component) == mesh]
        between = (" + ".join(damaged), "tooth") if damaged else (mesh, "pitch_deviation")
        weakest = _NEGLIGIBLE * np.max(np.abs(outputs), initial=0.0)
        for component, kind, kept in ((mesh, "gear_mesh", own), (*between, ~own)):
            family, values = _family(outputs * kept[:, None], forces, component=component, kind=kind, weakest=weakest)
            if values.size:
                families.append(family)
                amplitudes.append(values)
    return replace(stage, families=families, amplitudes=amplitudes)


# ---- Damaged gears of a kinematic scene: as loud beside their mesh as in the linear response -------------------------


def with_gear_faults(stage: PreparedScene) -> tuple[PreparedScene, str]:
    """Return a kinematic stage with its gear faults by linear response, and a description of the method.

    The contribution of a fault to the response of its mesh has the phase of its tooth, and is scaled to the level of
    the kinematic mesh in each channel. It includes the impacts, so those of the stage are set to zero.
    """
    faults = stage.scene.faults
    numbers = [number for number, fault in enumerate(faults) if isinstance(fault, GearFault)]
    if not numbers:
        return stage, ""
    if any(fault.declared_factors != (None, None, None) for fault in faults if isinstance(fault, GearFault)):
        return stage, "declared factors"
    try:
        meshes = [mesh_name(faults[number].component) for number in numbers]
        sound = {mesh: _mesh_lines(_alone(stage, ()), mesh)[:2] for mesh in dict.fromkeys(meshes)}
        added = [_added_by(stage, number, *sound[mesh]) for number, mesh in zip(numbers, meshes, strict=True)]
    except SceneError as caught:
        return stage, f"illustrative factors: {caught}"
    replaced = {(family.component, family.kind) for family, _ in added}
    both = zip(stage.families, stage.amplitudes, strict=True)
    lines = [pair for pair in both if (pair[0].component, pair[0].kind) not in replaced] + added
    trains = [
        (number, replace(train, amplitudes=0 * train.amplitudes) if number in numbers else train)
        for number, train in stage.trains
    ]
    families, amplitudes = zip(*lines, strict=True)
    return replace(stage, families=families, amplitudes=amplitudes, trains=trains), "linear response"


def _alone(stage: PreparedScene, faults: tuple[Fault, ...]) -> PreparedScene:
    """Return a kinematic stage with gear dynamics, some of its faults and no imperfections."""
    return replace(stage, scene=stage.scene.changed(fidelity="dynamic", faults=faults, imperfections=None))


def _added_by(
    stage: PreparedScene, number: int, sound: ToothForces, healthy: ComplexArray
) -> tuple[HarmonicFamily, ComplexArray]:
    """Return the contribution of a gear fault to the channels of a kinematic stage, as a family and its amplitudes.

    `sound` is the exciting force of its mesh without faults, and `healthy` its lines.
    """
    fault, mesh = stage.scene.faults[number], sound.mesh

    def rng_for(*words: str) -> np.random.Generator:
        return stage.rng_for(words[0], str(number)) if words[0] == "pits" else stage.rng_for(*words)

    own = replace(_alone(stage, (fault,)), offsets=[stage.offsets[number]], rng_for=rng_for)
    forces, added, place = _mesh_lines(own, mesh)
    every = round(sound.base_order / forces.base_order)
    shared = min(healthy.shape[1], added.shape[1] // every)
    added[:, every - 1 : every * shared : every] -= healthy[:, :shared]
    level = sum(
        np.sum(np.abs(amplitudes) ** 2, axis=1)
        for family, amplitudes in zip(stage.families, stage.amplitudes, strict=True)
        if (family.component, family.kind) == (mesh, "gear_mesh")
    )
    response = np.sum(np.abs(healthy) ** 2, axis=1)
    scale = np.sqrt(np.divide(level, response, out=np.zeros_like(response), where=response > 0))
    tooth = stage.scene.exact_orders("tooth")[fault.component]
    turns = -((stage.offsets[number] + float(stage.turns_before * tooth % 1)) % 1) / float(tooth) - place
    late = np.exp(-2j * np.pi * turns * forces.orders)
    added *= late[:, None] * scale[:, None]
    weakest = _NEGLIGIBLE * float(np.max(np.abs(added)))
    return _family(added, forces, component=fault.component, kind="tooth", weakest=weakest)


def _mesh_lines(stage: PreparedScene, mesh: str) -> tuple[ToothForces, ComplexArray, float]:
    """Return the forces of a mesh, their lines (sensor, line, instant), and where its first fault passes, in rev.

    For a growing fault, the lines are linear between the stages of growth, and the forces those of the last.
    """
    motion = motion_of(stage)
    number = contacts_in(motion.system, mesh)[0]
    changing = motion.system.meshes[number]
    stages, position = [(changing.stiffness, changing.error)], np.zeros(stage.instants_s.size)
    if changing.history is not None:
        stages = [*zip(changing.history.stiffnesses, changing.history.errors, strict=True)]
        position = changing.history.position(stage.instants_s)
    found = np.zeros(1, dtype=np.complex128)
    for place, (stiffness, error) in enumerate(stages):
        meshes = [*motion.system.meshes]
        meshes[number] = replace(changing, stiffness=stiffness, error=error, history=None)
        steady = replace(motion, system=replace(motion.system, meshes=tuple(meshes)))
        if why := obstacle(steady):
            raise SceneError(f"{why}, so the response is not linear")
        forces = tooth_forces(steady, mesh, points=COARSE)
        found = found + response_of(steady).lines(forces) * np.maximum(1 - np.abs(position - place), 0)
    passes = motion.gears.teeth[mesh].passes
    return forces, found, passes[0][1] / changing.cycles_per_rev if passes else 0.0
