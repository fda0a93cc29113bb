"""Modes to the relative precision of the stiffnesses, and the exact flow of constant matrices in modal coordinates.

A gearbox that rotates freely has a rigid-body mode, whose angle grows without bound while meshes deflect by microns;
and bearings may be 1e10 times as stiff as teeth. Modal coordinates separate both: a mesh force has no component on a
rigid-body mode, and the flow of each mode is as exact for the fastest as for the slowest.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Array = NDArray[np.float64]

_PIVOT = 64 * np.finfo(float).eps  # of a stiffness scaled to a unit diagonal: less than this is rounding, so rigid
_ORTHOGONAL = 1e-12  # of the lengths of both vectors: less than this is rounding
_CLASSICAL = 1e-12


@dataclass(frozen=True, kw_only=True)
class Modes:
    """Mass-normalised modes, rigid ones first.

    ``frequencies`` (n,) in rad/s, exactly zero where rigid; ``shapes`` (dof, n), one column each.
    """

    frequencies: Array
    shapes: Array

    def rows(self, physical: Array) -> Array:
        """Return rows (r, dof) over displacements as rows over modes, with rounding on rigid-body modes set to zero."""
        modal = physical @ self.shapes
        sizes = np.linalg.norm(modal, axis=-1, keepdims=True)
        rigid = self.frequencies == 0
        modal[..., rigid] = np.where(np.abs(modal[..., rigid]) <= _ORTHOGONAL * sizes, 0.0, modal[..., rigid])
        return np.ascontiguousarray(modal)

    @property
    def scales(self) -> Array:
        """Factors that make modal displacements as large as velocities: the frequency, 1 for rigid-body modes."""
        return np.where(self.frequencies > 0, self.frequencies, 1.0)


def modes_of(mass: Array, stiffness: Array) -> Modes:
    """Return the modes of two symmetric matrices, frequencies exact relative to themselves.

    The stiffness, scaled to a unit diagonal, is factorised with pivoting, and the factor's singular values are
    found by Jacobi rotations (Demmel and Veselic 1992, SIAM J. Matrix Anal. Appl. 13, 1204): unlike those of a
    tridiagonal reduction they keep their digits where stiffnesses differ by many powers of ten.
    """
    size = mass.shape[0]
    root = linalg.cholesky(mass, lower=True)
    diagonal = np.diag(stiffness)
    unit = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    factor, pivots, rank, _ = linalg.lapack.dpstrf(stiffness * unit * unit[:, None], tol=_PIVOT * size)
    if rank == 0:
        return Modes(frequencies=np.zeros(size), shapes=linalg.solve_triangular(root.T, np.eye(size)))
    columns = np.zeros((size, rank))
    columns[pivots - 1] = np.triu(factor)[:rank].T
    graded = linalg.solve_triangular(root, columns / unit[:, None], lower=True)
    values, left, _, work, _, info = linalg.lapack.dgejsv(graded, joba=2, jobu=0, jobv=3)
    if info != 0:
        raise ArithmeticError(f"Jacobi rotations did not converge on {size} degrees of freedom (dgejsv: {info}).")
    rigid = linalg.qr(left)[0][:, rank:]
    rising = np.argsort(values)
    frequencies = np.concatenate([np.zeros(size - rank), values[rising] * (work[0] / work[1])])
    vectors = np.hstack([rigid, left[:, rising]])
    return Modes(frequencies=frequencies, shapes=linalg.solve_triangular(root.T, vectors))


@dataclass(frozen=True, kw_only=True)
class Flow:
    """``x' = generator x + drive`` with x = (scales y, y'), y modal; `classical` where the damping is diagonal.

    `damping` (n, n) is the modal one, 1/s, gyroscopic part included.
    """

    modes: Modes
    damping: Array
    drive: Array
    classical: bool

    @property
    def generator(self) -> Array:
        """The matrix, (2 n, 2 n): skew-symmetric without damping and rigid-body modes."""
        size = self.damping.shape[0]
        matrix = np.zeros((2 * size, 2 * size))
        matrix[:size, size:] = np.diag(self.modes.scales)
        matrix[size:, :size] = -np.diag(self.modes.frequencies)
        matrix[size:, size:] = -self.damping
        return matrix

    def over(self, time_s: float) -> tuple[Array, Array]:
        """Return propagator and part of the constant load over a time, ``x(t + time) = P x(t) + d``."""
        if self.classical:
            return self._mode_by_mode(time_s)
        size = self.drive.size
        augmented = np.zeros((size + 1, size + 1))
        augmented[:size, :size], augmented[:size, size] = self.generator, self.drive
        exponential = linalg.expm(augmented * time_s)
        return exponential[:size, :size], exponential[:size, size]

    def _mode_by_mode(self, t: float) -> tuple[Array, Array]:
        """Return the same from the closed form of each mode, without the rounding of repeated squaring."""
        size = self.damping.shape[0]
        propagator, added = np.zeros((2 * size, 2 * size)), np.zeros(2 * size)
        for i, (w, c) in enumerate(zip(self.modes.frequencies, np.diag(self.damping), strict=True)):
            force = self.drive[size + i]
            if w == 0:
                slow = -np.expm1(-c * t) / c if c else t
                square = (t - slow) / c if abs(c * t) > _CLASSICAL else t * t / 2
                block, gain = np.array([[1.0, slow], [0.0, np.exp(-c * t)]]), np.array([square, slow])
            else:
                block = _oscillator_propagator(w, c / 2, t)
                gain = np.array([_step_response(w, c / 2, t, block[0, 0]), block[0, 1]]) / w
            propagator[np.ix_([i, size + i], [i, size + i])] = block
            added[[i, size + i]] = gain * force
        return propagator, added


def _oscillator_propagator(w: float, decay: float, t: float) -> Array:
    """Return the propagator of (w y, y') where ``y'' + 2 decay y' + w^2 y = 0``."""
    inner = np.sqrt(complex(w * w - decay * decay))
    swing = np.cos(inner * t).real
    sine = (np.sin(inner * t) / inner).real if abs(inner) * t > _CLASSICAL else t
    fading = np.exp(-decay * t)
    return np.asarray(fading * np.array([[swing + decay * sine, w * sine], [-w * sine, swing - decay * sine]]))


def _step_response(w: float, decay: float, t: float, p11: float) -> float:
    """Return ``1 - p11``, the step response w y / load, to full relative precision for short times as well."""
    if decay == 0:
        return float(2 * np.sin(w * t / 2) ** 2)
    if (w + 2 * decay) * t > 1:
        return 1 - p11
    # the power series of u'' + 2 decay u' + w^2 u = w^2 from rest
    before, term, power = 0.0, (w * t) ** 2 / 2, 2
    total = term
    while abs(term) > np.finfo(float).eps * total / 4:
        before, term = term, -(2 * decay * t * power * term + (w * t) ** 2 * before) / (power * (power + 1))
        total, power = total + term, power + 1
    return total


def flow_of(modes: Modes, damping: Array, force: Array) -> Flow:
    """Return the flow under physical damping (dof, dof) and a constant force (dof,)."""
    modal = modes.shapes.T @ damping @ modes.shapes
    off_diagonal = np.abs(modal - np.diag(np.diag(modal))).max()
    classical = bool(off_diagonal <= _CLASSICAL * np.abs(modal).max())
    return Flow(
        modes=modes,
        damping=np.diag(np.diag(modal)) if classical else modal,
        drive=np.concatenate([np.zeros(modal.shape[0]), modes.shapes.T @ force]),
        classical=classical,
    )
