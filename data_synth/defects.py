"""What is broken, as a scene declares it: kind, component, size, and how the size grows."""

from typing import Annotated, Literal, Self, get_args

from pydantic import Field, model_validator

from data_synth.driving import NotNegative, Share
from hums.gearbox import Declared, Name, Positive


class LinearGrowth(Declared):
    """The size grows by the same every second, up to `largest_mm`."""

    law: Literal["linear"]
    rate_mm_per_s: Positive
    largest_mm: Positive


class ExponentialGrowth(Declared):
    """The size grows by the factor e every `time_constant_s`, up to `largest_mm`."""

    law: Literal["exponential"]
    time_constant_s: Positive
    largest_mm: Positive


class ParisGrowth(Declared):
    """A fatigue crack: Paris' law with its `exponent`, from `rate_mm_per_s` at the beginning, up to `largest_mm`."""

    law: Literal["paris"]
    rate_mm_per_s: Positive
    exponent: Positive
    largest_mm: Positive


GrowthLaw = Annotated[LinearGrowth | ExponentialGrowth | ParisGrowth, Field(discriminator="law")]


class _Sized(Declared):
    """What has a size at the beginning of the record, `size_mm`, and may grow."""

    component: Name
    size_mm: Positive
    growth: GrowthLaw | None = None

    @property
    def initial_mm(self) -> float:
        """Size at the beginning of the record."""
        return self.size_mm


class ToothCrack(Declared):
    """A cracked tooth: the mesh modulated once a revolution over about one tooth, and one impact in it.

    The depth in mm times each of the three factors gives the relative rise of the mesh amplitude, the lag of
    the first mesh harmonic's phase (harmonic h: h times), and the amplitude of the impact, at full load. The
    factors are illustrative: a kinematic scene has no tooth stiffness to derive them from.
    """

    kind: Literal["tooth_crack"]
    component: Name
    depth_mm: Positive
    growth: GrowthLaw | None = None
    amplitude_per_mm: NotNegative = 0.2
    phase_rad_per_mm: NotNegative = 0.1
    impact_per_mm: NotNegative = 1.0

    @property
    def initial_mm(self) -> float:
        """Size at the beginning of the record."""
        return self.depth_mm


class GearFault(_Sized):
    """Any other damage of a gear; the factors are those of a crack, and as illustrative.

    Of one tooth: `chipping` (size: the width gone), `missing_tooth` (size: what the next tooth is hit by), `spall`.
    Of several: `pitting` of `count` teeth among `spread` neighbours. Of all: `eccentricity`, `misalignment` with
    `twice` of its swing twice a turn, `wear`; these strike nothing. A spall or pit is `length_pitches` long, in parts
    of the path from tooth to tooth.
    """

    kind: Literal["chipping", "missing_tooth", "spall", "pitting", "eccentricity", "misalignment", "wear"]
    amplitude_per_mm: NotNegative = 0.2
    phase_rad_per_mm: NotNegative = 0.1
    impact_per_mm: NotNegative = 1.0
    length_pitches: Annotated[float, Field(gt=0, le=1)] = 0.3
    count: Annotated[int, Field(ge=1)] = 3
    spread: Annotated[int, Field(ge=1)] = 5
    twice: Share = 0.5

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.kind == "pitting" and self.count > self.spread:
            raise ValueError(f"count = {self.count} pitted teeth do not fit among spread = {self.spread} neighbours")
        return self


class ShaftFault(_Sized):
    """Damage of a shaft: lines at its turns of `size_mm` times `amplitude_per_mm` at top speed, an illustrative factor.

    `imbalance` (size: the eccentricity) once a turn, with the square of speed; `bent_shaft` mostly once and
    `shaft_misalignment` mostly twice a turn, whatever the speed.
    """

    kind: Literal["imbalance", "bent_shaft", "shaft_misalignment"]
    amplitude_per_mm: NotNegative = 1.0


class BearingFault(_Sized):
    """A defect of a rolling bearing that is struck time and again, with slip.

    Intervals between impacts scatter by `slip_std` of the mean, independently, so their errors add up
    (Antoni and Randall 2003, J. Vib. Acoust. 125); `mean_slip` lowers the mean rate below that of pure rolling. Where
    the struck part turns through the load zone, impacts follow Stribeck's load distribution with the factor
    `load_distribution` (0.5: half of the ring carries). Their amplitude at
    full load is `size_mm` times `impact_per_mm`, an illustrative factor.
    """

    kind: Literal["inner_race", "outer_race", "rolling_element", "cage"]
    slip_std: Annotated[float, Field(ge=0, le=0.1)] = 0.01
    mean_slip: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.0
    load_distribution: Annotated[float, Field(gt=0, le=1)] = 0.5
    impact_per_mm: NotNegative = 1.0


Fault = Annotated[ToothCrack | GearFault | ShaftFault | BearingFault, Field(discriminator="kind")]


def _kinds(model: type[Declared]) -> tuple[str, ...]:
    return get_args(model.model_fields["kind"].annotation)


FAULT_KINDS = tuple(kind for model in (ToothCrack, BearingFault, GearFault, ShaftFault) for kind in _kinds(model))
ROW_OF = dict.fromkeys(_kinds(ToothCrack) + _kinds(GearFault), "tooth") | dict.fromkeys(_kinds(ShaftFault), "shaft")
"""The kind of defect order that a fault repeats at, where not its own name."""
