"""What an analyst decides before an analysis; every default is written into the result."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from hums.declared import Declared, sentences
from hums.layout import AnalysisError

Band = tuple[float, float]


class AnalysisSettings(Declared):
    """What an analyst decides; every default is written into the result.

    Attributes
    ----------
    channels : names of vibration channels; default all.
    tachometer : which one tells the angle, where the record has several; default the first.
    speed_range_hz : (low, high) of the reference's speed, for a record that has neither a tachometer nor a declared
        speed: the speed is then estimated from the vibration.
    max_acceleration_hz_s : how fast that speed may change, in Hz a second; needed with `speed_range_hz`.
    envelope_band_hz : (low, high) of the band to demodulate, for all channels; "auto" to have one chosen for each
        (`signals.choose_band`) where the gearbox has bearings; None to search no bearing line.
    false_alarm_probability : chance that noise alone raises any finding in the whole record.
    harmonics : how many of each shaft, mesh and bearing rate are looked for.
    sidebands : how many on either side of each mesh harmonic.
    slip : how far a bearing line may lie from nominal, relative.
    nominal_speed_tolerance : how far any line may lie from nominal where the speed is declared, not measured.
    max_order : where the order spectrum ends; default a little above the last line looked for.
    track_bandwidth_orders : full -3 dB width of the amplitude trackers; default the most likely one of each line,
        at most 0.1 orders.
    most_tracks : how many lines of a channel are tracked, the strongest first; 0 for none.
    freeze_baseline : keep the variances of the baseline as they are, so that NA4 and NB4 become NA4* and NB4*.
    baseline_limit_std : freeze the variance of a gear by itself, at the first record that exceeds the mean of those
        before by that many of their standard deviations; default never.
    """

    channels: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    tachometer: str | None = None
    speed_range_hz: Band | None = None
    max_acceleration_hz_s: Annotated[float, Field(gt=0)] | None = None
    envelope_band_hz: Band | Literal["auto"] | None = "auto"
    false_alarm_probability: Annotated[float, Field(gt=0, lt=1)] = 0.01
    harmonics: Annotated[int, Field(ge=1, le=20)] = 3
    sidebands: Annotated[int, Field(ge=0, le=20)] = 3
    slip: Annotated[float, Field(gt=0, lt=0.2)] = 0.02
    nominal_speed_tolerance: Annotated[float, Field(ge=0, lt=0.2)] = 0.02
    max_order: Annotated[float, Field(gt=0)] | None = None
    track_bandwidth_orders: Annotated[float, Field(gt=0)] | None = None
    most_tracks: Annotated[int, Field(ge=0)] = 24
    freeze_baseline: bool = False
    baseline_limit_std: Annotated[float, Field(gt=0)] | None = None

    def __init__(self, **values: Any) -> None:  # noqa: ANN401
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise AnalysisError(f"settings: {sentences(error)}") from None

    @field_validator("envelope_band_hz", mode="before")
    @classmethod
    def _band_or_word(cls, band: Any) -> Any:  # noqa: ANN401
        pair = isinstance(band, tuple | list) and len(band) == 2  # noqa: PLR2004
        if not (band is None or band == "auto" or pair):
            raise ValueError(f'{band!r} is no band; give (low, high) in Hz, "auto" to have one chosen, or None')
        return band

    @model_validator(mode="after")
    def _check(self) -> Self:
        band = self.envelope_band_hz
        if isinstance(band, tuple) and not 0 <= band[0] < band[1]:
            raise ValueError(f"envelope_band_hz = {band} must rise from 0 or more; give (low, high)")
        speeds = self.speed_range_hz
        if speeds is not None and not 0 < speeds[0] < speeds[1]:
            raise ValueError(f"speed_range_hz = {speeds} must rise from above 0; give (low, high)")
        if (speeds is None) != (self.max_acceleration_hz_s is None):
            raise ValueError(
                f"speed_range_hz = {speeds} and max_acceleration_hz_s = {self.max_acceleration_hz_s} belong together: "
                "the range the speed lies in, and how fast it may change, in Hz a second; give both, or neither"
            )
        return self
