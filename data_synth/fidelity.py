"""Which motions a scene simulates: what it declares, or, where that is "auto", the cheapest that sounds like all."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from data_synth.meshing import Gears, declared_of
from data_synth.motion import LEVELS, Motion, motion_of
from data_synth.profile import Array
from data_synth.scene import Scene, SceneError
from data_synth.stage import Stage

_MOST_MIXED = 4  # meshes up to which every mixture is tried
_SILENT_DB = -400.0


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The motions that are simulated.

    Attributes
    ----------
    levels : mapping of mesh to "torsional", "lateral" or "full"
    springs : tuple of mesh
        Whose teeth no sensor hears above the floor: each is a spring of its mean stiffness.
    tried : tuple of (str, float)
        What was compared with the full motion, cheapest first, and by how many dB the worst channel differed.
    floor_db : float or None
        None where the scene itself says what to simulate.
    """

    levels: Mapping[str, str]
    springs: tuple[str, ...] = ()
    tried: tuple[tuple[str, float], ...] = ()
    floor_db: float | None = None

    @property
    def name(self) -> str:
        """Return the levels in words."""
        return named(self.levels)

    def __str__(self) -> str:
        """Return what is simulated, and why."""
        if self.floor_db is None:
            return f"{self.name}, as declared"
        found = ", ".join(f"{name} {decibels:.0f} dB" for name, decibels in self.tried)
        quiet = "".join(f'; teeth of "{name}" left out, below the floor' for name in self.springs)
        return f"{self.name}: within {self.floor_db:g} dB of full (from full: {found}){quiet}"


def named(levels: Mapping[str, str]) -> str:
    """Return ``lateral``, or ``stage 1 lateral, stage 2 torsional`` where stages differ."""
    if len(set(levels.values())) == 1:
        return next(iter(levels.values()))
    return ", ".join(f"{mesh} {level}" for mesh, level in levels.items())


def chosen(stage: Stage, gears: Gears) -> Choice:
    """Return what a scene simulates.

    With "auto", torsional motion is compared with the full one on the first `decide_s` of the scene, then mixtures
    of stages up to four, then lateral motion, by rising degrees of freedom; the first whose worst channel
    differs by less than `floor_db`, RMS of the difference over RMS, is taken. Then meshes are made springs, one after
    the other, as long as the channels stay within the floor. A stage that declares a fidelity keeps it.

    Raises
    ------
    SceneError
        A stage that declares more than the scene, or a scene that cannot vibrate.
    """
    scene = stage.scene
    meshes = [mesh.name for mesh in scene.gearbox.meshes]
    own = {name: declared_of(scene).mesh(name).fidelity for name in meshes}
    if scene.fidelity != "auto":
        return Choice(levels={name: _within(scene, name, own[name]) for name in meshes})
    floor_db = declared_of(scene).floor_db
    top: dict[str, str] = {name: own[name] or "full" for name in meshes}
    whole = motion_of(stage, gears, levels=top)
    samples = max(2, min(scene.samples, math.ceil(declared_of(scene).decide_s * scene.rate_hz)))
    wanted = _heard(whole, samples)
    tried: list[tuple[str, float]] = []
    levels = top
    motions = [(candidate, motion_of(stage, gears, levels=candidate)) for candidate in _candidates(own)]
    for candidate, motion in sorted(motions, key=lambda pair: pair[1].system.dof):
        apart = _difference_db(wanted, _heard(motion, samples))
        tried.append((named(candidate), apart))
        if apart <= floor_db:
            levels = candidate
            break
    springs: tuple[str, ...] = ()
    for name in meshes if len(meshes) > 1 else ():
        quiet = motion_of(stage, gears, levels=levels, springs=(*springs, name))
        if _difference_db(wanted, _heard(quiet, samples)) <= floor_db:
            springs = (*springs, name)
    return Choice(levels=levels, springs=springs, tried=tuple(tried), floor_db=floor_db)


def _within(scene: Scene, mesh: str, own: str | None) -> str:
    if own is not None and LEVELS.index(own) > LEVELS.index(scene.fidelity):
        raise SceneError(
            f'dynamics.meshes: "{mesh}" has fidelity = "{own}", more than the scene\'s "{scene.fidelity}"; write '
            f'fidelity = "{own}" for the scene, and less for the other stages.'
        )
    return own or scene.fidelity


def _candidates(own: Mapping[str, str | None]) -> Iterator[dict[str, str]]:
    """Yield levels below the full one."""
    free = [name for name, level in own.items() if level is None]
    if not free:
        return
    if len(free) <= _MOST_MIXED:
        mixtures = [dict(zip(free, levels, strict=True)) for levels in product(LEVELS[:2], repeat=len(free))]
    else:
        mixtures = [dict.fromkeys(free, level) for level in LEVELS[:2]]
    for mixture in mixtures:
        yield {name: level or mixture[name] for name, level in own.items()}


def _heard(motion: Motion, samples: int) -> Array:
    return np.concatenate([*motion.channels(samples=samples)], axis=1)


def _difference_db(wanted: Array, found: Array) -> float:
    """Return the RMS of the difference over the RMS, in dB, of the worst channel."""
    difference, size = (np.sqrt(np.mean(values**2, axis=1)) for values in (found - wanted, wanted))
    ratios = np.divide(difference, size, out=np.full(size.size, np.inf), where=size > 0)
    ratios[difference == 0] = 0.0
    worst = float(np.max(ratios))
    return max(20 * math.log10(worst), _SILENT_DB) if worst > 0 else _SILENT_DB
