"""Independent answers: slow and plain, sharing no line with the packages they judge."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Gear:
    """The teeth of a body about a line through the apex; minus: internal, or behind the apex."""

    body: int
    teeth: int
    axis: tuple[float, float, float]


def rolling_oracle(*, bodies, hinges, contacts, drives):
    """Return the angular velocities (n, 3) of bevel gears that roll on each other about one apex, by geometry alone.

    Every body has its full twist, six unknowns: angular velocity w and velocity v of the point at the apex, the
    origin. A hinge holds two points of its line together. A contact is where the pitch cones touch, and there the two
    material points move alike: ``v_i + w_i x P = v_j + w_j x P``. No carrier, no Willis equation, no tree of joints.

    Parameters
    ----------
    bodies : number of bodies; body 0 is at rest
    hinges : list of (body, body, direction of the line about which they turn)
    contacts : list of pairs of Gear
    drives : list of (body, direction, rate): the component of its angular velocity along a fixed direction
    """
    rows, right = [*np.eye(6, 6 * bodies)], [0.0] * 6

    def equal_velocity(i, j, point):
        block = np.zeros((3, bodies, 6))
        for body, sign in ((i, 1.0), (j, -1.0)):
            block[:, body, :3] = -sign * _cross_matrix(point)  # w x P = -[P]x w
            block[:, body, 3:] = sign * np.eye(3)
        rows.extend(block.reshape(3, -1))
        right.extend([0.0, 0.0, 0.0])

    for i, j, direction in hinges:
        for along in (-1.0, 1.0):
            equal_velocity(i, j, along * _unit(direction))
    for one, other in contacts:
        # the common line of two cones is as far from either axis as that gear has teeth
        ahead = [np.sign(gear.teeth) * _unit(gear.axis) for gear in (one, other)]
        equal_velocity(one.body, other.body, abs(other.teeth) * ahead[0] + abs(one.teeth) * ahead[1])
    for body, direction, rate in drives:
        row = np.zeros((bodies, 6))
        row[body, :3] = _unit(direction)
        rows.append(row.ravel())
        right.append(rate)
    solution, _, rank, _ = np.linalg.lstsq(np.array(rows), np.array(right), rcond=1e-10)
    assert rank == 6 * bodies, "the drives leave some motion open"
    return solution.reshape(-1, 6)[:, :3]


def _unit(vector):
    vector = np.asarray(vector, dtype=float)
    return vector / np.linalg.norm(vector)


def _cross_matrix(p):
    return np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
