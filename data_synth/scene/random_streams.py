"""Random generators and seeds derived from names, so that an added source leaves all others unchanged."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

RandomStreams = Callable[..., np.random.Generator]  # returns a separate generator for each set of words


def random_stream(seed: int, *words: str | int) -> np.random.Generator:
    """Return the random generator of a seed and a name of words and numbers."""
    return np.random.default_rng(_sequence(seed, words))


def derived_seed(seed: int, *words: str | int) -> int:
    """Return the seed derived from a seed and a name of words and numbers, below 2^63 since HDF5 has signed ones."""
    return int(_sequence(seed, words).generate_state(1, np.uint64)[0] >> np.uint64(1))


def _sequence(seed: int, words: tuple[str | int, ...]) -> np.random.SeedSequence:
    keys = tuple(zlib.crc32(word.encode()) if isinstance(word, str) else int(word) for word in words)
    return np.random.SeedSequence(seed, spawn_key=keys)


_OF_A_MACHINE = ("phase", "gain", "cross axis", "carrier", "planet pass", "tachometer", "offset", "pits")
_IMPERFECT_PARTS = ("pitch", "planet positions", "planet loads", "imbalance", "gain", "mount")
_MOST_TURNS = 1 << 24  # revolutions before a record: a week at 1500 rpm


@dataclass(frozen=True, kw_only=True)
class Streams:
    """Random generators by words, with a separate seed for the properties of the machine.

    Attributes
    ----------
    seed : int
        Seed of the record: speed, impacts, noise, and everything else.
    machine_seed : int or None
        Seed of gear teeth, imbalance, phases, places of faults, mounts and gains of sensors; None for that of the
        record.
    """

    seed: int
    machine_seed: int | None = None

    def __call__(self, *words: str) -> np.random.Generator:
        """Return the random generator of `words`."""
        parts = words[1:2] if words[0] == "imperfection" else words[:1]
        own = "gain" in words or any(part in (*_OF_A_MACHINE, *_IMPERFECT_PARTS) for part in parts)
        return random_stream(self.machine_seed if own and self.machine_seed is not None else self.seed, *words)

    @property
    def attrs(self) -> dict[str, int]:
        """The seeds as attributes of a record."""
        own = {} if self.machine_seed is None else {"truth_machine_seed": self.machine_seed}
        return {"truth_seed": self.seed, **own}

    @property
    def turns_before(self) -> int:
        """Whole revolutions of the reference shaft before the record, since the phases of the machine were drawn.

        Zero without a machine seed.
        """
        return 0 if self.machine_seed is None else int(random_stream(self.seed, "turns before").integers(_MOST_TURNS))
