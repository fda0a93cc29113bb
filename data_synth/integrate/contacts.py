"""Exact steps of meshes with backlash: linear between the instants at which teeth lose or regain contact."""

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

MAX_BACKLASHES = 3  # a mesh with backlash has three contact states, and each combination of states its own series
_UNKNOWN = -2


def meshes_with_backlash(a: Assembled) -> Integers:
    """Return the numbers of the meshes with backlash."""
    return np.flatnonzero(a.backlashes > 0)


def contact_stepper(readings: Readings, grid: Grid) -> Stepper:
    """Return a stepper for at most `MAX_BACKLASHES` meshes with backlash."""
    a, integrals = readings.assembled, ForceIntegrals.of(readings)
    meshes = meshes_with_backlash(a)
    deflection_rows = a.displacement_rows(a.deflections[meshes])
    halvings, terms = halvings_and_terms(a, grid.step_s)
    return _Stepper(
        readings=readings,
        grid=grid,
        series_fraction=0.5**halvings,
        terms=terms,
        deflection_rows=np.hstack([deflection_rows, np.zeros((meshes.size, 2 * integrals.meshes))]),
        integrals=integrals,
        half_gaps=a.backlashes[meshes],
        contact=np.full(meshes.size, _UNKNOWN),
    )


@dataclass(frozen=True, kw_only=True)
class _Stepper:
    readings: Readings
    grid: Grid
    integrals: ForceIntegrals
    series_fraction: float  # of a sample interval: what a power series covers
    terms: int
    deflection_rows: Array
    half_gaps: Array
    contact: Integers  # 1 on the driving flank, -1 on the back flank, 0 without: state of the stepper beside x

    def advance(self, x: Array, first: int, samples: int) -> Array:
        """Integrate over samples; see `Stepper.advance`."""
        from data_synth.integrate._contact_kernels import contact_steps  # noqa: PLC0415

        if np.any(self.contact == _UNKNOWN):
            deflections = self.deflection_rows[:, : x.size] @ x
            self.contact[:] = np.sign(deflections) * (np.abs(deflections) > self.half_gaps)
        read, grid = self.readings, self.grid
        start_s = grid.at(first)
        switches, stiffnesses = switching(read.assembled, start_s, grid.at(first + samples))
        used, combinations = np.unique(stiffnesses, axis=0, return_inverse=True)
        series_of = [self._power_series(row) for row in used]
        rows, constant = self.integrals.rows
        self.integrals.begin(x, start_s)
        out, state = np.empty((samples, rows.shape[0])), self.integrals.augmented(x)
        contact_steps(
            state,
            self.contact,
            out,
            rows,
            constant,
            start_s,
            grid.step_s,
            self.series_fraction,
            switches,
            combinations.ravel(),
            np.stack([terms_of_state for terms_of_state, _ in series_of]),
            np.stack([terms_of_load for _, terms_of_load in series_of]),
            self.deflection_rows,
            self.half_gaps,
            x.size,
        )
        x[:] = state[: x.size]
        return self.integrals.read(out, grid, first)

    def _power_series(self, stiffnesses: Array) -> tuple[Array, Array]:
        """Return the power series of every combination of contact states, the last mesh's changing first."""
        a, meshes = self.readings.assembled, meshes_with_backlash(self.readings.assembled)
        found = []
        for contact in product((-1, 0, 1), repeat=meshes.size):
            stiffness_values, shift = stiffnesses.copy(), np.zeros_like(stiffnesses)
            stiffness_values[meshes] *= np.abs(contact)
            shift[meshes] = np.array(contact) * self.half_gaps
            generator, drive = a.flow.generator.copy(), a.flow.drive.copy()
            deflection_rows = a.deflections / a.flow.modes.scales
            generator[a.size :, : a.size] -= (a.deflections.T * (stiffness_values - a.means)) @ deflection_rows
            drive[a.size :] += a.deflections.T @ (stiffness_values * shift)
            generator, drive = self.integrals.augmented_equations(
                generator, drive, stiffness_values, shift, self.grid.step_s
            )
            terms_of_state, terms_of_load = series(
                generator, drive, self.series_fraction * self.grid.step_s, self.terms
            )
            found.append((columns(terms_of_state), terms_of_load.ravel()))
        return np.stack([terms_of_state for terms_of_state, _ in found]), np.stack(
            [terms_of_load for _, terms_of_load in found]
        )
