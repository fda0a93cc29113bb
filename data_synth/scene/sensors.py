"""The measurement chain from the machine surface to the file, as declared in a scene; every part is optional.

The order is that of the hardware. A sensor responds to the motion along its axis and to a fraction of the transverse
motion (`cross_axis`), resonates on its mount (`resonance`), and outputs volts (`sensitivity`), whose bias is removed by
the coupling (`ac_coupling_hz`, the -3 dB frequency of a first-order high-pass filter); the recorder filters
(`anti_alias`, unless it is "none"), adds noise (`noise` of the scene), saturates (`clipping`), quantises
(`quantisation`) and loses samples (`drop_outs`). Levels after the sensor are in the units of the channel.
"""

from collections.abc import Collection, Iterable
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from data_synth.scene.operation import Finite, NotNegative, Share, csv_rows
from hums.gearbox.components import Declared, Name, Positive, Vector, closest

STANDARD_GRAVITY = 9.80665  # m s-2 per g


class Mode(Declared):
    """A damped mode: undamped natural frequency and damping ratio."""

    frequency_hz: Positive
    damping_ratio: Annotated[float, Field(gt=0, lt=1)]


class RingBending(Declared):
    """An elastic ring gear: a steel rim of thickness `rim_mm` behind the teeth, as wide as the mesh.

    By default the rim is 3.5 modules thick, above which ISO 6336-3:2006 neglects its effect on internal gear teeth.
    """

    rim_mm: Positive | None = None


class PlanetPass(Declared):
    """Amplitude modulation of planet meshes as the planets pass a sensor on a stationary ring gear.

    The gain is 1 where a planet is nearest, and halfway to `floor` at `half_width_deg`. In a kinematic scene it applies
    to all meshes of the planets, but not to the contribution of a damaged gear to such a mesh. If gears vibrate, it is
    the gain of the dynamic part of each force on the ring; of the static part only the resultant moves a rigid housing.
    With `ring`, the static part bends the ring, whose shape is measured by sensors on it as the planets pass (default:
    rigid).
    """

    half_width_deg: Annotated[float, Field(gt=0, lt=180)]
    floor: Share = 0.0
    ring: RingBending | None = None


class CrossAxis(Declared):
    """Transverse sensitivity: the fraction `share` of the transverse motion is added to that along the axis.

    In a kinematic scene the transverse motion is drawn like that of another sensor at the same place, with a gain for
    each source. If gears vibrate, the transverse direction is drawn.
    """

    share: Annotated[float, Field(gt=0, lt=1)]


class Sensitivity(Declared):
    """Output of the channel per unit of motion, such as ``{ value = 0.1, units = "V" }`` for 100 mV per unit."""

    value: Annotated[float, Field(allow_inf_nan=False)]
    units: Literal["V", "mV"]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.value == 0:
            raise ValueError("value = 0: such a sensor measures nothing; give its output per unit of motion")
        return self


ANALYSED_BAND = 1 / 2.56  # of the sampling rate: the band displayed by FFT analysers, 400 lines of 1,024 samples


class AntiAlias(Declared):
    """A Butterworth low-pass filter of `order`, -3 dB at `frequency_hz`, by default the sampling rate over 2.56.

    With the defaults, components that alias into the band below ``rate_hz / 2.56`` are attenuated by at least
    ``320 log10(1.56) = 62`` dB, those above 0.67 of the rate by 75 dB; up to 0.3 of the rate amplitudes change by less
    than 0.002 dB.
    """

    frequency_hz: Positive | None = None
    order: Annotated[int, Field(ge=1, le=24)] = 16

    def cutoff_hz(self, rate_hz: float) -> float:
        """Return the -3 dB frequency in Hz at a sampling rate."""
        return self.frequency_hz if self.frequency_hz is not None else ANALYSED_BAND * rate_hz


Filter = Annotated[
    Annotated[AntiAlias, Tag("filter")] | Annotated[Literal["none"], Tag("none")],
    Discriminator(lambda value: "none" if isinstance(value, str) else "filter"),
]


class Clipping(Declared):
    """Saturation of an amplifier at plus and minus `level`."""

    level: Positive


class Quantisation(Declared):
    """An analogue-to-digital converter of `bits` over plus and minus `full_scale`, with rounding and saturation."""

    bits: Annotated[int, Field(ge=2, le=32)]
    full_scale: Positive


class DropOuts(Declared):
    """Missing samples: gaps of `duration_s`, on average `per_second`.

    They read NaN, zero, or the last value before the gap (``hold``), depending on the recorder.
    """

    per_second: Positive
    duration_s: Positive
    reads: Literal["nan", "zero", "hold"] = "nan"


_TAKEN = ("time", "tachometer", "pulse_tachometer")


class Sensor(Declared):
    """An accelerometer on a bearing, link or mesh, and its channel.

    In a kinematic scene place and direction are labels. `units` are those of the motion; with a `sensitivity` the
    channel is in the units of that. `gain` is a calibration error, the ratio of the recorded to the true motion
    (default 1). Every channel has an anti-aliasing filter unless ``anti_alias = "none"``. Its samples are taken
    `skew_s` later than the record states, as by a multiplexed converter.
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
            raise ValueError("direction = [0, 0, 0] is not a direction; give [x, y, z] with a nonzero component")
        if self.name.startswith("truth_") or self.name in _TAKEN or "/" in self.name:
            raise ValueError(
                f'name = "{self.name}" is reserved in records or not allowed for a variable; give a name that has no '
                "slash, does not begin with truth_ and is not one of " + ", ".join(_TAKEN)
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
    """Raise ValueError for a channel with other units than the first, or unsuited to the sampling rate."""
    who = f'sensor "{sensor.name}"'
    for units, other in ((sensor.units, first.units), (sensor.channel_units, first.channel_units)):
        if units != other:
            raise ValueError(
                f'{who} has units "{units}" and "{first.name}" "{other}"; amplitudes are in the units of the '
                "sensors, so use the same for all"
            )
    if isinstance(sensor.anti_alias, AntiAlias) and (top := sensor.anti_alias.cutoff_hz(rate_hz)) >= rate_hz / 2:
        raise ValueError(
            f"{who}: anti_alias extends to {top:g} Hz, which is not below half of rate_hz = {rate_hz:g}; lower it"
        )
    drops = sensor.drop_outs
    if drops is not None and drops.per_second * drops.duration_s >= 1:
        raise ValueError(
            f"{who}: drop_outs.per_second = {drops.per_second:g} of {drops.duration_s:g} s each leave no samples; "
            "reduce either"
        )


# ---- Frequency response functions from a source to a sensor, modal or measured -----------------------------------


Line = tuple[Finite, Finite, Finite]


class ModeOfPath(Declared):
    """A mode of a frequency response: `gain` is its static response, ``gain / (2 zeta)`` that at resonance.

    Instead of `gain` its `residue` A (real, imaginary) may be given, in response per N s, as in modal analysis: the
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
    """The transfer function from a source (bearing, mesh or link) to a sensor: response in `units` to a force of 1 N.

    Given by `modes`, by measured `lines` (Hz, real, imaginary), or by the same three columns in a `csv` file in the
    folder of the scene; linear between lines, zero outside them. It replaces drawn gains, `path`, `resonance`,
    `cross_axis` and, if gears vibrate, the housing: amplitudes of its source are then in N, those of impacts in N s.
    """

    source: Name
    sensor: Name
    units: Literal["g", "m s-2"]
    modes: Annotated[tuple[ModeOfPath, ...], Field(min_length=1)] | None = None
    lines: Annotated[tuple[Line, ...], Field(min_length=2)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _read(cls, table: Any) -> Any:  # noqa: ANN401
        """Refuse a response given more than once; read it from a file."""
        if not isinstance(table, dict):
            return table
        given = [key for key in ("modes", "lines", "csv") if table.get(key) is not None]
        if len(given) != 1:
            said = f"given by {' and '.join(given)}; keep one" if given else "missing; give modes, lines or csv"
            raise ValueError(f"the response of {table.get('source')} at {table.get('sensor')} is {said}")
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
    """Raise ValueError for an unknown source or sensor, and for a repeated pair."""
    seen = set()
    for transfer in transfers:
        for word, name, valid in (("source", transfer.source, sources), ("sensor", transfer.sensor, sensors)):
            if name not in valid:
                raise ValueError(f'transfer names the {word} "{name}"{closest(name, [*valid])}')
        if (pair := (transfer.source, transfer.sensor)) in seen:
            raise ValueError(f'there are two transfers from "{pair[0]}" to "{pair[1]}"; keep one')
        seen.add(pair)
