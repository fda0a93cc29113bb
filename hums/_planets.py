"""Assembly conditions of a planetary stage: tooth numbers, spacing of the planets, clearance between neighbours."""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from math import radians, sin

_TOLERANCE_DEG = 0.02  # drawings print angles with two decimals


def planet_angles(copies: int, spacing_deg: Sequence[float] | None) -> list[float]:
    """Return the angle of each planet about its carrier's axis, in degrees from the first one.

    `spacing_deg` holds either these angles themselves, which begin with 0, or the gaps from each planet to the
    next one, which add up to 360.

    Raises
    ------
    ValueError
        Where it is neither.
    """
    if spacing_deg is None:
        return [360 * number / copies for number in range(copies)]
    given = list(spacing_deg)
    if len(given) != copies:
        raise ValueError(f"spacing_deg has {len(given)} angles for {copies} copies; give one each")
    if given[0] == 0 and all(a < b for a, b in pairwise([*given, 360.0])):
        return given
    if min(given) > 0 and abs(sum(given) - 360) < copies * _TOLERANCE_DEG:
        return [sum(given[:number]) for number in range(copies)]
    raise ValueError(
        f"spacing_deg = {given}: give the angle of each copy, rising from 0 and below 360, or the gaps between "
        f"them, which add up to 360 (these add up to {sum(given):g})"
    )


def coaxial_warning(planet: tuple[str, int], mates: Mapping[str, int]) -> str | None:
    """Return a warning where a planet's coaxial mates have external teeth of different number, else None.

    Cut with one module their centre distances differ as ``mate + planet`` do. The larger mate is taken for a ring
    without its minus where its teeth are nearer to a ring's, ``smaller + 2 planet``, than to the smaller mate's.

    Parameters
    ----------
    planet : (str, int)
        Link and number of teeth.
    mates : mapping of str to int
        Number of teeth by link.
    """
    link, teeth = planet
    (small, fewest), *_, (large, most) = sorted(mates.items(), key=lambda mate: mate[1])
    if fewest == most:
        return None
    cure = "the meshes need profile shift"
    if abs(fewest + 2 * teeth - most) < most - fewest:
        cure = f"inner teeth have a minus, did you mean {large} = -{most}?"
    return (
        f'planets "{link}": {small} and {large} turn about one axis and both mesh with {link} by outer teeth, but '
        f"{fewest} + {teeth} = {fewest + teeth} is not {most} + {teeth} = {most + teeth}: {cure}"
    )


def assembly_warnings(sun: int, planet: int, ring: int, angles_deg: Sequence[float]) -> Iterator[str]:
    """Yield a warning for each assembly condition that planets between a sun and a ring violate.

    With teeth cut at the same centre distance the ring needs ``sun + 2 planet`` teeth, or profile shift. A planet
    can be put in only where it meets both gears tooth in gap, every ``360 / (sun + ring)`` degrees. Standard tip
    circles, a module outside the pitch circle, must not touch.
    """
    if ring != sun + 2 * planet:
        yield f"{sun} + 2 x {planet} = {sun + 2 * planet}, not the ring's {ring} teeth: the meshes need profile shift"
    copies, step = len(angles_deg), 360 / (sun + ring)
    teeth_per_copy = Fraction(sun + ring, copies)
    if teeth_per_copy.denominator != 1:
        yield (
            f"({sun} + {ring}) / {copies} = {float(teeth_per_copy):g} is not whole, so {copies} planets cannot be "
            f"spaced evenly; permitted are multiples of {step:.4g} degrees"
        )
    even = all(abs(angle - 360 * number / copies) < _TOLERANCE_DEG for number, angle in enumerate(angles_deg))
    for number, angle in enumerate([] if even else angles_deg):
        off = abs(angle - round(angle / step) * step)
        if off > _TOLERANCE_DEG:
            yield (
                f"planet {number + 1} at {angle:.4g} degrees is {off:.3g} degrees from the nearest multiple of "
                f"{step:.4g} degrees that its teeth permit"
            )
    gaps = [(later - earlier) for earlier, later in pairwise([*angles_deg, 360.0 + angles_deg[0]])]
    centres = (sun + planet) * sin(radians(min(gaps) / 2)) if copies > 1 else float("inf")
    if planet + 2 >= centres:
        yield (
            f"neighbouring planets {min(gaps):.4g} degrees apart touch: tip circles of {planet} + 2 modules, centres "
            f"{centres:.4g} modules apart"
        )
