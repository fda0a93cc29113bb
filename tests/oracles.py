"""Independent answers: slow and plain, sharing no line with the packages they judge."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Hinge:
    """Two bodies that turn about one line: their numbers, a point of the line and its direction, at the start."""

    bodies: tuple[int, int]
    direction: tuple[float, float, float]
    point: tuple[float, float, float] = (0, 0, 0)


@dataclass(frozen=True, kw_only=True)
class Gear:
    """The teeth of a body, about a line that moves with it; minus: internal, or behind the apex of a bevel gear."""

    body: int
    teeth: int
    axis: tuple[float, float, float]
    centre: tuple[float, float, float] = (0, 0, 0)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What `rolling_oracle` found.

    velocities : (n, 3), angular velocity vectors at the start
    poses : (n, 3, 3), rotation matrices at the end
    slip : the largest speed left at any contact or hinge, on the way
    open : dimensions of motion that the drives left open, on the way (0: everything is settled)
    """

    velocities: np.ndarray
    poses: np.ndarray
    slip: float
    open: int


def rolling_oracle(*, bodies, hinges, contacts, drives, duration=0.0, steps=0):
    """Turn rigid bodies whose pitch surfaces roll on each other, with nothing given but geometry.

    Every body has its full twist, six unknowns: angular velocity w and velocity v of the point at the origin.
    A hinge holds two points of its line together. A contact is where the pitch circles touch, found anew at
    each instant from where the two axes then are, and there the two material points move alike:
    ``v_i + w_i x P = v_j + w_j x P``. No carrier, no Willis equation, no tree of joints.
    Poses are carried forward by the classical Runge-Kutta method, error of order (turn per step)^4.

    Parameters
    ----------
    bodies : number of bodies; body 0 is at rest
    hinges : list of Hinge
    contacts : list of pairs of Gear
    drives : list of (body, direction, rate): the component of its angular velocity along a fixed direction
    duration, steps : how long to turn, in how many steps; 0: velocities at the start only
    """
    poses, origins = np.tile(np.eye(3), (bodies, 1, 1)), np.zeros((bodies, 3))
    worst, loose = 0.0, 0

    def rates(poses, origins):
        nonlocal worst, loose
        twists, slip, missing = _twists(poses, origins, hinges, contacts, drives)
        worst, loose = max(worst, slip), max(loose, missing)
        w, v = twists[:, :3], twists[:, 3:]
        # the body's own origin moves with v + w x p; the columns of its rotation matrix with w x column
        return np.cross(w[:, None, :], poses.transpose(0, 2, 1)).transpose(0, 2, 1), v + np.cross(w, origins), w

    velocities = rates(poses, origins)[2]
    h = duration / max(steps, 1)
    for _ in range(steps):
        stages = [rates(poses, origins)]
        for share in (0.5, 0.5, 1.0):
            turn, shift, _w = stages[-1]
            stages.append(rates(poses + share * h * turn, origins + share * h * shift))
        weights = h / 6 * np.array([1, 2, 2, 1])
        poses = poses + sum(k * stage[0] for k, stage in zip(weights, stages, strict=True))
        origins = origins + sum(k * stage[1] for k, stage in zip(weights, stages, strict=True))
    return Motion(velocities=velocities, poses=poses, slip=worst, open=loose)


def _twists(poses, origins, hinges, contacts, drives):
    """Solve hinges, contacts and drives for the twist of every body: (n, 6), the residual, the rank missing."""
    rows, right = [], []

    def equal_velocity(i, j, point):
        block = np.zeros((3, len(poses), 6))
        for body, sign in ((i, 1.0), (j, -1.0)):
            block[:, body, :3] = -sign * _cross_matrix(point)  # w x P = -[P]x w
            block[:, body, 3:] = sign * np.eye(3)
        rows.extend(block.reshape(3, -1))
        right.extend([0.0, 0.0, 0.0])

    still = np.eye(6, 6 * len(poses))
    rows.extend(still)
    right.extend([0.0] * 6)
    for hinge in hinges:
        i, j = hinge.bodies
        for along in (-1.0, 1.0):
            start = np.asarray(hinge.point, dtype=float) + along * _unit(hinge.direction)
            equal_velocity(i, j, poses[i] @ start + origins[i])
    for one, other in contacts:
        equal_velocity(one.body, other.body, _touching(one, other, poses, origins))
    for body, direction, rate in drives:
        row = np.zeros((len(poses), 6))
        row[body, :3] = _unit(direction)
        rows.append(row.ravel())
        right.append(rate)
    matrix, right = np.array(rows), np.array(right)
    solution, _, rank, _ = np.linalg.lstsq(matrix, right, rcond=1e-10)
    slip = np.abs(matrix @ solution - right).max()
    return solution.reshape(-1, 6), slip, matrix.shape[1] - rank


def _touching(one, other, poses, origins):
    """Return the point where two pitch surfaces touch: radii as teeth, cones with a common apex or cylinders."""
    axes, centres = [], []
    for gear in (one, other):
        axes.append(poses[gear.body] @ _unit(gear.axis))
        centres.append(poses[gear.body] @ np.asarray(gear.centre, dtype=float) + origins[gear.body])
    if np.linalg.norm(np.cross(*axes)) < 1e-9:
        # the pitch point divides the line of centres as the teeth, from outside where one gear is internal
        return (other.teeth * centres[0] + one.teeth * centres[1]) / (one.teeth + other.teeth)
    apex, gap = _crossing(axes, centres)
    assert gap < 1e-6, f"bevel axes miss each other by {gap}"
    # the common line of two cones is as far from either axis as that gear has teeth
    ahead = [np.sign(gear.teeth) * axis for gear, axis in zip((one, other), axes, strict=True)]
    return apex + abs(other.teeth) * ahead[0] + abs(one.teeth) * ahead[1]


def _crossing(axes, centres):
    """Return the point midway between two lines where they come closest, and the distance between them there."""
    along = np.linalg.lstsq(np.column_stack([axes[0], -axes[1]]), centres[1] - centres[0], rcond=None)[0]
    first, second = (centre + s * axis for centre, s, axis in zip(centres, along, axes, strict=True))
    return (first + second) / 2, np.linalg.norm(first - second)


def _unit(vector):
    vector = np.asarray(vector, dtype=float)
    return vector / np.linalg.norm(vector)


def _cross_matrix(p):
    return np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
