"""From what damage changes on the teeth of a gear to the stiffness and the transmission error of its mesh."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from data_synth.gear_faults import ToothChanges
from data_synth.gear_geometry import GearPair
from data_synth.mesh import Array
from data_synth.teeth_in_mesh import Damaged
from data_synth.tooth_faults import MissingTooth, ToothCrack
from data_synth.tooth_stiffness import ToothPair
from data_synth.transmission_error import Eccentricity, PitchError, ProfileError, TransmissionError

CRACK_ANGLE_RAD = math.pi / 4  # to the middle of the tooth; cracks of gears with a thick rim run at about this angle


@dataclass(frozen=True, kw_only=True)
class Narrowed:
    """A tooth that carries over a share of its face only, above 0 and up to 1: the pair is as much softer."""

    share: float

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:  # noqa: ARG002
        """Return what it adds to the compliance of a pair, (n,) m/N."""
        return np.asarray((1 / self.share - 1) * pair.compliance(phase_cycles))

    def edges(self, pair: ToothPair, gear: int) -> tuple[float, ...]:  # noqa: ARG002
        """Return no phases: it is the same all along the path."""
        return ()


def damaged_teeth(
    changes: ToothChanges, *, gear: int, first: int, crack_angle_rad: float = CRACK_ANGLE_RAD
) -> Iterator[Damaged]:
    """Yield the teeth whose stiffness changes; tooth 0 of `changes` is number `first` of the mesh."""
    teeth = changes.carrying.size
    for place in range(teeth):
        tooth = (first + place) % teeth
        if changes.crack_m[place] > 0:
            crack = ToothCrack(depth_m=float(changes.crack_m[place]), angle_rad=crack_angle_rad)
            yield Damaged(gear=gear, tooth=tooth, fault=crack)
        share = float(changes.carrying[place])
        if share <= 0:
            yield Damaged(gear=gear, tooth=tooth, fault=MissingTooth())
        elif share < 1:
            yield Damaged(gear=gear, tooth=tooth, fault=Narrowed(share=share))


def errors_of(changes: ToothChanges, *, pair: GearPair, first: int) -> Iterator[TransmissionError]:
    """Yield the transmission errors; tooth 0 of `changes` enters the mesh at phase `first`.

    Material that is gone lets the gears turn closer, so errors are positive. What is worn off alike everywhere,
    ``profile_m / 2``, moves no tooth against another and is left out.
    """
    teeth = changes.removed_m.size
    if np.any(changes.removed_m):
        handover = min(pair.contact_ratio - 1, 1.0)
        yield PitchError(teeth_m=np.roll(changes.removed_m, first), handover=max(handover, 0.0))
    if changes.runout_m:
        middle = first + pair.contact_ratio / 2  # turn 0 is where the damaged tooth is in the middle of its mesh
        yield Eccentricity(
            teeth=teeth, eccentricity_m=changes.runout_m, phase_rad=math.pi / 2 - 2 * math.pi * middle / teeth
        )
    if changes.profile_m:
        pitch_point = pair.base_radii_m[0] * math.tan(pair.working_angle_rad)
        at = (pitch_point - pair.path_m[0]) / pair.base_pitch_m
        second = -changes.profile_m / 2 * np.exp(-4j * np.pi * at)
        yield ProfileError(harmonics_m=np.array([0.0, second]))
