"""Lines that gears in motion are expected to have at a speed and a load: harmonic balance with varying stiffness.

The exciting force of a mesh without vibration, ``p_static = F (1 - k_mean / k) - k_mean e``
(`data_synth.fidelity.linear_response`), has constant Fourier coefficients at exact orders: those of each part of the
transmission error e, which has the period of one gear, and of k, per N of the static force F. With vibration it is

    p = p_static + (1 - k_mean / k) (1 + k_mean G) p

G the deflection of the mesh per N of p at mean stiffness, -1 / k_mean at rest. The factor of the varying stiffness
repeats every mesh cycle, so that it couples lines a whole number of mesh orders apart; one matrix for each frequency
between two mesh harmonics solves for all of them, and its inverse, smooth in frequency and speed, is interpolated.

Left out are the varying stiffness of other meshes, that of a damaged tooth beyond its effect on static teeth, and
transients: a small part of the signal, which a projection finds.
"""

import math

import numpy as np

from data_synth.dynamics.system import Mesh
from data_synth.fidelity.linear_response import MIN_STIFFNESS, Response, response_of, spectral_lines
from data_synth.gears.transmission_error import SumOfErrors, TransmissionError
from data_synth.kinematic.harmonics import ComplexArray
from data_synth.operation.shaft_angle import Array
from data_synth.vibration.gear_lines import ExpectedLines
from data_synth.vibration.run import Motion, contacts_in
from data_synth.vibration.torques import static_tooth_forces

_POINTS = 32  # to a period of the highest line, which is then right to 1 % for a stiffness that jumps
_FEWEST = 512  # points to a mesh cycle
_RESPONSES = 1 << 14  # frequencies from zero to half the rate, between which a response is linear
_BELOW_ZERO = 16  # mesh harmonics at negative frequencies, which stiffness couples with the first at positive ones
_APART_HZ = 20.0
"""Frequencies between which the harmonic balance is linear, and mesh frequencies between which it is: the modes that
varying stiffness changes, those of the teeth, are some hundred Hz wide."""


def expected_lines(motion: Motion) -> tuple[ExpectedLines, ...]:
    """Return the expected lines of gears in motion, a family for each mesh and period.

    None of planets, whose routes to a sensor vary with the carrier's angle, nor of a reference that turns backwards.

    Parameters
    ----------
    motion : Motion
        Teeth that change in time are taken as they are at first.
    """
    system, stage = motion.system, motion.stage
    speed_hz, rate_hz = stage.speed_hz, stage.scene.rate_hz
    if motion.sensor_forces.rotate or np.min(speed_hz) < 0 or not speed_hz.any():
        return ()
    response, orders = response_of(motion), stage.scene.exact_orders("gear_mesh")
    mesh_orders = {number: order for name, order in orders.items() for number in contacts_in(system, name)}
    frequency_hz = np.linspace(0.0, rate_hz / 2, _RESPONSES)
    static_n = static_tooth_forces(stage, system, motion.drive_load)
    found = []
    for number, mesh in enumerate(system.meshes):
        order = float(mesh_orders[number])
        harmonics = rate_hz / 2 / (order * float(np.max(speed_hz)))
        count = 1 + math.ceil(order * float(np.ptp(speed_hz)) / _APART_HZ)
        # from a hundredth of the top speed on: below, lines are at frequencies where the stiffness acts statically
        speeds_hz = np.linspace(max(np.min(speed_hz), 0.01 * np.max(speed_hz)), np.max(speed_hz), count)
        forces = _forces(mesh, harmonics=harmonics)
        balanced = [_balanced(response, number, forces, mesh_hz=order * speed) for speed in speeds_hz]
        transfer = response.channels(number, frequency_hz)
        for place, period in enumerate(forces):
            loaded, unloaded = (np.stack([each[place][part] for each in balanced]) for part in (0, 1))
            found.append(
                ExpectedLines(
                    base_order=mesh_orders[number] / period,
                    loaded=loaded,
                    unloaded_n=unloaded,
                    speeds_hz=speeds_hz,
                    static_n=static_n[number],
                    speed_hz=speed_hz,
                    frequency_hz=frequency_hz,
                    transfer=transfer,
                )
            )
    return tuple(found)


def _forces(mesh: Mesh, *, harmonics: float) -> dict[int, ComplexArray]:
    """Return the lines of p without vibration by the cycles of their period: per N of static force, and in N, (2, k).

    Parameters
    ----------
    mesh : Mesh
    harmonics : float
        Of the mesh, up to the highest line.
    """
    mean, error, found = mesh.stiffness.mean, mesh.error, dict[int, ComplexArray]()
    parts: list[tuple[TransmissionError, float]] = [] if error is None else [(error, 0.0)]
    if isinstance(error, SumOfErrors):
        parts = [*zip(error.parts, error.by_cycles or (0.0,) * len(error.parts), strict=True)]
    own = int(mesh.stiffness.period)
    for period in dict.fromkeys((own, *(int(part.period) for part, _ in parts))):
        lines = max(1, math.floor(harmonics * period))
        phases = _phases(max(_FEWEST * period, 1 << (_POINTS * lines - 1).bit_length()), period)
        error_m = sum((part(phases + by) for part, by in parts if part.period == period), np.zeros(phases.size))
        loaded = 1 - mean / np.maximum(mesh.stiffness(phases), MIN_STIFFNESS * mean) if period == own else 0 * phases
        found[period] = np.stack([spectral_lines(loaded, lines), spectral_lines(-mean * error_m, lines)])
    return found


def _balanced(
    response: Response, number: int, forces: dict[int, ComplexArray], *, mesh_hz: float
) -> list[ComplexArray]:
    """Return the lines of p (2, k) with vibration, of each period, at a mesh frequency."""
    mesh = response.motion.system.meshes[number]
    mean, own = mesh.stiffness.mean, int(mesh.stiffness.period)
    size = 1 + max(lines.shape[1] // period for period, lines in forces.items())
    below = min(_BELOW_ZERO, size - 1)
    stiffness = np.maximum(mesh.stiffness(_phases(_FEWEST * own, own)), MIN_STIFFNESS * mean).reshape(own, _FEWEST)
    varying = np.mean(1 - mean / stiffness, axis=0)  # of all teeth
    coupling = np.fft.fft(varying) / _FEWEST * np.exp(-1j * np.pi * np.fft.fftfreq(_FEWEST))
    rows = np.arange(-below, size)
    apart = rows[:, None] - rows
    toeplitz = np.where(np.abs(apart) < _FEWEST // 2, coupling[apart % _FEWEST], 0)
    between = max(1, math.ceil(mesh_hz / _APART_HZ))
    inverses = []
    for part in range(between + 1):
        gain = 1 + mean * response.deflection(number, (rows + part / between) * mesh_hz)
        inverses.append(np.linalg.inv((np.eye(rows.size) - toeplitz * gain).astype(np.complex64)))
    found = []
    for period, lines in forces.items():
        above = np.zeros((2, size * period), dtype=np.complex64)
        above[:, 1 : lines.shape[1] + 1] = lines[:, : size * period - 1]
        # (mesh harmonic, place between two, part)
        both = np.concatenate([above[:, below * period : 0 : -1].conj(), above], axis=1)
        static = np.moveaxis(both.reshape(2, rows.size, period), 0, -1)
        place = np.arange(period) / period * between
        first = np.minimum(place.astype(np.int64), between - 1)
        solved = np.empty_like(static)
        for part in range(between):
            here = np.flatnonzero(first == part)
            share, some = (place[here] - part)[:, None], static[:, here].reshape(rows.size, -1)
            low, high = ((inverses[end] @ some).reshape(rows.size, here.size, 2) for end in (part, part + 1))
            solved[:, here] = (1 - share) * low + share * high
        of_order = np.moveaxis(solved[below:], -1, 0).reshape(2, -1)
        found.append(of_order[:, 1 : lines.shape[1] + 1].astype(np.complex128))
    return found


def _phases(points: int, period: int) -> Array:
    """Return equidistant mesh phases of a period in cycles, half a step from its ends, as `spectral_lines` has them."""
    return np.asarray((np.arange(points) + 0.5) * period / points)
