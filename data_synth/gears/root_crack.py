"""A crack in the root of a tooth, and the compliance that it adds."""

import math
from dataclasses import dataclass

import numpy as np

from data_synth.gears.mesh_stiffness import Array
from data_synth.gears.tooth_compliance import CrackedSection, Tooth, ToothPair

_BISECTIONS = 60
_ROOT_TANGENT = math.radians(30)  # the critical section of ISO 6336-3


@dataclass(frozen=True, kw_only=True)
class RootCrack:
    """A crack across the whole face width, from the fillet of the loaded flank into the tooth.

    It starts where the tangent to the fillet is at 30 degrees to the centre line of the tooth. In the model
    `dead_zone`, material between the surface and a line through the crack tip parallel to the centre line carries
    neither bending nor shear (Wu, Zuo and Parey 2008, J. Sound Vib. 317; Chaari, Fakhfakh and Haddar 2009, Eur. J.
    Mech. A 28); compression closes the crack. In `fracture_mechanics` the crack adds a rotation of

        theta = 24 M S(a / b) / (E' b^2 W),  E' = E / (1 - nu^2)

    under a moment M at the section of thickness b and face width W, like an edge crack of depth a in pure bending
    (Tada, Paris and Irwin, The Stress Analysis of Cracks Handbook).

    Attributes
    ----------
    depth_m : float
        Length of the crack, m.
    angle_rad : float
        Angle between the crack and the centre line of the tooth, rad.
    model : str
        ``"dead_zone"`` or ``"fracture_mechanics"``.
    """

    depth_m: float
    angle_rad: float
    model: str = "dead_zone"

    def added_compliance(self, pair: ToothPair, gear: int, phase_cycles: Array) -> Array:
        """Return the added compliance (n,) of a pair in m/N."""
        tooth = pair.teeth[gear]
        angles = pair.angles_rad(phase_cycles)[gear]
        if self.model == "fracture_mechanics":
            return self._hinge(tooth) * tooth.lever_arm_m(angles, height_m=self.section(tooth).tip_m) ** 2
        return np.asarray(tooth.compliance(angles, remaining=self.section(tooth)) - tooth.compliance(angles))

    def jump_phases(self, pair: ToothPair, gear: int) -> tuple[float, ...]:  # noqa: ARG002
        """Return no phases: the compliance of a cracked tooth is continuous."""
        return ()

    def _hinge(self, tooth: Tooth) -> float:
        """Return the added rotation of the cracked section in rad per N m."""
        thickness = 2 * _critical_section(tooth)[0]
        share = self.depth_m * math.sin(self.angle_rad) / thickness
        shape = (share / (1 - share)) ** 2 * np.polyval([13.12, -35.84, 37.14, -19.69, 5.93], share)
        modulus = tooth.young_pa / (1 - tooth.poisson**2)
        return float(24 * shape / (modulus * thickness**2 * tooth.face_width_m))

    def section(self, tooth: Tooth) -> CrackedSection:
        """Return the cracked half of a tooth.

        Raises
        ------
        ValueError
            If the crack length is negative or the crack severs the tooth.
        """
        half, height = _critical_section(tooth)
        remaining = half - self.depth_m * math.sin(self.angle_rad)
        tip = height - self.depth_m * math.cos(self.angle_rad)
        if self.depth_m < 0 or remaining <= -half:
            raise ValueError(
                f"a crack of {1e3 * self.depth_m:.6g} mm at {math.degrees(self.angle_rad):.3g} degrees leaves nothing "
                f"of a tooth {2e3 * half:.4g} mm thick; make it shorter, or declare a missing tooth"
            )

        return CrackedSection(remaining_m=remaining, tip_m=tip)


def _critical_section(tooth: Tooth) -> tuple[float, float]:
    """Return half thickness and height where the fillet's tangent is at 30 degrees, by bisection."""
    low, high = tooth.pressure_angle_rad, math.pi / 2 - 1e-9
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        turn = (tooth._rack_tip[1] / math.tan(middle) + tooth._rack_tip[2]) / tooth.radius_m  # noqa: SLF001
        # the tangent is at `middle` in space, and the tooth has rotated by `turn`
        low, high = (middle, high) if middle - turn < _ROOT_TANGENT else (low, middle)
    half, height, _ = tooth.fillet_at(np.array(low))
    return float(half), float(height)
