"""Five degrees of freedom of a bearing in its housing, by the classical Runge-Kutta method, rounded as written."""

import numpy as np
from numpy.typing import NDArray

from data_synth._compile import compiled, compiled_inside

Array = NDArray[np.float64]

_BALLS = 1.5  # the exponent of balls, which takes a root and no power


@compiled_inside
def derivatives(
    state: Array,
    slope: Array,
    contacts: Array,
    element_angles: Array,
    cage_rad: float,
    defect_rad: float,
    load_x: float,
    load_y: float,
    parameters: Array,
    spall: Array,
) -> None:
    """Write the derivative (10,) of a state (10,): five displacements, then their velocities.

    `parameters` are masses, dampers and springs of shaft, pedestal and resonator, then contact stiffness, exponent and
    clearance. `contacts` (z,) receives the force of each element; `element_angles` (2, z) are cosine and sine of its
    angle from element 1. `spall` is its type (0 none, 1 on a ring, 2 on element 1), middle and half width in rad, and
    depth; `defect_rad` is the angle of the part with the spall.
    """
    deflection_x, deflection_y = state[0] - state[2], state[1] - state[3]
    force_x, force_y = 0.0, 0.0
    elements = contacts.size
    cosine, sine = np.cos(cage_rad), np.sin(cage_rad)
    for element in range(elements):
        along_x = cosine * element_angles[0, element] - sine * element_angles[1, element]
        along_y = sine * element_angles[0, element] + cosine * element_angles[1, element]
        compression = deflection_x * along_x + deflection_y * along_y - parameters[11]
        if spall[0] > 0.0 and compression > 0.0:
            angle = cage_rad + 2.0 * np.pi * element / elements
            on_ring = spall[0] == 1.0
            # a defect of an element meets a race twice in a revolution of the element
            cycle = 2.0 * np.pi if on_ring else np.pi
            distance_rad = angle - spall[1] - defect_rad if on_ring else defect_rad
            distance_rad -= cycle * np.floor(distance_rad / cycle + 0.5)
            if abs(distance_rad) < spall[2] and (on_ring or element == 0):
                compression -= spall[3] * np.cos(0.5 * np.pi * distance_rad / spall[2])
        force = 0.0
        if compression > 0.0:
            force = parameters[9] * (
                compression * np.sqrt(compression) if parameters[10] == _BALLS else compression ** parameters[10]
            )
        contacts[element] = force
        force_x += force * along_x
        force_y += force * along_y
    for i in range(5):
        slope[i] = state[5 + i]
    resonator_force = parameters[8] * (state[3] - state[4]) + parameters[5] * (state[8] - state[9])
    slope[5] = (load_x - force_x - parameters[3] * state[5] - parameters[6] * state[0]) / parameters[0]
    slope[6] = (load_y - force_y - parameters[3] * state[6] - parameters[6] * state[1]) / parameters[0]
    slope[7] = (force_x - parameters[4] * state[7] - parameters[7] * state[2]) / parameters[1]
    slope[8] = (force_y - parameters[4] * state[8] - parameters[7] * state[3] - resonator_force) / parameters[1]
    slope[9] = resonator_force / parameters[2]


@compiled
def runge_kutta(
    state: Array,
    cage_rad: Array,
    defect_rad: Array,
    load: Array,
    step_s: float,
    parameters: Array,
    spall: Array,
    motion: Array,
    acceleration: Array,
    contacts: Array,
) -> None:
    """Integrate a state (10,), changed in place, over m steps; angles and load (2 m + 1,) are given at half steps.

    Writes `motion` (m + 1, 10), `acceleration` (m + 1, 5) and the forces `contacts` (m + 1, z) at whole steps.
    """
    first, second, third, fourth = np.empty(10), np.empty(10), np.empty(10), np.empty(10)
    midpoint = np.empty(10)
    elements = contacts.shape[1]
    scratch, element_angles = np.empty(elements), np.empty((2, elements))
    for element in range(elements):
        element_angles[0, element] = np.cos(2.0 * np.pi * element / elements)
        element_angles[1, element] = np.sin(2.0 * np.pi * element / elements)
    steps = motion.shape[0] - 1
    for step in range(steps + 1):
        now = 2 * step
        derivatives(
            state,
            first,
            contacts[step],
            element_angles,
            cage_rad[now],
            defect_rad[now],
            load[0, now],
            load[1, now],
            parameters,
            spall,
        )
        for i in range(10):
            motion[step, i] = state[i]
        for i in range(5):
            acceleration[step, i] = first[5 + i]
        if step == steps:
            break
        half, full = now + 1, now + 2
        for i in range(10):
            midpoint[i] = state[i] + 0.5 * step_s * first[i]
        derivatives(
            midpoint,
            second,
            scratch,
            element_angles,
            cage_rad[half],
            defect_rad[half],
            load[0, half],
            load[1, half],
            parameters,
            spall,
        )
        for i in range(10):
            midpoint[i] = state[i] + 0.5 * step_s * second[i]
        derivatives(
            midpoint,
            third,
            scratch,
            element_angles,
            cage_rad[half],
            defect_rad[half],
            load[0, half],
            load[1, half],
            parameters,
            spall,
        )
        for i in range(10):
            midpoint[i] = state[i] + step_s * third[i]
        derivatives(
            midpoint,
            fourth,
            scratch,
            element_angles,
            cage_rad[full],
            defect_rad[full],
            load[0, full],
            load[1, full],
            parameters,
            spall,
        )
        for i in range(10):
            state[i] += step_s / 6.0 * (first[i] + 2.0 * second[i] + 2.0 * third[i] + fourth[i])
