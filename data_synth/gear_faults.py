"""What damage of a gear changes over one of its turns, and nothing more.

Each damage has a shape in the angle of its gear, 1 where it is worst. A kinematic scene lets the shape modulate the
mesh (`data_synth.faults.damage_comb`) and takes its strikes (`damage_trains`). A scene with mechanics takes
`ToothChanges`: tooth by tooth what is cracked, missing or worn off.

Turns count from where the damaged tooth is in the middle of its mesh, one from there to the next time.
"""

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from data_synth.profile import Array

Strikes = tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True)
class ToothChanges:
    """How a damaged gear departs from a sound one, tooth by tooth from the damaged one on.

    Attributes
    ----------
    crack_m : (z,) array
        Depth of a crack in the root of each tooth, m: takes stiffness by the model of the tooth.
    carrying : (z,) array
        Share of the face width of each tooth that carries: stiffness is in proportion. 1 is sound, 0 a tooth gone.
    removed_m : (z,) array
        Material missing on each flank along the line of action, m: a transmission error while the tooth carries.
    runout_m : float
        Eccentricity of the pitch circle, m: a transmission error ``runout_m cos(2 pi turns)``.
    profile_m : float
        Material missing alike on every flank where it slides, none at the pitch point: a transmission error
        ``profile_m (1 - cos(4 pi phase)) / 2`` in the phase of the mesh, the pitch point at phase 0.
    """

    crack_m: Array = field(metadata={"dims": ("tooth",), "units": "m"})
    carrying: Array = field(metadata={"dims": ("tooth",), "units": "1"})
    removed_m: Array = field(metadata={"dims": ("tooth",), "units": "m"})
    runout_m: float = 0.0
    profile_m: float = 0.0


class GearDamage(Protocol):
    """One kind of damage; its size comes with each question, since it may grow."""

    def finest(self, teeth: float) -> float:
        """Return the width of the finest feature of the shape, in turns."""

    def shape(self, turns: ArrayLike, *, teeth: float) -> Array:
        """Return what modulates the mesh at `turns` (n,) of the gear: 1 at the worst place of damage."""

    def harmonic_share(self, harmonic: ArrayLike) -> Array:
        """Return how strongly mesh harmonics (k,), from 1, rise beside the first."""

    def strikes(self, teeth: float) -> Strikes:
        """Return the impacts of a turn: when, in turns, and how hard."""

    def changes(self, size_m: float, *, teeth: int) -> ToothChanges:
        """Return what damage of `size_m` changes in the mechanics of a gear of `teeth`."""


def window(turns: ArrayLike, *, width_turns: float) -> Array:
    """Return ``exp(kappa (cos 2 pi turns - 1))``: 1 at whole turns, 1/2 half a width beside them.

    Smooth and periodic, so its Fourier coefficients, ``exp(-kappa) I_k(kappa)``, fall fast.
    """
    kappa = math.log(2) / (1 - math.cos(math.pi * width_turns))
    return np.asarray(np.exp(kappa * (np.cos(2 * np.pi * np.asarray(turns, dtype=np.float64)) - 1)))


def lag_of_error(error_m: float, *, module_m: float, pressure_angle_rad: float) -> float:
    """Return by how much an error along the line of action turns the first mesh harmonic: 2 pi a base pitch, in rad."""
    return 2 * math.pi * error_m / (math.pi * module_m * math.cos(pressure_angle_rad))


def _sound(teeth: int) -> tuple[Array, Array, Array]:
    return np.zeros(teeth), np.ones(teeth), np.zeros(teeth)


class _Local:
    """Damage of one tooth: felt while that tooth is in mesh, all harmonics alike."""

    def finest(self, teeth: float) -> float:
        """Return the width of the finest feature of the shape, in turns."""
        return 1 / teeth

    def shape(self, turns: ArrayLike, *, teeth: float) -> Array:
        """Return one tooth's window at `turns` (n,) of the gear."""
        return window(turns, width_turns=1 / teeth)

    def harmonic_share(self, harmonic: ArrayLike) -> Array:
        """Return 1: every mesh harmonic (k,) is modulated alike."""
        return np.ones(np.shape(harmonic))

    def strikes(self, teeth: float) -> Strikes:  # noqa: ARG002 - other damage needs it
        """Return one impact a turn."""
        return ((0.0, 1.0),)


@dataclass(frozen=True)
class Crack(_Local):
    """A crack in the root of one tooth, `size_m` deep: the tooth bends further."""

    def changes(self, size_m: float, *, teeth: int) -> ToothChanges:
        """Return what damage of `size_m` changes in the mechanics of a gear of `teeth`."""
        crack, carrying, removed = _sound(teeth)
        crack[0] = size_m
        return ToothChanges(crack_m=crack, carrying=carrying, removed_m=removed)


@dataclass(frozen=True, kw_only=True)
class Chipping(_Local):
    """A corner of one tooth broken off, `size_m` of its face width gone."""

    face_width_m: float

    def changes(self, size_m: float, *, teeth: int) -> ToothChanges:
        """Return what damage of `size_m` changes in the mechanics of a gear of `teeth`."""
        if not 0 <= size_m <= self.face_width_m:
            raise ValueError(f"size_m = {size_m:g} is not within the face width of {self.face_width_m:g} m")
        crack, carrying, removed = _sound(teeth)
        carrying[0] = 1 - size_m / self.face_width_m
        return ToothChanges(crack_m=crack, carrying=carrying, removed_m=removed)


@dataclass(frozen=True)
class MissingTooth(_Local):
    """One tooth gone: nothing carries in its place, and the next one is hit. The size does not matter."""

    def strikes(self, teeth: float) -> Strikes:
        """Return one impact a turn, where the next tooth takes over."""
        return ((1 / (2 * teeth), 1.0),)

    def changes(self, size_m: float, *, teeth: int) -> ToothChanges:  # noqa: ARG002 - a tooth is there or not
        """Return what a missing tooth changes in the mechanics of a gear of `teeth`."""
        crack, carrying, removed = _sound(teeth)
        carrying[0] = 0.0
        return ToothChanges(crack_m=crack, carrying=carrying, removed_m=removed)


@dataclass(frozen=True, kw_only=True)
class Spall(_Local):
    """A hole in the flank of one tooth, `size_m` deep, long as `length_pitches` of the path from tooth to tooth.

    The contact drops in at one end and hits the other.
    """

    length_pitches: float = 0.3
    entry_share: float = -0.5

    def finest(self, teeth: float) -> float:
        """Return the width of the finest feature of the shape, in turns."""
        return self.length_pitches / teeth

    def shape(self, turns: ArrayLike, *, teeth: float) -> Array:
        """Return the spall's window at `turns` (n,) of the gear."""
        return window(turns, width_turns=self.length_pitches / teeth)

    def strikes(self, teeth: float) -> Strikes:
        """Return two impacts a turn: entry and exit."""
        half = self.length_pitches / (2 * teeth)
        return ((-half, self.entry_share), (half, 1.0))

    def changes(self, size_m: float, *, teeth: int) -> ToothChanges:
        """Return what damage of `size_m` changes in the mechanics of a gear of `teeth`."""
        crack, carrying, removed = _sound(teeth)
        removed[0] = size_m
        return ToothChanges(crack_m=crack, carrying=carrying, removed_m=removed)


@dataclass(frozen=True, kw_only=True)
class Pitting(_Local):
    """Pits on the flanks of several teeth, the worst `size_m` deep.

    Attributes
    ----------
    places : tuple of int
        Teeth that are hit, counted from the one at turn 0.
    shares : tuple of float
        Depth on each relative to the worst.
    length_pitches : float
        Length of the pitted part of the path from tooth to tooth.
    """

    places: tuple[int, ...]
    shares: tuple[float, ...]
    length_pitches: float = 0.3

    def __post_init__(self) -> None:
        if not self.places or len(self.places) != len(self.shares):
            raise ValueError(f"{len(self.places)} places and {len(self.shares)} shares: give one share for each place")

    @classmethod
    def drawn(cls, *, count: int, spread: int, rng: np.random.Generator, length_pitches: float = 0.3) -> "Pitting":
        """Draw `count` pitted teeth among `spread` neighbours, the one at turn 0 the worst, the others half to all."""
        if not 1 <= count <= spread:
            raise ValueError(f"count = {count} pitted teeth do not fit among spread = {spread} neighbours")
        others = 1 + rng.permutation(spread - 1)[: count - 1]
        shares = 0.5 + 0.5 * rng.random(count - 1)
        return cls(
            places=(0, *(int(place) for place in np.sort(others))),
            shares=(1.0, *(float(share) for share in shares)),
            length_pitches=length_pitches,
        )

    def finest(self, teeth: float) -> float:
        """Return the width of the finest feature of the shape, in turns."""
        return self.length_pitches / teeth

    def shape(self, turns: ArrayLike, *, teeth: float) -> Array:
        """Return the pits' windows at `turns` (n,) of the gear."""
        at = np.asarray(turns, dtype=np.float64)
        width = self.length_pitches / teeth
        pits = zip(self.places, self.shares, strict=True)
        return np.asarray(sum(share * window(at - place / teeth, width_turns=width) for place, share in pits))

    def strikes(self, teeth: float) -> Strikes:
        """Return one impact a turn for each pitted tooth."""
        return tuple((place / teeth, share) for place, share in zip(self.places, self.shares, strict=True))

    def changes(self, size_m: float, *, teeth: int) -> ToothChanges:
        """Return what damage of `size_m` changes in the mechanics of a gear of `teeth`."""
        crack, carrying, removed = _sound(teeth)
        removed[np.array(self.places) % teeth] = size_m * np.array(self.shares)
        return ToothChanges(crack_m=crack, carrying=carrying, removed_m=removed)


class _AllRound:
    """Damage of the whole gear: nothing strikes."""

    def finest(self, teeth: float) -> float:  # noqa: ARG002 - local damage needs it
        """Return the width of the finest feature of the shape, in turns."""
        return 0.25

    def harmonic_share(self, harmonic: ArrayLike) -> Array:
        """Return 1: every mesh harmonic (k,) is modulated alike."""
        return np.ones(np.shape(harmonic))

    def strikes(self, teeth: float) -> Strikes:  # noqa: ARG002 - local damage needs it
        """Return none."""
        return ()


@dataclass(frozen=True)
class Eccentricity(_AllRound):
    """A pitch circle `size_m` off the axis: the mesh swings once a turn."""

    def shape(self, turns: ArrayLike, *, teeth: float) -> Array:  # noqa: ARG002 - local damage needs it
        """Return ``cos(2 pi turns)``."""
        return np.cos(2 * np.pi * np.asarray(turns, dtype=np.float64))

    def changes(self, size_m: float, *, teeth: int) -> ToothChanges:
        """Return what damage of `size_m` changes in the mechanics of a gear of `teeth`."""
        crack, carrying, removed = _sound(teeth)
        return ToothChanges(crack_m=crack, carrying=carrying, removed_m=removed, runout_m=size_m)


@dataclass(frozen=True, kw_only=True)
class Misalignment(_AllRound):
    """A gear whose axis leans: `size_m` of its face width lies off at the end, once and twice a turn more and less.

    `twice` is what swings twice a turn, over the whole swing. The second mesh harmonic rises most.
    """

    face_width_m: float
    twice: float = 0.5

    def shape(self, turns: ArrayLike, *, teeth: float) -> Array:  # noqa: ARG002 - local damage needs it
        """Return ``(1 - twice) cos(2 pi turns) + twice cos(4 pi turns)``."""
        angle = 2 * np.pi * np.asarray(turns, dtype=np.float64)
        return np.asarray((1 - self.twice) * np.cos(angle) + self.twice * np.cos(2 * angle))

    def harmonic_share(self, harmonic: ArrayLike) -> Array:
        """Return 2 for the second mesh harmonic, 1 for the others (k,)."""
        return np.where(np.asarray(harmonic) == 2, 2.0, 1.0)  # noqa: PLR2004

    def changes(self, size_m: float, *, teeth: int) -> ToothChanges:
        """Return what damage of `size_m` changes in the mechanics of a gear of `teeth`."""
        if not 0 <= size_m <= self.face_width_m:
            raise ValueError(f"size_m = {size_m:g} is not within the face width of {self.face_width_m:g} m")
        crack, carrying, removed = _sound(teeth)
        swing = (1 + self.shape(np.arange(teeth) / teeth, teeth=teeth)) / 2
        carrying -= size_m / self.face_width_m * swing
        return ToothChanges(crack_m=crack, carrying=carrying, removed_m=removed)


@dataclass(frozen=True)
class Wear(_AllRound):
    """Flanks worn alike, `size_m` deep: all mesh harmonics rise, the higher the more, and no sideband comes."""

    def shape(self, turns: ArrayLike, *, teeth: float) -> Array:  # noqa: ARG002 - local damage needs it
        """Return 1: every tooth is alike."""
        return np.ones(np.shape(turns))

    def harmonic_share(self, harmonic: ArrayLike) -> Array:
        """Return the number of the mesh harmonic (k,)."""
        return np.asarray(harmonic, dtype=np.float64)

    def changes(self, size_m: float, *, teeth: int) -> ToothChanges:
        """Return what damage of `size_m` changes in the mechanics of a gear of `teeth`."""
        crack, carrying, removed = _sound(teeth)
        return ToothChanges(crack_m=crack, carrying=carrying, removed_m=removed, profile_m=size_m)
