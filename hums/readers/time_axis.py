"""Declarations about a foreign file against what the file states: rates, sample times, starts, units."""

import math
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hums.readers.columns import ForeignFile, Stated, descriptions
from hums.readers.description import ImportDescription
from hums.records.clock import SampleTimes, is_time_name, rates_agree, sample_times, time_scale, words_of
from hums.records.fields import RecordError

_LONGEST_START_S, _LATEST_S = 1e8, 3e9  # three years: larger numbers count from a date; from 1970 they reach 2065


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Sampling of a field: rate, time of the first sample in s after `epoch`, and sample times if stated."""

    rate_hz: float
    start_s: float
    epoch: datetime | None
    times: SampleTimes | None

    def filled(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return samples with NaN where the sample times skip some."""
        return values if self.times is None else self.times.filled(values)


@dataclass(frozen=True, kw_only=True)
class Import:
    """A file, the declarations about it, and notes on decisions between the two.

    Attributes
    ----------
    file : ForeignFile
        File that is read.
    spec : ImportDescription
        Declarations.
    notes : list of str
        Notes for the record.
    found, clocks : dict
        Results so far, by column of times and by field.
    """

    file: ForeignFile
    spec: ImportDescription
    notes: list[str] = field(default_factory=list)
    found: dict[str, tuple[SampleTimes, datetime | None] | None] = field(default_factory=dict)
    clocks: dict[str, Clock] = field(default_factory=dict)

    def settle(self, contradiction: str, declared: Any, stated: Any, *, remedy: str = "") -> Any:  # noqa: ANN401
        """Return the trusted one of two values; raise RecordError if none is declared to prevail."""
        if self.spec.trust is None:
            raise RecordError(
                f'{contradiction}. {remedy}{"Or state" if remedy else "State"} which prevails, trust="declared" or '
                'trust="file" (--trust).'
            )
        self.note(f"{contradiction}; {'the file' if self.spec.trust == 'file' else 'the declaration'} was trusted")
        return declared if self.spec.trust == "declared" else stated

    def note(self, text: str) -> None:
        """Add a note for the record, once."""
        if text not in self.notes:
            self.notes.append(text)

    @property
    def sampled(self) -> list[str]:
        """Names of the channels, and of a sampled tachometer."""
        return [*self.spec.channels, *([self.spec.tach_waveform] if self.spec.tach_waveform else [])]

    def of(self, name: str) -> Clock:
        """Return the clock of a field; raise RecordError if its rate is unknown or contradictory."""
        if name not in self.clocks:
            self.clocks[name] = self._clock(name)
        return self.clocks[name]

    def _clock(self, name: str) -> Clock:
        stated = self.file.metadata(name)
        columns = [(title, found) for title in self._columns(name) if (found := self._times(title)) is not None]
        if stated.times_s is not None and (times := self._sample_times(stated.times_s, 1.0, f'the times of "{name}"')):
            columns.append((name, (times, stated.epoch)))
        columns.sort(key=lambda column: column[1][0].resolution)
        rate_hz = self._rate_hz(stated, [(title, times) for title, (times, _) in columns])
        times, epoch = columns[0][1] if columns else (None, None)
        start_s = times.start_s if times is not None and stated.start_s is None else stated.start_s or 0.0
        epoch = stated.epoch or epoch if stated.start_s is not None else epoch
        for _, (other, since) in columns:
            if epoch is None and since is not None:  # a column of dates, and a finer one of seconds
                epoch = since + timedelta(seconds=other.start_s - start_s)
        since_1970 = datetime(1970, 1, 1, tzinfo=UTC)
        if abs(start_s) > _LONGEST_START_S:
            if epoch is None:
                epoch = since_1970 if 0 < start_s < _LATEST_S else None
                counted = "were taken to count from 1970" if epoch else "count from an unknown date"
                self.note(f"its times, which begin at {start_s:.14g} s, {counted}")
            start_s, epoch = 0.0, None if epoch is None else epoch + timedelta(seconds=start_s)
        epoch = epoch or stated.epoch
        trusted = times is not None and rates_agree(rate_hz, times.rate_hz, resolution=times.resolution)
        return Clock(rate_hz=rate_hz, start_s=start_s, epoch=epoch, times=times if trusted else None)

    def _rate_hz(self, stated: Stated, columns: list[tuple[str, SampleTimes]]) -> float:
        """Return the declared rate, that stated by the file or that of the finest times; refuse contradictions."""
        file, declared = self.file, self.spec.rate_hz
        rates = [] if stated.rate_hz is None else [(stated.rate_hz, 0.0, f"which states {stated.rate_hz:g} Hz")]
        for title, times in columns:
            step = f'whose "{title}" goes in steps of {1 / times.rate_hz:.6g} s, {times.rate_hz:.6g} Hz'
            step = f'whose "{title}" is rounded to a rate {times.range_text}' if times.coarse else step
            rates.append((times.rate_hz, times.resolution, step))
        self._note_unread_times()
        if declared is None and (not rates or (stated.rate_hz is None and columns[0][1].coarse)):
            known = f", {rates[0][2]} only" if rates else " does not state its sampling rate"
            needed = f"{file.path.name}{known}: rate_hz=... (--rate-hz) is needed"
            raise RecordError(". ".join([needed, *self.notes, ""]).strip())
        rate_hz = rates[0][0] if declared is None else declared
        for other_hz, resolution, phrase in rates[declared is None :]:
            if not rates_agree(rate_hz, other_hz, resolution=resolution):
                contradiction = f"{file.path.name} states {rate_hz:g} Hz, but {phrase[6:]}"
                if declared is not None:
                    contradiction = f"rate_hz={rate_hz:g} contradicts {file.path.name}, {phrase}"
                remedy = "Correct --rate-hz or leave it out, or state the unit of the times, time_unit. "
                rate_hz = self.settle(contradiction, rate_hz, other_hz, remedy=remedy)
        return rate_hz

    def _note_unread_times(self) -> None:
        for title, shape in descriptions(self.file.fields).items():
            named = is_time(self.file, title) or "date" in words_of(title)
            if named and isinstance(shape, str) and shape != "empty":
                self.note(f'"{title}" is {shape}, and is ignored')

    def _columns(self, name: str) -> list[str]:
        """Return the columns of times that have as many values as a field, in the innermost group with any."""
        file, spec = self.file, self.spec
        count, key = file.vector(name).size, file.name(name)
        used = {file.name(one) for one in (*self.sampled, spec.tach_times) if one}
        declared = spec.time_column and file.name(spec.time_column)
        found = [
            title
            for title, shape in descriptions(file.fields).items()
            if not isinstance(shape, str)
            and max(shape, default=0) == math.prod(shape) == count > 1
            and title not in used
            and (title == declared or is_time(file, title))
        ]
        groups = {title: title.rpartition(".")[0] for title in found}
        around = [group for group in groups.values() if not group or key.startswith(f"{group}.")]
        inner = max(around, key=len, default=None)
        return [title for title in found if title == declared or groups[title] == inner]

    def _times(self, title: str) -> tuple[SampleTimes, datetime | None] | None:
        """Return the sample times in a column, and the moment from which they count."""
        if title not in self.found:
            file, spec = self.file, self.spec
            scale = file.time_scale(title)
            values = file.vector(title)
            for note in file.stated.get(title, Stated()).notes:
                self.note(f'"{title}" {note}')
            if scale is None and spec.time_unit is None:  # since 1970 in the only unit with a date in this century
                units = (
                    unit for unit in (1.0, 1e-3, 1e-6, 1e-9) if _LONGEST_START_S < unit * float(values[0]) < _LATEST_S
                )
                scale = next(((unit, None) for unit in units), None)
            elif spec.time_unit is not None:
                unit = (time_scale(spec.time_unit) or (1.0, None))[0]
                if scale is not None and scale[0] != unit:
                    header = f'whose header says "{title}"' if title not in file.stated else f'whose "{title}" states'
                    contradiction = f'time_unit="{spec.time_unit}" contradicts {file.path.name}, {header}, in units of '
                    unit = self.settle(f"{contradiction}{scale[0]:g} s", unit, scale[0])
                scale = unit, None if scale is None else scale[1]
            if scale is None and spec.rate_hz is None:
                raise RecordError(
                    f'{file.path.name}: the header "{title}" does not state the unit of its times; declare it, '
                    'time_unit="ms", write it as in "time (s)", or declare rate_hz=... (--rate-hz).'
                )
            unit, epoch = scale or (1.0, None)
            times = None
            # "T" may be a torque or a temperature
            if len(title.rpartition(".")[2]) > 1 or np.all(np.diff(values) >= 0):
                times = self._sample_times(values, unit, f'the times in "{title}"')
            self.found[title] = None if times is None else (times, epoch)
        return self.found[title]

    def _sample_times(self, values: NDArray[Any], unit_s: float, what: str) -> SampleTimes | None:
        try:
            found = sample_times(values, unit_s=unit_s, what=f"{self.file.path.name}: {what}")
        except RecordError as error:
            if self.spec.trust != "declared" or self.spec.rate_hz is None:
                raise
            self.note(f"{str(error).partition('. ')[0]}; the declared rate was trusted")
            return None
        if found is not None and found.places is not None:
            missing = int(found.places[-1]) + 1 - found.places.size
            self.note(f"{what} skip {missing} samples, which are NaN")
        return found

    def start_and_epoch(self) -> tuple[float, datetime | None]:
        """Return the common start and epoch of all sampled fields; refuse starts over half a sample apart."""
        clocks = {name: self.of(name) for name in self.sampled}
        (first, clock), *others = clocks.items()
        for name, other in others:
            late_s = other.start_s - clock.start_s
            if clock.epoch is not None and other.epoch is not None:
                late_s += (other.epoch - clock.epoch).total_seconds()
            if abs(late_s) * clock.rate_hz > 0.5:  # noqa: PLR2004
                raise RecordError(
                    f'{self.file.path.name}: "{name}" begins {late_s:g} s after "{first}"; a record has one '
                    "clock. Convert them separately, or cut them to the same span."
                )
        return clock.start_s, clock.epoch


def is_time(file: ForeignFile, title: str) -> bool:
    """Return whether a field holds sample times, by its name and units."""
    stated = file.stated.get(title, Stated())
    if time_scale(stated.units) is not None:
        return stated.epoch is not None or is_time_name(stated.title or title)
    return stated.units is None and is_time_name(stated.title or title)


def seconds_of(file: ForeignFile, name: str, *, epoch: datetime | None) -> NDArray[Any]:
    """Return event times in s after an epoch, from the unit and epoch that their name or an attribute states."""
    values = file.vector(name)
    unit_s, since = file.time_scale(name) or (1.0, None)
    late_s = 0.0 if epoch is None or since is None else (since - epoch).total_seconds()
    return values if unit_s == 1.0 and not late_s else values.astype(np.float64) * unit_s + late_s
