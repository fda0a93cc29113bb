"""Caveats of an analysis: limits of its speed, bands, channels and spectra, in sentences."""

from collections.abc import Iterator, Sequence

from hums.analysis.channel import AnalysedChannel
from hums.analysis.lines import ORDER_SPECTRUM
from hums.analysis.reference_angle import Machine
from hums.analysis.segments import SegmentedRecord
from hums.analysis.settings import AnalysisSettings

_MOST_OF = 0.9  # of a record, below which the analysed part has a note
_SPIKE = 100.0  # crest factor; Gaussian noise of a million samples reaches 5, bearing impacts some 30


def notes(
    record: SegmentedRecord, settings: AnalysisSettings, channels: Sequence[AnalysedChannel], unlike: str
) -> list[str]:
    """Return the caveats, those on speed and tachometer first; `unlike` is why the record is not like its drawing."""
    machine = record.machine
    left_out = [f"Left out: {one.why}" for one in record.channels.values() if not one.segments]
    if not record.machines:  # an average in angle has no speed
        return [*record.left_out, *left_out]
    return [
        *_speed_notes(machine, settings),
        *machine.tachometer_condition[1],
        *_band_notes(machine, settings, channels),
        *_jitter_notes(machine, channels),
        *(note for channel in channels for note in _channel_notes(channel, machine)),
        *(note for channel in channels for note in _spectrum_end_notes(channel, settings)),
        *(note for channel in channels for note in _out_of_range_notes(channel)),
        *([unlike[0].upper() + unlike[1:] + "."] if unlike else []),
        *dict.fromkeys(note for channel in channels for note in _pooled_notes(channel)),
        *record.left_out,
        *(f"A segment is left out: {why}" for channel in channels for why in channel.failed),
        *left_out,
    ]


def _pooled_notes(channel: AnalysedChannel) -> Iterator[str]:
    """Yield what the average over segments is of."""
    if len(channel.segments) == 1:
        return
    spectrum = channel.spectra[ORDER_SPECTRUM]
    snapshots = channel.segments[0].parts_per_turn > 1
    pieces = "snapshots" if snapshots else "segments"
    yield (
        f"{len(channel.segments)} {pieces} were analysed together: spectra are averages of power over "
        f"{channel.blocks} blocks of {1 / spectrum.bin_width:.4g} turns. Lines nearer to each other than "
        f"{spectrum.resolution:.2g} orders are one, whatever the number of {pieces}; probabilities are those of "
        "records in one piece, which pooled noise does not exceed."
        + ("" if snapshots else " Indicators and gears are those of the median segment, pictures those of the first.")
    )


def _speed_notes(machine: Machine, settings: AnalysisSettings) -> Iterator[str]:
    shaft, found = machine.source.shaft, machine.source.estimated
    if settings.speed_range_hz is not None and found is None:
        known = f'tachometer "{machine.source.tachometer}"' if machine.source.tachometer else "a declared speed"
        yield (
            f"The record has {known}, which tells the angle: the range and acceleration given for estimating the speed "
            "(speed_range_hz, --speed-range; max_acceleration_hz_s, --max-acceleration) were not used to estimate it."
        )
    declared = machine.source.declared
    if declared is not None and declared.refined:
        lines = ", ".join(f"{order:.4g}" for order in declared.orders[:6])
        yield (
            f"The declared speed of {shaft} was refined from {declared.declared_hz:.5g} to {declared.speed_hz:.5g} Hz "
            f"by lines of orders {lines} per turn of it, which show that speed within the tolerance."
        )
    if machine.phase.nominal:
        known = "refined" if declared is not None and declared.refined else "declared"
        yield (
            f"The speed is nominal: {known} for {shaft}, not measured. Lines are searched within "
            f"{settings.nominal_speed_tolerance:.1%} of their nominal order"
            + (
                "; its changes were followed by the lines of shafts and meshes."
                if machine.source.followed
                else " and smear if the speed changed."
            )
        )
    if found is not None:
        yield (
            f'The speed is estimated from the vibration of channel "{found.channel}", without a tachometer: mean '
            f"confidence {found.confidence:.3g}. It rests on the orders of the gearbox being right."
        )


def _band_notes(machine: Machine, settings: AnalysisSettings, channels: Sequence[AnalysedChannel]) -> Iterator[str]:
    if settings.envelope_band_hz is None and machine.bearings:
        yield (
            "No envelope band was given, so no bearing line was searched. Choose a band with a resonance that the "
            "bearing excites (envelope_band_hz, on the command line --envelope-band LOW HIGH)."
        )
    for channel in channels:
        if channel.no_band:
            yield (
                f'Channel "{channel.name}": no envelope band can be chosen, so no bearing line was searched in it: '
                f"{channel.no_band}"
            )


def _jitter_notes(machine: Machine, channels: Sequence[AnalysedChannel]) -> Iterator[str]:
    blurred = machine.jitter_limit_order
    if not any(blurred < channel.spectra[ORDER_SPECTRUM].axis[-1] for channel in channels):
        return
    if machine.source.tachometer:
        yield (
            f"The tachometer's pulses jitter by {machine.jitter_s * 1e6:.3g} us: lines above {blurred:.3g} orders are "
            "blurred and read low."
        )
    elif machine.source.estimated is not None:
        yield (
            f"The angle estimated from the vibration is uncertain by about {machine.jitter_s * 1e6:.3g} us: "
            f"lines above {blurred:.3g} orders are blurred and read low."
        )


def _channel_notes(channel: AnalysedChannel, machine: Machine) -> Iterator[str]:
    if channel.faulty:
        yield (
            f'Channel "{channel.name}" is sick (see sensor health): its indicators are withheld but for the raw RMS, '
            "and nothing it shows is diagnosed."
        )
    if channel.left_out:
        yield (
            f'Channel "{channel.name}" has {channel.left_out}: {channel.analysed_s:.3g} of {channel.duration_s:.3g} s '
            f"are analysed, whole revolutions in {len(channel.segments)} segments between gaps."
        )
    elif channel.analysed_s < _MOST_OF * channel.duration_s:
        where = "the tachometer covers" if machine.source.tachometer else "the shaft's angle is known for"
        yield (
            f'Channel "{channel.name}": {channel.analysed_s:.3g} of {channel.duration_s:.3g} s are analysed, the whole '
            f"revolutions that {where}; the rest is not analysed."
        )
    if channel.crest_factor > _SPIKE:
        yield (
            f'Channel "{channel.name}": one sample stands {channel.crest_factor:.0f} times above the RMS, as a spike '
            "of the electronics does; it can hide everything else."
        )


def _spectrum_end_notes(channel: AnalysedChannel, settings: AnalysisSettings) -> Iterator[str]:
    stated, last = settings.max_order, float(channel.spectra[ORDER_SPECTRUM].axis[-1])
    if stated is not None and last + channel.spectra[ORDER_SPECTRUM].bin_width < stated:
        yield (
            f'Channel "{channel.name}": its order spectrum ends at {last:.4g} orders, not at the {stated:g} asked for '
            f"(max_order, --max-order): at the highest speed its rate of {channel.rate_hz:g} Hz carries no more."
        )


def _out_of_range_notes(channel: AnalysedChannel) -> Iterator[str]:
    if channel.out_of_range:
        names = sorted({f"{w.component} {w.kind}" for w in channel.out_of_range})
        yield (
            f'Channel "{channel.name}": {len(channel.out_of_range)} lines are out of reach, above what the sampling '
            f"rate or the envelope's band carries or in too short a record to judge: {', '.join(names)}."
        )
