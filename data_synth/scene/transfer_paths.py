"""Frequency response functions from a source to a sensor, as a scene declares them: modal or measured."""

from collections.abc import Collection, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from data_synth.scene.operation import Finite, csv_rows
from hums.gearbox.components import Declared, Name, Positive, closest

Line = tuple[Finite, Finite, Finite]


class ModeOfPath(Declared):
    """One mode of a frequency response: `gain` is its static response, ``gain / (2 zeta)`` that at resonance.

    In place of `gain` its `residue` (real, imaginary) may be given, in response per N s, as modal analysis has it: the
    mode is ``A / (j w - p) + conj(A) / (j w - conj(p))``.
    """

    frequency_hz: Positive
    damping_ratio: Annotated[float, Field(gt=0, lt=1)]
    gain: Finite | None = None
    residue: tuple[Finite, Finite] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.gain is None) == (self.residue is None):
            given = "both given; keep one" if self.gain is not None else "both missing; give one"
            raise ValueError(f"gain and residue of the mode at {self.frequency_hz:g} Hz are {given}")
        return self


class Transfer(Declared):
    """The transfer function from a source (bearing, mesh or link) to a sensor: response in `units` for a force of 1 N.

    Given by `modes`; or by measured `lines` (Hz, real, imaginary), or the same three columns in a `csv` file beside the
    scene: linear between lines, zero outside them. It replaces drawn gains, `path`, `resonance`, `cross_axis` and,
    where gears vibrate, the housing: amplitudes of its source are then in N, of impacts in N s.
    """

    source: Name
    sensor: Name
    units: Literal["g", "m s-2"]
    modes: Annotated[tuple[ModeOfPath, ...], Field(min_length=1)] | None = None
    lines: Annotated[tuple[Line, ...], Field(min_length=2)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _read(cls, table: Any) -> Any:  # noqa: ANN401
        """Refuse a response given twice; read it where it is in a file."""
        if not isinstance(table, dict):
            return table
        given = [key for key in ("modes", "lines", "csv") if table.get(key) is not None]
        if len(given) != 1:
            said = f"{' and '.join(given)} are both given; keep one" if given else "give modes, lines or csv"
            raise ValueError(f"the response of {table.get('source')} at {table.get('sensor')} is one thing: {said}")
        if "csv" not in table:
            return table
        kept = {key: value for key, value in table.items() if key != "csv"}
        return kept | {"lines": csv_rows(Path(table["csv"]), "Hz", "real", "imaginary")}

    @model_validator(mode="after")
    def _check(self) -> Self:
        frequencies = [line[0] for line in self.lines or ()]
        for before, after in pairwise([-1.0, *frequencies]):
            if after <= before or after < 0:
                raise ValueError(f"lines: {after:g} Hz follows {max(before, 0):g} Hz; sort them from 0 or above")
        return self


def check_transfers(transfers: Iterable[Transfer], *, sources: Collection[str], sensors: Collection[str]) -> None:
    """Raise ValueError for an unknown source or sensor, and for a pair that is given twice."""
    seen = set()
    for transfer in transfers:
        for word, name, valid in (("source", transfer.source, sources), ("sensor", transfer.sensor, sensors)):
            if name not in valid:
                raise ValueError(f'transfer names the {word} "{name}"{closest(name, [*valid])}')
        if (pair := (transfer.source, transfer.sensor)) in seen:
            raise ValueError(f'two transfers lead from "{pair[0]}" to "{pair[1]}"; keep one')
        seen.add(pair)
