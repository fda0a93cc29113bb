"""Models of the meshes of a scene at each level of fidelity: rigid, a spring, spectral lines, or time integration."""

from collections.abc import Mapping

from data_synth.keeping import LEVELS
from data_synth.mesh_response import response_of, with_lines
from data_synth.meshing import Gears
from data_synth.motion import Motion, motion_of
from data_synth.reduction import without_meshes
from data_synth.stage import PreparedScene

LEFT_OUT, SPRING, KINEMATIC = "left out", "a spring", "kinematic"
LADDER = (LEFT_OUT, SPRING, KINEMATIC, *LEVELS)  # from the least to the most


def simulated_motion(stage: PreparedScene, gears: Gears, levels: Mapping[str, str]) -> Motion | None:
    """Return the motion to integrate at these levels; None where no mesh needs time integration."""
    if not set(LEVELS) & set(levels.values()):
        return None
    still = [name for name, level in levels.items() if level not in LEVELS]
    moving = {name: "torsional" if name in still else level for name, level in levels.items()}
    motion = motion_of(stage, gears, levels=moving, springs=still)
    return without_meshes(motion, [name for name, level in levels.items() if level == LEFT_OUT])


def with_kinematic_lines(stage: PreparedScene, gears: Gears, levels: Mapping[str, str]) -> PreparedScene:
    """Return the stage with the lines of its kinematic meshes, from the response of the most detailed motion."""
    kinematic = [name for name, level in levels.items() if level == KINEMATIC]
    return with_lines(stage, response_of(most_detailed_motion(stage, gears, levels)), kinematic) if kinematic else stage


def most_detailed_motion(stage: PreparedScene, gears: Gears, levels: Mapping[str, str]) -> Motion:
    """Return the motion in which meshes without time integration have the highest fidelity that the scene allows."""
    most = stage.scene.fidelity if stage.scene.fidelity in LEVELS else "full"
    moving = {name: level if level in LEVELS else most for name, level in levels.items()}
    return motion_of(stage, gears, levels=moving)
