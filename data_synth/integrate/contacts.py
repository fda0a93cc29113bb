"""Exact steps of teeth that part and meet, where nothing else keeps the motion from being linear."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from data_synth.integrate.assembled import Assembled
from data_synth.integrate.pieces import ForceIntegrals, columns, halvings_and_terms, series, switching
from data_synth.integrate.problem import Array
from data_synth.integrate.readings import Readings
from data_synth.integrate.stepping import Grid, Stepper

Integers = NDArray[np.int64]

MOST_GAPS = 3  # every mesh with a gap has three ways to touch, and each combination of them its own series
_UNKNOWN = -2


def gaps_of(a: Assembled) -> Integers:
    """Return the numbers of the meshes that have backlash."""
    return np.flatnonzero(a.backlashes > 0)


def contact_stepper(readings: Readings, grid: Grid) -> Stepper:
    """Return a stepper for at most `MOST_GAPS` meshes with backlash."""
    a, integrals = readings.assembled, ForceIntegrals.of(readings)
    gaps = gaps_of(a)
    seen = a.displacement_rows(a.deflections[gaps])
    halvings, terms = halvings_and_terms(a, grid.step_s)
    return _Stepper(
        readings=readings,
        grid=grid,
        share=0.5**halvings,
        terms=terms,
        seen=np.hstack([seen, np.zeros((gaps.size, 2 * integrals.meshes))]),
        integrals=integrals,
        half_gaps=a.backlashes[gaps],
        touching=np.full(gaps.size, _UNKNOWN),
    )


@dataclass(frozen=True, kw_only=True)
class _Stepper:
    readings: Readings
    grid: Grid
    integrals: ForceIntegrals
    share: float  # of a sample's time: what a power series covers
    terms: int
    seen: Array
    half_gaps: Array
    touching: Integers  # 1 where driving flanks touch, -1 where their backs do, 0 where none: remembered beside x

    def advance(self, x: Array, first: int, samples: int) -> Array:
        from data_synth.integrate._contact_kernels import contact_steps  # noqa: PLC0415

        if np.any(self.touching == _UNKNOWN):
            deflections = self.seen[:, : x.size] @ x
            self.touching[:] = np.sign(deflections) * (np.abs(deflections) > self.half_gaps)
        read, grid = self.readings, self.grid
        start_s = grid.at(first)
        switches, stiffnesses = switching(read.assembled, start_s, grid.at(first + samples))
        used, kinds = np.unique(stiffnesses, axis=0, return_inverse=True)
        flows = [self._series_under(row) for row in used]
        rows, constant = self.integrals.rows
        self.integrals.begin(x, start_s)
        out, state = np.empty((samples, rows.shape[0])), self.integrals.longer(x)
        contact_steps(
            state,
            self.touching,
            out,
            rows,
            constant,
            start_s,
            grid.step_s,
            self.share,
            switches,
            kinds.ravel(),
            np.stack([powered for powered, _ in flows]),
            np.stack([pushed for _, pushed in flows]),
            self.seen,
            self.half_gaps,
            x.size,
        )
        x[:] = state[: x.size]
        return self.integrals.read(out, grid, first)

    def _series_under(self, stiffnesses: Array) -> tuple[Array, Array]:
        """Return the power series for every way to touch, the last mesh's changing first."""
        a, gaps = self.readings.assembled, gaps_of(self.readings.assembled)
        found = []
        for touching in product((-1, 0, 1), repeat=gaps.size):
            held, shift = stiffnesses.copy(), np.zeros_like(stiffnesses)
            held[gaps] *= np.abs(touching)
            shift[gaps] = np.array(touching) * self.half_gaps
            generator, drive = a.flow.generator.copy(), a.flow.drive.copy()
            seen = a.deflections / a.flow.modes.scales
            generator[a.size :, : a.size] -= (a.deflections.T * (held - a.means)) @ seen
            drive[a.size :] += a.deflections.T @ (held * shift)
            generator, drive = self.integrals.joined(generator, drive, held, shift, self.grid.step_s)
            powered, pushed = series(generator, drive, self.share * self.grid.step_s, self.terms)
            found.append((columns(powered), pushed.ravel()))
        return np.stack([powered for powered, _ in found]), np.stack([pushed for _, pushed in found])
