"""Choice of the band to demodulate, with the reasons for it and against it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from signals._validation import Array, checked, choice, positive
from signals.demodulation.kurtogram import NEGENTROPY_SCATTER, NOISE_NEGENTROPY, Kurtogram, fast_kurtogram

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Measure = Literal["steady_kurtosis", "kurtosis", "envelope_negentropy"]

RUNNERS_UP = 3
_SIGNIFICANT = 5.0  # standard deviations of noise: among 444 bands of noise one exceeds it in some hundred records


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A band of a kurtogram; its attributes are those of `signals.Kurtogram` for one band."""

    low_hz: float
    high_hz: float
    level: float
    kurtosis: float
    steady_kurtosis: float
    envelope_negentropy: float
    noise_std: float
    power_share: float

    @property
    def band_hz(self) -> tuple[float, float]:
        """Both edges in Hz."""
        return self.low_hz, self.high_hz

    def __str__(self) -> str:
        return f"{self.low_hz:.6g}-{self.high_hz:.6g} Hz"


@dataclass(frozen=True, kw_only=True)
class Band(Candidate):
    """The band chosen by `choose_band`, with its alternatives, the reason and the doubts.

    Attributes
    ----------
    low_hz, high_hz, level, kurtosis, steady_kurtosis, envelope_negentropy, noise_std, power_share : float
        As in `Kurtogram`, for this band.
    measure : str
        The measure that was maximised.
    runners_up : tuple of bands
        The next best bands that overlap neither this one nor each other.
    by_kurtosis, by_negentropy : band
        The bands that kurtosis and negentropy alone would choose.
    why : str
        The reason in words.
    doubts : tuple of str
        Reservations in words, empty if there are none.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import choose_band
    >>> band = choose_band(np.random.default_rng(1).standard_normal(20_000), rate_hz=10_000)
    >>> band.doubts[0].split(":")[0]
    'Steady noise could be all there is'
    """

    measure: Measure
    runners_up: tuple[Candidate, ...]
    by_kurtosis: Candidate
    by_negentropy: Candidate
    why: str
    doubts: tuple[str, ...]


@checked
def choose_band(
    x: ArrayLike,
    *,
    rate_hz: float,
    levels: int | None = None,
    modulation_hz: float | None = None,
    measure: Measure = "steady_kurtosis",
) -> Band:
    """Choose the band of a record with the strongest repeated impulses.

    By default the band of the highest steady kurtosis, that of the record without the two sixteenths of largest fourth
    moment. Unlike the plain kurtosis it is not raised by a single spike; a tone lowers it in its own bands only. The
    negentropy of the squared envelope's spectrum measures whether the impulses are *periodic*; where the measures
    disagree, `Band.doubts` says so.

    Parameters
    ----------
    x : (n,) array
        Samples, any unit.
    rate_hz : float
        Sampling rate in Hz.
    levels : int, optional
        As in `fast_kurtogram`.
    modulation_hz : float, optional
        Least width of the band in Hz: the fastest modulation of interest, say three times a defect frequency. Default:
        no limit.
    measure : {"steady_kurtosis", "kurtosis", "envelope_negentropy"}
        The measure to maximise.

    Returns
    -------
    Band

    Raises
    ------
    ValueError
        As `fast_kurtogram`; or where no band is as wide as `modulation_hz`.

    Examples
    --------
    Impulses that excite a resonance at 3 kHz, 50 a second, in noise:

    >>> import numpy as np
    >>> from signals import choose_band
    >>> t = np.arange(20_000) / 20_000
    >>> ring = np.exp(-1500 * (t % 0.02)) * np.sin(2 * np.pi * 3000 * (t % 0.02))
    >>> band = choose_band(ring + 0.05 * np.random.default_rng(1).standard_normal(t.size), rate_hz=20_000)
    >>> band.low_hz <= 3000 <= band.high_hz, band.doubts
    (True, ())
    """
    choice(measure, name="measure", choices=get_args(Measure))
    gram = fast_kurtogram(x, rate_hz=rate_hz, levels=levels, with_negentropy=True)
    least = 0.0 if modulation_hz is None else positive(modulation_hz, name="modulation_hz")
    # a relative 1e-9: widths are quotients of the rate
    allowed = ((gram.high_hz - gram.low_hz) * (1 + 1e-9) >= least) & np.isfinite(gram.kurtosis)
    if not allowed.any():
        raise ValueError(
            f"modulation_hz={least:g} is wider than every band that holds power (at most {gram.high_hz[0]:g} Hz); "
            "lower it, or sample faster."
        )
    ranks = {
        name: np.flatnonzero(allowed)[np.argsort(-_column(gram, name)[allowed], kind="stable")]
        for name in get_args(Measure)
    }
    order = ranks[measure]
    best = _candidate(gram, order[0])
    by_kurtosis, by_negentropy = (_candidate(gram, ranks[name][0]) for name in ("kurtosis", "envelope_negentropy"))
    lines = float(gram.envelope_lines[order[0]])
    return Band(
        **vars(best),
        measure=measure,
        runners_up=_apart(gram, order),
        by_kurtosis=by_kurtosis,
        by_negentropy=by_negentropy,
        why=_why(best, by_kurtosis, measure=measure, bands=int(allowed.sum())),
        doubts=(*_about_choice(best, lines=lines), *_about_others(gram, allowed, best, by_negentropy)),
    )


def _column(gram: Kurtogram, name: str) -> Array:
    return np.asarray(getattr(gram, name), dtype=np.float64)


def _candidate(gram: Kurtogram, index: int) -> Candidate:
    return Candidate(**{name: float(_column(gram, name)[index]) for name in Candidate.__dataclass_fields__})


def _apart(gram: Kurtogram, order: NDArray[np.intp]) -> tuple[Candidate, ...]:
    """Return the next best bands that overlap neither the first nor each other."""
    chosen = [int(order[0])]
    low, high = gram.low_hz * (1 + 1e-9), gram.high_hz * (1 - 1e-9)  # edges that meet are rounded apart
    for index in order[1:]:
        if all(high[index] <= low[t] or low[index] >= high[t] for t in chosen):
            chosen.append(int(index))
        if len(chosen) > RUNNERS_UP:
            break
    return tuple(_candidate(gram, index) for index in chosen[1:])


def _why(best: Candidate, by_kurtosis: Candidate, *, measure: Measure, bands: int) -> str:
    """Return the reason for the choice in words."""
    words = measure.replace("_", " ")
    reason = f"{best}: its {words} of {getattr(best, measure):.3g} is the highest of {bands} bands"
    if measure == "steady_kurtosis":
        reason += (
            f" (noise scatters by {best.noise_std:.2g}; taken without the loudest two sixteenths of the record, "
            f"with them {best.kurtosis:.3g})"
        )
        if by_kurtosis.band_hz != best.band_hz:
            reason += (
                f". Plain kurtosis would choose {by_kurtosis} with {by_kurtosis.kurtosis:.3g}, of which "
                f"{by_kurtosis.steady_kurtosis:.3g} remain without those two parts"
            )
    return reason + "."


def _about_choice(best: Candidate, *, lines: float) -> list[str]:
    """Return the doubts about the band itself: noise, a single event, impulses that are not periodic."""
    doubts = []
    single_event = 0.5  # ratio of steady to plain kurtosis below which a single event is the cause
    if best.steady_kurtosis < _SIGNIFICANT * best.noise_std:
        doubts.append(
            f"Steady noise could be all there is: the steady kurtosis of {best.steady_kurtosis:.2g} is less than "
            f"{_SIGNIFICANT:g} times the scatter of noise, {best.noise_std:.2g}."
        )
    elif best.steady_kurtosis < single_event * best.kurtosis:
        doubts.append(
            f"A single event makes most of the kurtosis: {best.kurtosis:.3g} with, {best.steady_kurtosis:.3g} without "
            "the loudest two sixteenths of the record; cut it out before you demodulate."
        )
    # 0.02 at most come from the slope of the envelope's spectrum within a section (measured: 0.01)
    if best.envelope_negentropy < NOISE_NEGENTROPY + 0.02 + _SIGNIFICANT * NEGENTROPY_SCATTER / np.sqrt(lines):
        doubts.append(
            f"Nothing repeats regularly: the spectrum of the squared envelope is as level as that of noise "
            f"(negentropy {best.envelope_negentropy:.2f}, noise {NOISE_NEGENTROPY:.2f})."
        )
    return doubts


def _about_others(gram: Kurtogram, allowed: NDArray[np.bool_], best: Candidate, by_negentropy: Candidate) -> list[str]:
    """Return the doubts from other bands: more regular impulses elsewhere, and tones that hide impulses."""
    doubts = []
    apart = by_negentropy.high_hz <= best.low_hz or by_negentropy.low_hz >= best.high_hz
    regular, here = (c.envelope_negentropy - NOISE_NEGENTROPY for c in (by_negentropy, best))
    clearly_more = 1.5
    if apart and regular > clearly_more * here:
        doubts.append(
            f"Elsewhere the envelope repeats more regularly: in {by_negentropy} its negentropy is "
            f"{by_negentropy.envelope_negentropy:.2f}, here {best.envelope_negentropy:.2f}; a second fault "
            "would do that, or tones that beat."
        )
    # -0.5 is the kurtosis -s^2 for s = 0.7 of the band's power in one tone
    tonal = np.flatnonzero(allowed & (gram.kurtosis < np.minimum(-0.5, -_SIGNIFICANT * gram.noise_std)))
    if tonal.size:
        strongest = _candidate(gram, tonal[np.argmax(gram.level[tonal] + gram.power_share[tonal])])
        doubts.append(
            f"A steady tone fills {strongest} ({strongest.power_share:.0%} of the power, kurtosis "
            f"{strongest.kurtosis:.2f}) and hides impulses there; take tones out first if they matter."
        )
    return doubts
