"""A family of spur gearboxes: teeth, modules, ratios and bearings drawn within the limits of their design rules.

Limits with a source: modules are of series I of ISO 54 (1996); face widths are three to five circular pitches (Shigley
and Mischke 1989, Mechanical Engineering Design, section 13-7); pinions have at least 18 teeth, so that a rack of 20
degrees does not undercut them (2 / sin^2 20 degrees = 17.1); teeth of a pair share no factor, so that every tooth meets
every other one. All other ranges are ours and illustrative.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["BearingGeometry", "DrawnGearbox", "DrawnStage", "draw_bearing", "draw_gearbox"]

MODULES_MM = (2.0, 2.5, 3.0, 4.0, 5.0, 6.0)
PRESSURE_ANGLE_DEG = 20.0
PINION_TEETH = (18, 29)
RATIOS = {1: (1.6, 4.5), 2: (1.6, 4.0), 3: (1.5, 3.2)}
"""Ratio of a stage by the number of stages."""
WIDTH_IN_PITCHES = (3.0, 5.0)
UNIT_LOAD_N_MM2 = (12.0, 25.0)
"""Tangential force at full load over module and face width."""

DIAMETER_SHARE = (0.115, 0.24)
"""Diameter of an element over that of the pitch circle; those of `hums.gearbox.bearings` have 0.117 to 0.237."""
FILLING = (0.55, 0.61)
"""Elements side by side over the pitch circle, z d / (pi D); those of `hums.gearbox.bearings` have 0.566 to 0.603, and
one 0.48."""
CONTACT_ANGLES_DEG = (0.0, 0.0, 0.0, 15.0)


@dataclass(frozen=True, kw_only=True)
class DrawnStage:
    """A pair of spur gears.

    Attributes
    ----------
    name, pinion, wheel : str
        Of the mesh, and the links that carry its gears.
    teeth : (int, int)
        Of pinion and wheel.
    module_mm, face_width_mm : float
    """

    name: str
    pinion: str
    wheel: str
    teeth: tuple[int, int]
    module_mm: float
    face_width_mm: float

    @property
    def centre_mm(self) -> float:
        """Centre distance in mm."""
        return self.module_mm * sum(self.teeth) / 2


@dataclass(frozen=True, kw_only=True)
class BearingGeometry:
    """Geometry of a rolling bearing, lengths in mm, angle in degrees."""

    elements: int
    element_diameter_mm: float
    pitch_diameter_mm: float
    contact_angle_deg: float


@dataclass(frozen=True, kw_only=True)
class DrawnGearbox:
    """A gearbox of the family.

    Attributes
    ----------
    name : str
    stages : tuple of DrawnStage
        From the input on.
    angles_deg : tuple of float
        Direction of each centre line across the shafts.
    full_torque_nm : float
        Of the output at full load.
    top_rpm : float
        Highest speed of the input.
    """

    name: str
    stages: tuple[DrawnStage, ...]
    angles_deg: tuple[float, ...]
    full_torque_nm: float
    top_rpm: float

    @property
    def links(self) -> tuple[str, ...]:
        """Shafts from input to output."""
        return (self.stages[0].pinion, *(stage.wheel for stage in self.stages))

    @property
    def components(self) -> tuple[str, ...]:
        """Gears, as a scene names them."""
        return tuple(f"{stage.name}/{link}" for stage in self.stages for link in (stage.pinion, stage.wheel))

    def stage_of(self, component: str) -> DrawnStage:
        """Return the stage of a gear such as ``stage 1/input``."""
        return next(stage for stage in self.stages if component.startswith(f"{stage.name}/"))

    def speed_ratio(self, link: str) -> float:
        """Return the speed of a shaft over that of the input."""
        ratio = 1.0
        for stage in self.stages[: self.links.index(link)]:
            ratio *= stage.teeth[0] / stage.teeth[1]
        return ratio

    def table(self, bearings: Mapping[str, BearingGeometry]) -> dict[str, Any]:
        """Return the gearbox as a scene declares it.

        Parameters
        ----------
        bearings : mapping of link to BearingGeometry
            One for each shaft.

        Returns
        -------
        dict

        Examples
        --------
        >>> import numpy as np
        >>> from data_synth.benchmark.gearboxes import draw_bearing, draw_gearbox
        >>> from hums import Gearbox
        >>> rng = np.random.default_rng(1)
        >>> drawn = draw_gearbox("one", stages=2, rng=rng)
        >>> gearbox = Gearbox.from_mapping(drawn.table({link: draw_bearing(rng) for link in drawn.links}))
        >>> [mesh.name for mesh in gearbox.meshes], len(gearbox.bearings)
        (['stage 1', 'stage 2'], 3)
        """
        place, through = np.zeros(2), {self.links[0]: (0.0, 0.0)}
        for stage, angle in zip(self.stages, self.angles_deg, strict=True):
            place = place + stage.centre_mm * np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
            through[stage.wheel] = (float(place[0]), float(place[1]))
        return {
            "name": self.name,
            "frame": "housing",
            "reference": "input",
            "axes": {link: {"links": ["housing", link], "through": [0.0, *through[link]]} for link in self.links},
            "mesh": [
                {
                    "name": stage.name,
                    "teeth": {stage.pinion: stage.teeth[0], stage.wheel: stage.teeth[1]},
                    "module_mm": stage.module_mm,
                    "face_width_mm": stage.face_width_mm,
                    "pressure_angle_deg": PRESSURE_ANGLE_DEG,
                }
                for stage in self.stages
            ],
            "bearing": [
                {
                    "names": [f"{link} bearing"],
                    "inner_ring": link,
                    "outer_ring": "housing",
                    "elements": bearings[link].elements,
                    "element_diameter_mm": bearings[link].element_diameter_mm,
                    "pitch_diameter_mm": bearings[link].pitch_diameter_mm,
                    "contact_angle_deg": bearings[link].contact_angle_deg,
                }
                for link in self.links
            ],
        }


_LINKS = {
    1: ("input", "output"),
    2: ("input", "intermediate", "output"),
    3: ("input", "intermediate 1", "intermediate 2", "output"),
}


def draw_gearbox(name: str, *, stages: int, rng: np.random.Generator) -> DrawnGearbox:
    """Return a spur gearbox of one to three stages.

    Parameters
    ----------
    name : str
    stages : int
        1, 2 or 3.
    rng : numpy.random.Generator

    Returns
    -------
    DrawnGearbox

    Raises
    ------
    ValueError
        For another number of stages.

    Examples
    --------
    >>> import math
    >>> import numpy as np
    >>> from data_synth.benchmark.gearboxes import draw_gearbox
    >>> drawn = draw_gearbox("one", stages=3, rng=np.random.default_rng(1))
    >>> [math.gcd(*stage.teeth) for stage in drawn.stages]
    [1, 1, 1]
    """
    if stages not in _LINKS:
        raise ValueError(f"stages = {stages}: the family has gearboxes of 1, 2 or 3 stages; choose one of them.")
    links, found = _LINKS[stages], []
    size = int(rng.integers(0, len(MODULES_MM) - stages))
    for number in range(stages):
        pinion = int(rng.integers(PINION_TEETH[0], PINION_TEETH[1] + 1))
        wheel = round(pinion * rng.uniform(*RATIOS[stages]))
        while math.gcd(pinion, wheel) > 1:
            wheel += 1
        module = MODULES_MM[size + number]
        width = round(rng.uniform(*WIDTH_IN_PITCHES) * math.pi * module)
        found.append(
            DrawnStage(
                name=f"stage {number + 1}",
                pinion=links[number],
                wheel=links[number + 1],
                teeth=(pinion, wheel),
                module_mm=module,
                face_width_mm=float(width),
            )
        )
    unit_load = rng.uniform(*UNIT_LOAD_N_MM2)
    return DrawnGearbox(
        name=name,
        stages=tuple(found),
        angles_deg=tuple(float(round(angle, 1)) for angle in rng.uniform(-60, 60, stages)),
        full_torque_nm=float(round(_full_torque_nm(found, unit_load), 1)),
        top_rpm=float(round(rng.uniform(1500, 3000), -1)),
    )


def _full_torque_nm(stages: list[DrawnStage], unit_load: float) -> float:
    """Return the output torque at which the most loaded stage has `unit_load`, N/mm^2."""
    allowed, ratio = [], 1.0  # ratio: torque of the output over that of this stage's wheel
    for stage in reversed(stages):
        force_n = unit_load * stage.module_mm * stage.face_width_mm
        allowed.append(force_n * stage.module_mm * stage.teeth[1] / 2000 * ratio)
        ratio *= stage.teeth[1] / stage.teeth[0]
    return min(allowed)


def draw_bearing(rng: np.random.Generator) -> BearingGeometry:
    """Return the geometry of a bearing, within what the ball bearings of `hums.gearbox.bearings` span.

    Parameters
    ----------
    rng : numpy.random.Generator

    Returns
    -------
    BearingGeometry

    Examples
    --------
    Its elements do not touch:

    >>> import math
    >>> import numpy as np
    >>> from data_synth.benchmark.gearboxes import draw_bearing
    >>> drawn = draw_bearing(np.random.default_rng(1))
    >>> drawn.elements * drawn.element_diameter_mm < math.pi * drawn.pitch_diameter_mm
    True
    """
    share, pitch = rng.uniform(*DIAMETER_SHARE), rng.uniform(28, 72)
    elements = round(rng.uniform(*FILLING) * math.pi / share)
    return BearingGeometry(
        elements=elements,
        element_diameter_mm=float(round(share * pitch, 2)),
        pitch_diameter_mm=float(round(pitch, 2)),
        contact_angle_deg=float(rng.choice(CONTACT_ANGLES_DEG)),
    )
