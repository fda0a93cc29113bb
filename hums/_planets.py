"""Whether planets can be put between sun and ring: spacing, neighbours, and the tooth counts themselves."""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from math import radians, sin

_PERMITTED_DEG = 0.02  # drawings print angles with two decimals


def stations(copies: int, spacing_deg: Sequence[float] | None) -> list[float]:
    """Return where each planet stands, in degrees from the first one.

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
    if min(given) > 0 and abs(sum(given) - 360) < copies * _PERMITTED_DEG:
        return [sum(given[:number]) for number in range(copies)]
    raise ValueError(
        f"spacing_deg = {given}: give the angle of each copy, rising from 0 and below 360, or the gaps between "
        f"them, which add up to 360 (these add up to {sum(given):g})"
    )


def coaxial_warning(planet: tuple[str, int], mates: Mapping[str, int]) -> str | None:
    """Say so where outer teeth of different number, on one axis, mesh with one planet; names and numbers of teeth.

    Cut with one module their centre distances differ as ``mate + planet`` do. The larger one is taken for a ring
    without its minus where it is nearer to fitting as such, ``smaller + 2 planet``, than to the smaller one.
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
    """Yield what does not fit when planets of one size stand between a sun and a ring, numbers of teeth given.

    With teeth cut at the same centre distance the ring needs ``sun + 2 planet`` teeth, or profile shift. A planet
    can stand only where both its meshes are in step, every ``360 / (sun + ring)`` degrees. Standard tip circles,
    a module outside the pitch circle, must not touch.
    """
    if ring != sun + 2 * planet:
        yield f"{sun} + 2 x {planet} = {sun + 2 * planet}, not the ring's {ring} teeth: the meshes need profile shift"
    copies, step = len(angles_deg), 360 / (sun + ring)
    share = Fraction(sun + ring, copies)
    if share.denominator != 1:
        yield (
            f"({sun} + {ring}) / {copies} = {float(share):g} is not whole, so {copies} planets cannot be spaced "
            f"evenly; permitted are multiples of {step:.4g} degrees"
        )
    even = all(abs(angle - 360 * number / copies) < _PERMITTED_DEG for number, angle in enumerate(angles_deg))
    for number, angle in enumerate([] if even else angles_deg):
        off = abs(angle - round(angle / step) * step)
        if off > _PERMITTED_DEG:
            yield (
                f"planet {number + 1} at {angle:.4g} degrees is {off:.3g} degrees from the nearest multiple of "
                f"{step:.4g} degrees that its teeth permit"
            )
    gaps = [(later - earlier) for earlier, later in pairwise([*angles_deg, 360.0 + angles_deg[0]])]
    room = (sun + planet) * sin(radians(min(gaps) / 2)) if copies > 1 else float("inf")
    if planet + 2 >= room:
        yield (
            f"neighbouring planets {min(gaps):.4g} degrees apart touch: tip circles of {planet} + 2 modules, centres "
            f"{room:.4g} modules apart"
        )
