"""Which samples the channels of a record have: those that miss the same ones share all but their data."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from signals.harmonics.model import Floats, Indices

_Values = TypeVar("_Values", bound=NDArray[Any])


@dataclass(frozen=True, kw_only=True, eq=False)
class Patterns:
    """The patterns of missing samples in a record, and the way from what was found for each back to its channels.

    Attributes
    ----------
    record : (channel, sample) array, NaN where a sample is missing.
    seen : (sample,) arrays, one for each pattern, where its samples are there.
    of_channel : (channel,) array, the number of the pattern each has.
    """

    record: Floats
    seen: list[NDArray[np.bool_]]
    of_channel: Indices

    @classmethod
    def of(cls, record: Floats) -> "Patterns":
        """Find the patterns of a record."""
        numbers: dict[bytes, int] = {}
        masks: list[NDArray[np.bool_]] = []
        of_channel = np.empty(len(record), dtype=np.int64)
        for channel, values in enumerate(record):
            whole = not np.isnan(values.max())
            seen = np.ones(values.size, dtype=np.bool_) if whole else ~np.isnan(values)
            key = b"" if whole else seen.tobytes()
            if key not in numbers:
                numbers[key] = len(masks)
                masks.append(seen)
            of_channel[channel] = numbers[key]
        return cls(record=record, seen=masks, of_channel=of_channel)

    @property
    def first_channels(self) -> list[int]:
        """The first channel of each pattern."""
        return [self.of_channel.tolist().index(number) for number in range(len(self.seen))]

    @property
    def records(self) -> list[Floats]:
        """The channels of each pattern."""
        if len(self.seen) == 1:
            return [self.record]
        return [self.record[self.of_channel == number] for number in range(len(self.seen))]

    def joined(self, parts: list[_Values]) -> _Values:
        """(channel, ...) array from those of the channels of each pattern."""
        return parts[0] if len(parts) == 1 else np.concatenate(parts)[self._place]  # type: ignore[return-value]

    def shared(self, parts: list[_Values]) -> _Values:
        """(channel, ...) array of what all channels of a pattern have in common; a view where they all do."""
        if len(parts) == 1:
            one = parts[0][None]
            return one if self.of_channel.size == 1 else np.broadcast_to(one, (self.of_channel.size, *one.shape[1:]))  # type: ignore[return-value]
        return np.stack(parts)[self.of_channel]  # type: ignore[return-value]

    @cached_property
    def _place(self) -> Indices:
        return np.argsort(np.argsort(self.of_channel, kind="stable"))
