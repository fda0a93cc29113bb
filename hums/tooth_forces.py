"""The force between two teeth: its components at the pitch point, and the same force in space.

References
----------
ISO 21771 (2007): working pressure angle. Decker, Maschinenelemente, and any other text on gears: the three
components of a tooth force.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hums.declared import quoted
from hums.gearbox import Axis, Mesh
from hums.loads import ToothForces, TorqueError
from hums.statics import Solution, Statics

_PARALLEL = 1e-12
_APART = 1e-3  # of the centre distance: rounded positions and profile shifts differ by less
_SETTLED_RAD = 1e-15


class UnsettledError(Exception):
    """Why a force is not settled, in words; it ends as the `status` of a `BearingLoad`."""


@dataclass(frozen=True, kw_only=True)
class PairAngles:
    """Helix, transverse and working transverse pressure angle of a pair; its sum of teeth, internal negative."""

    helix_rad: float
    transverse_rad: float
    working_rad: float
    teeth: int

    def distance_mm(self, module_mm: float) -> float:
        """Return the centre distance of the gears, ``a = m |Z| cos a_t / (2 cos b cos a_w)``."""
        reference_mm = module_mm * abs(self.teeth) / (2 * math.cos(self.helix_rad))
        return reference_mm * math.cos(self.transverse_rad) / math.cos(self.working_rad)


def pair_angles(statics: Statics, number: int) -> PairAngles | None:
    """Return the angles of a gear pair; None without a pressure angle, or where its axes are not parallel."""
    mesh = statics.mesh(number)
    along = sum(a * b for a, b in zip(*statics.directions(number), strict=True))
    if mesh.pressure_angle_deg is None or mesh.kind or abs(abs(along) - 1) > _PARALLEL:
        return None
    (_, one), (_, two) = statics.contacts[number].gears
    teeth = abs(one) + abs(two) if one * two * along > 0 else -abs(abs(one) - abs(two))
    helix_rad = math.radians(abs(mesh.helix_angle_deg or 0.0))
    normal_rad = math.radians(mesh.pressure_angle_deg)
    transverse_rad = math.atan(math.tan(normal_rad) / math.cos(helix_rad))
    return PairAngles(
        helix_rad=helix_rad,
        transverse_rad=transverse_rad,
        working_rad=_working_angle(mesh, normal_rad, transverse_rad, teeth),
        teeth=teeth,
    )


def _working_angle(mesh: Mesh, normal_rad: float, transverse_rad: float, teeth: int) -> float:
    """Return the transverse working pressure angle in rad (ISO 21771).

    ``inv a_w = inv a_t + 2 tan a_n sum(x) / sum(z)``, internal teeth counted negative, by Newton's method: the
    involute function is convex, so that from the right all steps descend.
    """
    shift = sum(mesh.profile_shift or ())
    if shift == 0:
        return transverse_rad
    added = 2 * math.tan(normal_rad) * shift / teeth if teeth else -math.inf
    involute = math.tan(transverse_rad) - transverse_rad + added
    if involute <= 0:
        raise TorqueError(
            f'mesh "{mesh.name}": with profile_shift = {list(mesh.profile_shift or ())} its gears have no common pitch '
            "point; correct the shifts (signs as in ISO 21771)."
        )
    angle = math.atan(math.cbrt(3 * involute) + involute)  # no less than the solution, as inv a > a^3 / 3
    for _ in range(60):
        step = (math.tan(angle) - angle - involute) / math.tan(angle) ** 2
        angle -= step
        if abs(step) < _SETTLED_RAD:
            break
    return angle


def tooth_forces(solution: Solution, number: int) -> ToothForces | None:
    """Resolve a tooth load at the working pitch point of a gear pair with parallel axes.

    With ``d = m Z / cos b`` the transverse force is ``2 Z L / (d cos a_t)`` along the line of action, which
    stands at the working angle. None where the load, the module or an angle is not known.
    """
    load, module_mm = solution.load(number), solution.statics.mesh(number).module_mm
    if load is None:
        return None
    angles = pair_angles(solution.statics, number)
    if module_mm is None or angles is None:
        return None
    at_reference_n = 2 * abs(float(load)) * math.cos(angles.helix_rad) / (1e-3 * module_mm)
    line_n = at_reference_n / math.cos(angles.transverse_rad)
    return ToothForces(
        tangential_n=line_n * math.cos(angles.working_rad),
        radial_n=line_n * math.sin(angles.working_rad),
        axial_n=at_reference_n * math.tan(angles.helix_rad),
    )


# ---- the force in space ---------------------------------------------------------------------------------------------


def force_in_space(solution: Solution, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the pitch point of a contact, (3,) mm, and the force there on its first gear, (3,) N.

    With ``u`` the unit vector to the second axis, the pitch point lies ``a Z_1 / (Z_1 + Z_2)`` along it: beyond the
    pinion of an internal pair. The tangential force turns the first gear about its axis ``d``, the radial one
    parts the gears, and along ``d`` a right-handed helix adds ``-tan b`` times the force round ``d``.

    Raises
    ------
    UnsettledError
        What is missing, in words.
    """
    statics, load = solution.statics, _load_in_frame(solution, number)
    mesh, contact = statics.mesh(number), statics.contacts[number]
    (axis, along), (other, along_other) = (placed_axis(statics, name) for name in statics.axes(number))
    angles, module_mm, position_mm = _declared(statics, number)
    start = np.array(axis.through) + position_mm * along
    across = np.array(other.through) - start
    across -= across @ along * along
    apart_mm = float(np.linalg.norm(across))
    working_mm = angles.distance_mm(module_mm)
    if not working_mm or abs(apart_mm / working_mm - 1) > _APART:
        raise UnsettledError(
            f'mesh "{mesh.name}": axes {quoted((axis.name, other.name))} lie {apart_mm:.6g} mm apart, but its teeth '
            f"need {working_mm:.6g} mm; correct through, module_mm or profile_shift"
        )
    unit = across / apart_mm
    (_, teeth), (_, teeth_other) = contact.gears
    arm_mm = apart_mm * teeth / (teeth + teeth_other * round(float(along @ along_other)))
    round_n = 1e3 * load * teeth / arm_mm  # along d x u, which turns about d where the arm points along u
    radial_n = math.copysign(abs(round_n) * math.tan(angles.working_rad), -angles.teeth)
    slant = math.tan(angles.helix_rad) * math.cos(angles.transverse_rad) / math.cos(angles.working_rad)
    thrust_n = math.copysign(1.0, arm_mm) * round_n * slant * (-1 if mesh.hand == "right" else 1)
    return start + arm_mm * unit, round_n * np.cross(along, unit) + radial_n * unit + thrust_n * along


def placed_axis(statics: Statics, name: str) -> tuple[Axis, NDArray[np.float64]]:
    """Return an axis whose place is declared, and its direction; `UnsettledError` where there is none."""
    axis = next(axis for axis in statics.kinematics.gearbox.axes if name in axis.instances())
    if axis.copies is not None:
        raise UnsettledError(f'axis "{axis.name}" stands for {axis.copies} copies, whose places are not declared')
    if axis.through is None:
        raise UnsettledError(f'axis "{name}": through is not declared; add a point of it in mm')
    return axis, np.array(statics.kinematics.mechanism.directions[name])


def _load_in_frame(solution: Solution, number: int) -> float:
    """Return the tooth load of a contact that rests in the frame, in N m a tooth."""
    contact, load = solution.statics.contacts[number], solution.load(number)
    name = f'mesh "{contact.mesh}"'
    if contact.carrier != solution.statics.kinematics.mechanism.frame:
        raise UnsettledError(
            f'{name} is held by "{contact.carrier}", not by the frame: loads of planets are not covered'
        )
    if load is None:
        raise UnsettledError(f"the load of {name} is indeterminate")
    return float(load)


def _declared(statics: Statics, number: int) -> tuple[PairAngles, float, float]:
    """Return the angles, the module in mm and the position in mm that a force in space needs."""
    mesh, angles = statics.mesh(number), pair_angles(statics, number)
    name = f'mesh "{mesh.name}"'
    if angles is None or mesh.module_mm is None:
        raise UnsettledError(f"{name}: a force needs module_mm, pressure_angle_deg and gears on parallel axes")
    if mesh.position_mm is None:
        raise UnsettledError(f"{name}: position_mm is not declared; add it")
    if angles.helix_rad and mesh.hand is None:
        raise UnsettledError(f"{name}: the hand of its helix is not declared; add that of its first gear")
    return angles, mesh.module_mm, mesh.position_mm
