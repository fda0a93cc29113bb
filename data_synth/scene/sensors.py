"""The measurement chain from the machine's surface to the file, as a scene declares it; every part is optional.

The order is that of the hardware. A sensor responds to the motion along its axis and to a part of the transverse motion
(`cross_axis`), resonates on its mount (`resonance`), and gives volts (`sensitivity`), whose bias the coupling takes
away (`ac_coupling_hz`, the frequency of -3 dB of a first-order high pass); the recorder filters (`anti_alias`, unless
it is "none"), adds its noise (`noise` of the scene), saturates (`clipping`), quantises (`quantisation`) and loses
samples (`drop_outs`). Levels after the sensor are in the units of the channel.
"""

from collections.abc import Collection, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from data_synth.scene.operation import Finite, NotNegative, Share, csv_rows
from hums.gearbox.components import Declared, Name, Positive, Vector, closest

STANDARD_GRAVITY = 9.80665  # m s-2 to a g


class Mode(Declared):
    """One damped mode: undamped natural frequency and damping ratio."""

    frequency_hz: Positive
    damping_ratio: Annotated[float, Field(gt=0, lt=1)]


class RingBending(Declared):
    """An elastic ring gear: a rim of thickness `rim_mm` behind its teeth, of steel, as wide as the mesh.

    Left out, the rim is 3.5 modules, from where on ISO 6336-3:2006 sees no effect of it on an internal gear's teeth.
    """

    rim_mm: Positive | None = None


class PlanetPass(Declared):
    """Amplitude modulation of planet meshes as the planets pass a sensor on a stationary ring gear.

    The gain is 1 where a planet is nearest, and halfway to `floor` at `half_width_deg`. In a kinematic scene it applies
    to all meshes of the planets; what a damaged gear adds to such a mesh is not modulated. Where gears vibrate, it is
    the gain of the dynamic part of each force on the ring: the static part moves a rigid housing by its sum alone. With
    `ring`, the static part bends the ring, and sensors on it have its shape as the planets pass (left out: rigid).
    """

    half_width_deg: Annotated[float, Field(gt=0, lt=180)]
    floor: Share = 0.0
    ring: RingBending | None = None


class CrossAxis(Declared):
    """Transverse sensitivity: `share` of the transverse motion is added to that along the axis.

    In a kinematic scene the transverse motion is drawn like that of another sensor at the place: a gain for each
    source. Where gears vibrate, the transverse direction is drawn.
    """

    share: Annotated[float, Field(gt=0, lt=1)]


class Sensitivity(Declared):
    """Output of the channel for one unit of motion, as ``{ value = 0.1, units = "V" }`` for 100 mV a unit."""

    value: Annotated[float, Field(allow_inf_nan=False)]
    units: Literal["V", "mV"]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.value == 0:
            raise ValueError("value = 0: such a sensor measures nothing; give its volts for one unit of motion")
        return self


ANALYSED_BAND = 1 / 2.56  # of the sampling rate: the band that FFT analysers show, 400 lines of 1,024 samples


class AntiAlias(Declared):
    """A Butterworth low-pass filter of `order`, -3 dB at `frequency_hz`; left out, at the sampling rate over 2.56.

    By default what folds into the band below ``rate_hz / 2.56`` is at least ``320 log10(1.56) = 62`` dB down, and 75 dB
    from 0.67 of the rate on; up to 0.3 of the rate amplitudes change by less than 0.002 dB.
    """

    frequency_hz: Positive | None = None
    order: Annotated[int, Field(ge=1, le=24)] = 16

    def cutoff_hz(self, rate_hz: float) -> float:
        """Return the frequency of -3 dB in Hz at a sampling rate."""
        return self.frequency_hz if self.frequency_hz is not None else ANALYSED_BAND * rate_hz


Filter = Annotated[
    Annotated[AntiAlias, Tag("filter")] | Annotated[Literal["none"], Tag("none")],
    Discriminator(lambda value: "none" if isinstance(value, str) else "filter"),
]


class Clipping(Declared):
    """Saturation of an amplifier at plus and minus `level`."""

    level: Positive


class Quantisation(Declared):
    """An analogue-to-digital converter of `bits` over plus and minus `full_scale`: it rounds, and saturates."""

    bits: Annotated[int, Field(ge=2, le=32)]
    full_scale: Positive


class DropOuts(Declared):
    """Missing samples: gaps of `duration_s`, on average `per_second`.

    They read NaN; or zero, or the last value before the gap (``hold``), as some recorders write.
    """

    per_second: Positive
    duration_s: Positive
    reads: Literal["nan", "zero", "hold"] = "nan"


_TAKEN = ("time", "tachometer", "pulse_tachometer")


class Sensor(Declared):
    """An accelerometer on a bearing, link or mesh, and its channel.

    In a kinematic scene place and direction are labels. `units` are those of the motion; with a `sensitivity` the
    channel is in its units. `gain` is an error of calibration: what the record has of the motion, 1 where left out.
    Every channel has an anti-aliasing filter: ``anti_alias = "none"`` leaves it out. Its samples are taken `skew_s`
    later than the record says, as by a multiplexed converter.
    """

    name: Name
    on: Name
    direction: Vector | None = None
    units: Literal["g", "m s-2"]
    cross_axis: CrossAxis | None = None
    resonance: Mode | None = None
    gain: Positive | None = None
    sensitivity: Sensitivity | None = None
    ac_coupling_hz: Positive | None = None
    anti_alias: Filter = AntiAlias()
    clipping: Clipping | None = None
    quantisation: Quantisation | None = None
    drop_outs: DropOuts | None = None
    skew_s: Annotated[float, Field(ge=-1e-2, le=1e-2)] = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.direction is not None and not any(self.direction):
            raise ValueError("direction = [0, 0, 0] is none; give [x, y, z] with at least one that is not zero")
        if self.name.startswith("truth_") or self.name in _TAKEN or "/" in self.name:
            raise ValueError(
                f'name = "{self.name}": a record has other variables of this name, or no variable can have it; give a '
                "name that has no slash, does not begin with truth_ and is not one of " + ", ".join(_TAKEN)
            )
        return self

    @property
    def channel_units(self) -> str:
        """Units of the channel."""
        return self.sensitivity.units if self.sensitivity is not None else self.units


class Noise(Declared):
    """White Gaussian noise of each channel, `rms` in the units of the motion."""

    rms: NotNegative = 0.05


def check_chain(sensor: Sensor, *, first: Sensor, rate_hz: float) -> None:
    """Raise ValueError for a channel whose units differ from the first one's, or that its sampling rate cannot hold."""
    who = f'sensor "{sensor.name}"'
    for units, other in ((sensor.units, first.units), (sensor.channel_units, first.channel_units)):
        if units != other:
            raise ValueError(
                f'{who} has units "{units}" and "{first.name}" "{other}"; amplitudes are in the units of the '
                "sensors, so use one for all"
            )
    if isinstance(sensor.anti_alias, AntiAlias) and (top := sensor.anti_alias.cutoff_hz(rate_hz)) >= rate_hz / 2:
        raise ValueError(
            f"{who}: anti_alias reaches {top:g} Hz, which is not below half of rate_hz = {rate_hz:g}; lower it"
        )
    drops = sensor.drop_outs
    if drops is not None and drops.per_second * drops.duration_s >= 1:
        raise ValueError(
            f"{who}: drop_outs.per_second = {drops.per_second:g} of {drops.duration_s:g} s each leave nothing; "
            "lower one of them"
        )


# ---- Frequency response functions from a source to a sensor, modal or measured -----------------------------------


Line = tuple[Finite, Finite, Finite]


class ModeOfPath(Declared):
    """One mode of a frequency response: `gain` is its static response, ``gain / (2 zeta)`` that at resonance.

    In place of `gain` its `residue` (real, imaginary) may be given, in response per N s, as modal analysis has it: the
    mode is ``A / (j w - p) + conj(A) / (j w - conj(p))``.
    """

    frequency_hz: Positive
    damping_ratio: Annotated[float, Field(gt=0, lt=1)]
    gain: Finite | None = None
    residue: tuple[Finite, Finite] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.gain is None) == (self.residue is None):
            given = "both given; keep one" if self.gain is not None else "both missing; give one"
            raise ValueError(f"gain and residue of the mode at {self.frequency_hz:g} Hz are {given}")
        return self


class Transfer(Declared):
    """The transfer function from a source (bearing, mesh or link) to a sensor: response in `units` for a force of 1 N.

    Given by `modes`; or by measured `lines` (Hz, real, imaginary), or the same three columns in a `csv` file beside the
    scene: linear between lines, zero outside them. It replaces drawn gains, `path`, `resonance`, `cross_axis` and,
    where gears vibrate, the housing: amplitudes of its source are then in N, of impacts in N s.
    """

    source: Name
    sensor: Name
    units: Literal["g", "m s-2"]
    modes: Annotated[tuple[ModeOfPath, ...], Field(min_length=1)] | None = None
    lines: Annotated[tuple[Line, ...], Field(min_length=2)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _read(cls, table: Any) -> Any:  # noqa: ANN401
        """Refuse a response given twice; read it where it is in a file."""
        if not isinstance(table, dict):
            return table
        given = [key for key in ("modes", "lines", "csv") if table.get(key) is not None]
        if len(given) != 1:
            said = f"{' and '.join(given)} are both given; keep one" if given else "give modes, lines or csv"
            raise ValueError(f"the response of {table.get('source')} at {table.get('sensor')} is one thing: {said}")
        if "csv" not in table:
            return table
        kept = {key: value for key, value in table.items() if key != "csv"}
        return kept | {"lines": csv_rows(Path(table["csv"]), "Hz", "real", "imaginary")}

    @model_validator(mode="after")
    def _check(self) -> Self:
        frequencies = [line[0] for line in self.lines or ()]
        for before, after in pairwise([-1.0, *frequencies]):
            if after <= before or after < 0:
                raise ValueError(f"lines: {after:g} Hz follows {max(before, 0):g} Hz; sort them from 0 or above")
        return self


def check_transfers(transfers: Iterable[Transfer], *, sources: Collection[str], sensors: Collection[str]) -> None:
    """Raise ValueError for an unknown source or sensor, and for a pair that is given twice."""
    seen = set()
    for transfer in transfers:
        for word, name, valid in (("source", transfer.source, sources), ("sensor", transfer.sensor, sensors)):
            if name not in valid:
                raise ValueError(f'transfer names the {word} "{name}"{closest(name, [*valid])}')
        if (pair := (transfer.source, transfer.sensor)) in seen:
            raise ValueError(f'two transfers lead from "{pair[0]}" to "{pair[1]}"; keep one')
        seen.add(pair)
