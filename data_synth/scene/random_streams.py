"""Random generators and seeds by what they belong to, so that one more source leaves all others as they were."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

RandomStreams = Callable[..., np.random.Generator]  # a generator of its own for every word it is called with


def random_stream(seed: int, *words: str | int) -> np.random.Generator:
    """Return the random generator that belongs to words and numbers."""
    return np.random.default_rng(_sequence(seed, words))


def derived_seed(seed: int, *words: str | int) -> int:
    """Return the seed that belongs to words and numbers, below 2^63: HDF5 has signed ones."""
    return int(_sequence(seed, words).generate_state(1, np.uint64)[0] >> np.uint64(1))


def _sequence(seed: int, words: tuple[str | int, ...]) -> np.random.SeedSequence:
    keys = tuple(zlib.crc32(word.encode()) if isinstance(word, str) else int(word) for word in words)
    return np.random.SeedSequence(seed, spawn_key=keys)


_OF_A_MACHINE = ("phase", "gain", "cross axis", "carrier", "planet pass", "tachometer", "offset", "pits")
_IMPERFECT_PARTS = ("pitch", "planet positions", "planet loads", "imbalance", "gain", "mount")
_MOST_TURNS = 1 << 24  # of a machine before a record: a week at 1500 rpm


@dataclass(frozen=True, kw_only=True)
class Streams:
    """Random generators by words, those of what belongs to a machine from a seed of their own.

    Attributes
    ----------
    seed : int
        Of the record: speed, impacts, noise, and all else.
    machine_seed : int or None
        Of gear teeth, imbalance, phases, places of faults, mounts and gains of sensors; None for that of the record.
    """

    seed: int
    machine_seed: int | None = None

    def __call__(self, *words: str) -> np.random.Generator:
        """Return the random generator that belongs to `words`."""
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
        """Whole turns of the reference shaft that the machine has made before the record, since its phases were drawn.

        Without a machine of its own a record begins with them.
        """
        return 0 if self.machine_seed is None else int(random_stream(self.seed, "turns before").integers(_MOST_TURNS))
