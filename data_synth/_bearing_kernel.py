"""The five degrees of freedom of a bearing in its housing, marched by the classical Runge-Kutta method; compiled."""

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
    pitches: Array,
    cage_rad: float,
    spot_rad: float,
    load_x: float,
    load_y: float,
    body: Array,
    spall: Array,
) -> None:
    """Write the derivative (10,) of a state (10,): five displacements, then their velocities.

    `body` holds masses, dampers and springs of shaft, pedestal and resonator, then contact stiffness, exponent,
    clearance; `contacts` (z,) takes the force of each element, `pitches` (2, z) are cosine and sine of its angle from
    element 1. `spall` holds who has it (0 nobody, 1 a ring, 2 element
    1), middle and half width in rad, and depth; `spot_rad` is the turn of who has it.
    """
    across, up = state[0] - state[2], state[1] - state[3]
    push_x, push_y = 0.0, 0.0
    elements = contacts.size
    cosine, sine = np.cos(cage_rad), np.sin(cage_rad)
    for element in range(elements):
        along_x = cosine * pitches[0, element] - sine * pitches[1, element]
        along_y = sine * pitches[0, element] + cosine * pitches[1, element]
        pressed = across * along_x + up * along_y - body[11]
        if spall[0] > 0.0 and pressed > 0.0:
            angle = cage_rad + 2.0 * np.pi * element / elements
            on_ring = spall[0] == 1.0
            # a spot of an element meets a race twice in a turn of it
            cycle = 2.0 * np.pi if on_ring else np.pi
            off = angle - spall[1] - spot_rad if on_ring else spot_rad
            off -= cycle * np.floor(off / cycle + 0.5)
            if abs(off) < spall[2] and (on_ring or element == 0):
                pressed -= spall[3] * np.cos(0.5 * np.pi * off / spall[2])
        force = 0.0
        if pressed > 0.0:
            force = body[9] * (pressed * np.sqrt(pressed) if body[10] == _BALLS else pressed ** body[10])
        contacts[element] = force
        push_x += force * along_x
        push_y += force * along_y
    for i in range(5):
        slope[i] = state[5 + i]
    ringing = body[8] * (state[3] - state[4]) + body[5] * (state[8] - state[9])
    slope[5] = (load_x - push_x - body[3] * state[5] - body[6] * state[0]) / body[0]
    slope[6] = (load_y - push_y - body[3] * state[6] - body[6] * state[1]) / body[0]
    slope[7] = (push_x - body[4] * state[7] - body[7] * state[2]) / body[1]
    slope[8] = (push_y - body[4] * state[8] - body[7] * state[3] - ringing) / body[1]
    slope[9] = ringing / body[2]


@compiled
def runge_kutta(
    state: Array,
    cage_rad: Array,
    spot_rad: Array,
    load: Array,
    step_s: float,
    body: Array,
    spall: Array,
    motion: Array,
    acceleration: Array,
    contacts: Array,
) -> None:
    """March a state (10,), changed in place, over m steps; angles and load (2 m + 1,) are given at half steps.

    Writes `motion` (m + 1, 10), `acceleration` (m + 1, 5) and the forces `contacts` (m + 1, z) at whole steps.
    """
    first, second, third, fourth = np.empty(10), np.empty(10), np.empty(10), np.empty(10)
    there = np.empty(10)
    elements = contacts.shape[1]
    scratch, pitches = np.empty(elements), np.empty((2, elements))
    for element in range(elements):
        pitches[0, element] = np.cos(2.0 * np.pi * element / elements)
        pitches[1, element] = np.sin(2.0 * np.pi * element / elements)
    steps = motion.shape[0] - 1
    for step in range(steps + 1):
        now = 2 * step
        derivatives(
            state, first, contacts[step], pitches, cage_rad[now], spot_rad[now], load[0, now], load[1, now], body, spall
        )
        for i in range(10):
            motion[step, i] = state[i]
        for i in range(5):
            acceleration[step, i] = first[5 + i]
        if step == steps:
            break
        half, full = now + 1, now + 2
        for i in range(10):
            there[i] = state[i] + 0.5 * step_s * first[i]
        derivatives(
            there, second, scratch, pitches, cage_rad[half], spot_rad[half], load[0, half], load[1, half], body, spall
        )
        for i in range(10):
            there[i] = state[i] + 0.5 * step_s * second[i]
        derivatives(
            there, third, scratch, pitches, cage_rad[half], spot_rad[half], load[0, half], load[1, half], body, spall
        )
        for i in range(10):
            there[i] = state[i] + step_s * third[i]
        derivatives(
            there, fourth, scratch, pitches, cage_rad[full], spot_rad[full], load[0, full], load[1, full], body, spall
        )
        for i in range(10):
            state[i] += step_s / 6.0 * (first[i] + 2.0 * second[i] + 2.0 * third[i] + fourth[i])
