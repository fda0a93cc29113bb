"""Transfer function from bearing forces to a channel: housing on its mounts, path and measurement chain.

H(s) = s^2 / (m (s^2 + 2 zeta w s + w^2)) prod_i p_i / (p_i - s)

Motion other than that of a rigid body also passes through a high-pass filter, s^2 / (s^2 + sqrt(2) v s + v^2): below v,
near its first elastic mode, a housing is rigid, and balanced internal forces do not move it.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from data_synth.kinematic.harmonics import RotatingForce
from data_synth.operation.shaft_angle import Array
from data_synth.scene.random_streams import RandomStreams
from data_synth.scene.scene import Scene, SceneError
from data_synth.scene.sensors import STANDARD_GRAVITY, Mode, Sensor
from data_synth.transfer.acquisition import linear_chain
from data_synth.transfer.paths import AnalogFilter, ModalPath, mode_filter

# ---- Response of a transfer function, given by poles and residues, to a sampled input, in time and in blocks ---------
#     H(s) = direct + sum_i residue_i / (s - p_i)
#
# There is one recursion per pole. The input is linear between samples, which multiplies its spectrum by ``sinc^2``;
# this is compensated so that H is accurate to 1e-4 up to a tenth of the rate and to 5e-3 up to a fifth.


ComplexArray = NDArray[np.complex128]

AHEAD = 2  # input samples that a response needs in advance


@cache
def sinc_correction(terms: int) -> Array:
    """Return the first terms of ``1 / sinc^2(x / 2) = (asin(s) / s)^2``, ``s = sin(x / 2)``, as a symmetric filter.

    They are ``sum_n 2^(2n+1) n!^2 / (2n+2)! s^2n``; the filter (2 terms + 1,) corrects the spectrum of values that are
    linear between samples.
    """
    square, delay = Polynomial([-0.25, 0.5, -0.25]), Polynomial([0.0, 1.0])
    shares = [2 ** (2 * n + 1) * math.factorial(n) ** 2 / math.factorial(2 * n + 2) for n in range(terms + 1)]
    return np.asarray(sum(share * square**n * delay ** (terms - n) for n, share in enumerate(shares)).coef)


def step_weights(poles: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return the integrals of ``exp(p (1 - s))`` over a step, weighted with s and 1 - s, for poles (p,) per step."""
    whole = np.where(np.abs(poles) < 1e-4, 1 + poles / 2 + poles**2 / 6, np.expm1(poles) / poles)  # noqa: PLR2004
    late = np.where(
        np.abs(poles) < 1e-2,  # noqa: PLR2004 - above, the difference has no cancellation
        1 / 2 + poles / 6 + poles**2 / 24 + poles**3 / 120 + poles**4 / 720 + poles**5 / 5040,
        (whole - 1) / poles,
    )
    return late, whole - late


class PoleFilter:
    """A transfer function with its state, initially the steady state for its first sample.

    Parameters
    ----------
    way : AnalogFilter
    rate_hz : float
    sensor : str
        Name of the channel in error messages.
    before : ModalPath, optional
        A path preceding the filter.
    """

    def __init__(self, way: AnalogFilter, *, rate_hz: float, sensor: str = "", before: ModalPath | None = None) -> None:
        poles, residues = way.residues(sensor, before=before)
        self._poles, self._residues, self._direct = poles, residues, way.direct if before is None else 0.0
        self._decay = np.exp(poles / rate_hz)
        late, early = step_weights(poles / rate_hz)
        self._weights_new, self._weights_old = residues / rate_hz * late, residues / rate_hz * early
        self._states: ComplexArray | None = None
        self._input_history = self._direct_history = np.empty(0)

    def push(self, samples: Array, *, at_once: Array | None = None) -> Array:
        """Return the response (n,) to the next samples (n,), delayed by `AHEAD` samples.

        The input of the direct feedthrough may be given separately in `at_once`, (n,), if `samples` are smoothed. The
        very first two samples are the response to a constant input.
        """
        from data_synth.transfer._acquisition_kernels import add_pole_responses  # noqa: PLC0415

        if self._states is None:
            # steady state under the first sample
            self._states = np.asarray(-self._residues / self._poles * samples[0])
            self._input_history = np.full(2 * AHEAD + 1, samples[0])
            self._direct_history = np.full(AHEAD, samples[0])
        joined = np.concatenate([self._input_history, samples])
        self._input_history = joined[-2 * AHEAD - 1 :]
        direct = np.concatenate([self._direct_history, samples if at_once is None else at_once])
        self._direct_history = direct[-AHEAD:]
        corrected = np.convolve(joined, sinc_correction(AHEAD), mode="valid")
        out = self._direct * direct[:-AHEAD]  # feedthrough needs no interpolation
        add_pole_responses(out, corrected, self._decay, self._weights_new, self._weights_old, self._states)
        return out


# ---- Housing ---------------------------------------------------------------------------------------------------------


_FLAT = math.sqrt(0.5)  # damping ratio of a second-order Butterworth filter


def housing_of(scene: Scene, sensor: Sensor, *, elastic: bool = False) -> AnalogFilter:
    """Return the filter from a force in N to a channel, through the housing as a rigid body or by its elasticity."""
    declared, modes = scene.dynamics_or_default, [scene.dynamics_or_default.mounts]
    if elastic:
        modes.append(Mode(frequency_hz=declared.rigid_below_hz, damping_ratio=_FLAT))
    high_pass = np.concatenate([mode_filter(mode).poles for mode in modes])
    gain = 1 / declared.housing_kg / (STANDARD_GRAVITY if sensor.units == "g" else 1.0)
    chain = AnalogFilter(gain=gain, coupling=high_pass).then(linear_chain(sensor, rate_hz=scene.rate_hz))
    return chain if scene.path is None else mode_filter(scene.path).then(chain)


def body_weights(
    scene: Scene, sensor: Sensor, *, bodies: Sequence[str], body_of: Callable[[str], str]
) -> dict[str, float]:
    """Return the gain to a sensor, through the elastic housing, of the support force of each body.

    Parameters
    ----------
    scene : Scene
    sensor : Sensor
    bodies : sequence of str
    body_of : callable
        Function that returns the body of a link.

    Raises
    ------
    SceneError
        Weights for a sensor or link that is not in the scene.
    """
    declared, gearbox = scene.dynamics_or_default, scene.gearbox
    joined, links = scene.kinematics.bodies, {*gearbox.links, *gearbox.copied}
    below = {sensor.on}
    for mesh in gearbox.meshes:
        if mesh.name == sensor.on:
            below |= {gear.link for gear in mesh.gears}
    for bearing in gearbox.bearings:
        if sensor.on in bearing.names:
            below |= {link for link in gearbox.ring_links(bearing) if joined[link] != joined[str(gearbox.frame)]}
    near = {body_of(link) for name in below & links for link in gearbox.instances(name)}
    weights = {body: 1.0 if body in near else declared.elsewhere for body in bodies}
    for given in declared.sensor_weights:
        if given.sensor not in [other.name for other in scene.sensors]:
            raise SceneError(
                f'dynamics.sensor_weights names "{given.sensor}", which is not a sensor of this scene; correct it.'
            )
        for link, weight in given.links:
            if link not in links:
                raise SceneError(
                    f'dynamics.sensor_weights names "{link}", which is not a link of this gearbox; correct the name.'
                )
            if given.sensor == sensor.name:
                weights |= {body_of(name): weight for name in gearbox.instances(link)}
    return weights


def force_response(
    scene: Scene, sensor: Sensor, force: RotatingForce, *, frequency_hz: Array, rng_for: RandomStreams
) -> ComplexArray:
    """Return the amplitude in a channel due to 1 N on the bearings of a link, at frequencies of any shape."""
    along = complex(sensitive_direction(sensor, rng_for=rng_for) @ force.direction)
    body_of = scene.kinematics.bodies.__getitem__
    body = body_of(force.link)
    weight = body_weights(scene, sensor, bodies=[body], body_of=body_of)[body]
    rigid, elastic = (housing_of(scene, sensor, elastic=each) for each in (False, True))
    return np.asarray(along * (rigid.response(frequency_hz) + (weight - 1) * elastic.response(frequency_hz)))


def sensitive_direction(sensor: Sensor, *, rng_for: RandomStreams) -> Array:
    """Return the direction of a sensor in the axes of the gearbox, (3,), with its randomly directed cross-axis part."""
    direction = np.asarray(sensor.direction, dtype=np.float64)
    direction = direction / np.linalg.norm(direction)
    if sensor.cross_axis is None:
        return direction
    drawn = rng_for("cross axis", sensor.name).standard_normal(3)
    across = drawn - (drawn @ direction) * direction
    return np.asarray(direction + sensor.cross_axis.share * across / np.linalg.norm(across))
