"""What a reader must know before believing the rest of an analysis, in sentences."""

from collections.abc import Iterator, Sequence

import numpy as np

from hums.channels import AnalysedChannel
from hums.machine import Machine
from hums.search import ORDER_SPECTRUM
from hums.settings import AnalysisSettings

_MOST_OF = 0.9  # of a record: less than this analysed is worth a note
_SPIKE = 100.0  # crest factor; Gaussian noise of a million samples reaches 5, bearing impacts some 30


def notes(machine: Machine, settings: AnalysisSettings, channels: Sequence[AnalysedChannel]) -> list[str]:
    """Return the notes, those about the angle first."""
    return [
        *_about_speed(machine, settings),
        *machine.tachometer_verdict[1],
        *_about_band(machine, settings, channels),
        *_about_blur(machine, channels),
        *(note for channel in channels for note in _about_channel(channel, machine)),
        *(note for channel in channels for note in _about_end(channel, settings)),
        *(note for channel in channels for note in _about_reach(channel)),
    ]


def _about_speed(machine: Machine, settings: AnalysisSettings) -> Iterator[str]:
    shaft, found = machine.source.shaft, machine.source.estimated
    if settings.speed_range_hz is not None and found is None:
        known = f'tachometer "{machine.source.tachometer}"' if machine.source.tachometer else "a declared speed"
        yield (
            f"The record has {known}, which tells the angle: the range and acceleration given for estimating the speed "
            "(speed_range_hz, --speed-range; max_acceleration_hz_s, --max-acceleration) were not used."
        )
    if machine.phase.nominal:
        yield (
            f"The speed is nominal: declared for {shaft}, not measured. Lines are searched within "
            f"{settings.nominal_speed_tolerance:.1%} of their nominal order and smear if the speed changed."
        )
    if found is not None:
        yield (
            f'The speed is estimated from the vibration of channel "{found.channel}", without a tachometer: mean '
            f"confidence {found.confidence:.3g}. It rests on the orders of the gearbox being right."
        )


def _about_band(machine: Machine, settings: AnalysisSettings, channels: Sequence[AnalysedChannel]) -> Iterator[str]:
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


def _about_blur(machine: Machine, channels: Sequence[AnalysedChannel]) -> Iterator[str]:
    blurred = machine.blurred_order
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


def _about_channel(channel: AnalysedChannel, machine: Machine) -> Iterator[str]:
    analysed = _analysed_s(channel, machine)
    if channel.sick:
        yield (
            f'Channel "{channel.name}" is sick (see sensor health): its indicators are withheld but for the raw RMS, '
            "and nothing it shows is diagnosed."
        )
    if analysed < _MOST_OF * channel.duration_s:
        where = "the tachometer covers" if machine.source.tachometer else "the shaft's angle is known for"
        yield (
            f'Channel "{channel.name}": {analysed:.3g} of {channel.duration_s:.3g} s are analysed, the whole '
            f"revolutions that {where}; the rest says nothing here."
        )
    if channel.crest > _SPIKE:
        yield (
            f'Channel "{channel.name}": one sample stands {channel.crest:.0f} times above the RMS, as a spike of '
            "the electronics does; it can hide everything else."
        )


def _about_end(channel: AnalysedChannel, settings: AnalysisSettings) -> Iterator[str]:
    stated, last = settings.max_order, float(channel.spectra[ORDER_SPECTRUM].axis[-1])
    if stated is not None and last + channel.spectra[ORDER_SPECTRUM].bin_width < stated:
        yield (
            f'Channel "{channel.name}": its order spectrum ends at {last:.4g} orders, not at the {stated:g} asked for '
            f"(max_order, --max-order): at the highest speed its rate of {channel.rate_hz:g} Hz carries no more."
        )


def _about_reach(channel: AnalysedChannel) -> Iterator[str]:
    if channel.beyond:
        names = sorted({f"{w.component} {w.kind}" for w in channel.beyond})
        yield (
            f'Channel "{channel.name}": {len(channel.beyond)} lines are out of reach, above what the sampling rate '
            f"or the envelope's band carries or in too short a record to judge: {', '.join(names)}."
        )


def _analysed_s(channel: AnalysedChannel, machine: Machine) -> float:
    """Time that the whole revolutions of a channel last."""
    signal = channel.signal
    ends = machine.phase.times_at(np.array([signal.start_rev, signal.start_rev + signal.revolutions]))
    return float(ends[1] - ends[0])
