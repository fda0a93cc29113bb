"""Settings of an analysis, and its error."""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from hums.gearbox.components import Declared, Positive, sentences
from signals._validation import SentenceError

Band = tuple[float, float]


class AnalysisError(SentenceError):
    """Raised if a record, gearbox or setting does not permit an analysis.

    Examples
    --------
    >>> import hums
    >>> try:
    ...     hums.AnalysisSettings(harmonics=0)
    ... except hums.AnalysisError as error:
    ...     print("harmonics" in str(error))
    True
    """


class AnalysisSettings(Declared):
    """Settings of an analysis; the result records every one of them.

    Attributes
    ----------
    channels : tuple of str, optional
        Vibration channels to analyse. Default: all.
    tachometer : str, optional
        Tachometer that measures the shaft angle, if the record has several. Default: the first.
    speed_range_hz : (float, float), optional
        Lowest and highest speed of the reference in rev/s. Required if the record has neither a tachometer nor a
        declared speed: the speed is then estimated from the vibration. A tachometer whose median speed lies outside is
        refused; without a range, one above 750 rev/s.
    max_acceleration_hz_s : float, optional
        Highest rate of change of that speed in rev/s per second; given together with `speed_range_hz`.
    envelope_band_hz : (float, float), "auto" or None
        Band to demodulate in Hz, for all channels; ``"auto"`` chooses one for each channel, from a bank of bands if the
        gearbox has bearings; None omits the envelope and the bearing lines.
    false_alarm_probability : float
        Probability that noise alone raises any finding in the record.
    harmonics : int
        Number of harmonics searched for each shaft, mesh and bearing frequency.
    sidebands : int
        Number of sidebands searched on either side of each mesh harmonic.
    slip : float
        Largest relative deviation of a bearing line from its kinematic order.
    nominal_speed_tolerance : float
        Largest relative deviation of any line from its order if the speed is declared and not measured.
    max_order : float, optional
        Highest order of the order spectrum. Default: just above the highest expected line.
    track_bandwidth_orders : float, optional
        Full -3 dB width of the amplitude trackers in orders. Default: the maximum-likelihood width of each line, at
        most 0.1 orders.
    most_tracks : int
        Largest number of lines tracked in each channel, the strongest first; 0 for none.
    pictures : bool
        Whether to include the other data of the report: waveforms, order maps, synchronous averages and kurtograms.
    velocity_limits_mm_s : (float, float, float), optional
        Largest RMS velocity in mm/s of the zones A, B and C of ISO 20816 for this machine, by its class in the
        applicable part of the standard or by agreement; without them no zone is stated.
    machine_class : str
        That class and part in words, shown next to the zone.
    freeze_baseline : bool
        Leave the variances of the baseline unchanged, so that NA4 and NB4 become NA4* and NB4*.
    baseline_limit_std : float, optional
        Freeze the variance of a gear at the first record that exceeds the mean of the earlier ones by this many of
        their standard deviations. Default: never.

    Raises
    ------
    AnalysisError
        If a value is out of range, or `speed_range_hz` and `max_acceleration_hz_s` are not given together.

    Examples
    --------
    >>> import hums
    >>> settings = hums.AnalysisSettings(envelope_band_hz=(2000, 4000), harmonics=5)
    >>> settings.envelope_band_hz, settings.harmonics, settings.slip
    ((2000.0, 4000.0), 5, 0.02)
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
    pictures: bool = True
    velocity_limits_mm_s: tuple[Positive, Positive, Positive] | None = None
    machine_class: str = ""
    freeze_baseline: bool = False
    baseline_limit_std: Annotated[float, Field(gt=0)] | None = None

    def __init__(self, **values: Any) -> None:  # noqa: ANN401
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise AnalysisError(f"settings: {sentences(error)}") from None

    @field_validator("envelope_band_hz", mode="before")
    @classmethod
    def _check_band_type(cls, band: Any) -> Any:  # noqa: ANN401
        pair = isinstance(band, tuple | list) and len(band) == 2  # noqa: PLR2004
        if not (band is None or band == "auto" or pair):
            raise ValueError(f'{band!r} is not a band; give (low, high) in Hz, "auto" to choose one, or None')
        return band

    @model_validator(mode="after")
    def _check(self) -> Self:
        band = self.envelope_band_hz
        if isinstance(band, tuple) and not 0 <= band[0] < band[1]:
            raise ValueError(f"envelope_band_hz = {band} must rise from 0 or more; give (low, high)")
        limits = self.velocity_limits_mm_s
        if limits is not None and not limits[0] < limits[1] < limits[2]:
            raise ValueError(f"velocity_limits_mm_s = {limits} must rise: the upper limits of zones A, B and C in mm/s")
        speeds = self.speed_range_hz
        if speeds is not None and not 0 < speeds[0] < speeds[1]:
            raise ValueError(f"speed_range_hz = {speeds} must rise from above 0; give (low, high)")
        if (speeds is None) != (self.max_acceleration_hz_s is None):
            raise ValueError(
                f"speed_range_hz = {speeds} and max_acceleration_hz_s = {self.max_acceleration_hz_s} belong together: "
                "where the reference's speed lies in rev/s, --speed-range LOW HIGH, and how fast it may change, "
                "--max-acceleration HZ_PER_S; give both, or neither"
            )
        return self
