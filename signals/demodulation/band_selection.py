"""Choice of the demodulation band, with the reason and reservations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from signals._validation import Array, checked, positive
from signals.demodulation.kurtogram import NEGENTROPY_SCATTER, NOISE_NEGENTROPY, Kurtogram, fast_kurtogram

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_SIGNIFICANT = 5.0  # standard deviations of noise; any of 444 bands exceeds it in one noise record in several hundred


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
        """Lower and upper edge in Hz."""
        return self.low_hz, self.high_hz

    def __str__(self) -> str:
        return f"{self.low_hz:.6g}-{self.high_hz:.6g} Hz"


@dataclass(frozen=True, kw_only=True)
class Band(Candidate):
    """The band chosen by `choose_band`, with alternatives, reason and reservations.

    Attributes
    ----------
    low_hz, high_hz, level, kurtosis, steady_kurtosis, envelope_negentropy, noise_std, power_share : float
        As in `Kurtogram`, for this band.
    by_kurtosis, by_negentropy : Candidate
        The bands that kurtosis and negentropy alone would choose.
    why : str
        Reason for the choice, as a sentence.
    doubts : tuple of str
        Reservations, as sentences; empty if there are none.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import choose_band
    >>> band = choose_band(np.random.default_rng(1).standard_normal(20_000), rate_hz=10_000)
    >>> band.doubts[0].split(":")[0]
    'This may be stationary noise'
    """

    by_kurtosis: Candidate
    by_negentropy: Candidate
    why: str
    doubts: tuple[str, ...]


@checked
def choose_band(
    x: ArrayLike,
    *,
    rate_hz: float,
    modulation_hz: float | None = None,
) -> Band:
    """Choose the band of a record with the strongest repeated impulses.

    That is the band of the highest steady kurtosis, the kurtosis of the record without the two sixteenths of
    largest fourth moment. Unlike plain kurtosis it is not raised by a single spike, and a tone lowers it only in its
    own bands. The negentropy of the squared envelope spectrum measures whether the impulses are *periodic*; where the
    measures disagree, `Band.doubts` says so.

    Parameters
    ----------
    x : (n,) array
        Samples, any unit.
    rate_hz : float
        Sampling rate in Hz.
    modulation_hz : float, optional
        Smallest width of the band in Hz: the fastest modulation of interest, such as three times a defect frequency.
        Default: no limit.

    Returns
    -------
    Band

    Raises
    ------
    ValueError
        As `fast_kurtogram`, or if no band is as wide as `modulation_hz`.

    Examples
    --------
    A resonance at 3 kHz excited by 50 impulses per second, in noise:

    >>> import numpy as np
    >>> from signals import choose_band
    >>> t = np.arange(20_000) / 20_000
    >>> ring = np.exp(-1500 * (t % 0.02)) * np.sin(2 * np.pi * 3000 * (t % 0.02))
    >>> band = choose_band(ring + 0.05 * np.random.default_rng(1).standard_normal(t.size), rate_hz=20_000)
    >>> band.low_hz <= 3000 <= band.high_hz, band.doubts
    (True, ())
    """
    gram = fast_kurtogram(x, rate_hz=rate_hz, with_negentropy=True)
    least = 0.0 if modulation_hz is None else positive(modulation_hz, name="modulation_hz")
    # tolerance of 1e-9, since widths are quotients of the rate
    allowed = ((gram.high_hz - gram.low_hz) * (1 + 1e-9) >= least) & np.isfinite(gram.kurtosis)
    if not allowed.any():
        raise ValueError(
            f"modulation_hz={least:g} is wider than every band that holds power (at most {gram.high_hz[0]:g} Hz); "
            "lower it, or sample faster."
        )
    first, first_by_kurtosis, first_by_negentropy = (
        np.flatnonzero(allowed)[np.argsort(-_column(gram, measure)[allowed], kind="stable")[0]]  # NaN last
        for measure in ("steady_kurtosis", "kurtosis", "envelope_negentropy")
    )
    best = _candidate(gram, first)
    by_kurtosis, by_negentropy = _candidate(gram, first_by_kurtosis), _candidate(gram, first_by_negentropy)
    lines = float(gram.envelope_lines[first])
    return Band(
        **vars(best),
        by_kurtosis=by_kurtosis,
        by_negentropy=by_negentropy,
        why=_why(best, by_kurtosis, bands=int(allowed.sum())),
        doubts=(*_about_choice(best, lines=lines), *_about_others(gram, allowed, best, by_negentropy)),
    )


def _column(gram: Kurtogram, name: str) -> Array:
    return np.asarray(getattr(gram, name), dtype=np.float64)


def _candidate(gram: Kurtogram, index: np.intp) -> Candidate:
    return Candidate(**{name: float(_column(gram, name)[index]) for name in Candidate.__dataclass_fields__})


def _why(best: Candidate, by_kurtosis: Candidate, *, bands: int) -> str:
    """Return the reason for the choice as a sentence."""
    reason = (
        f"{best}: its steady kurtosis of {best.steady_kurtosis:.3g} is the highest of {bands} bands "
        f"(standard deviation in noise: {best.noise_std:.2g}; excludes the loudest two sixteenths of the record, with "
        f"which it is {best.kurtosis:.3g})"
    )
    if by_kurtosis.band_hz != best.band_hz:
        reason += (
            f". Plain kurtosis would choose {by_kurtosis} with {by_kurtosis.kurtosis:.3g}, of which "
            f"{by_kurtosis.steady_kurtosis:.3g} remains without those two parts"
        )
    return reason + "."


def _about_choice(best: Candidate, *, lines: float) -> list[str]:
    """Return the reservations about the band itself: noise, a single event, impulses that are not periodic."""
    doubts = []
    single_event = 0.5  # ratio of steady to plain kurtosis below which a single event is the cause
    if best.steady_kurtosis < _SIGNIFICANT * best.noise_std:
        doubts.append(
            f"This may be stationary noise: the steady kurtosis of {best.steady_kurtosis:.2g} is less than "
            f"{_SIGNIFICANT:g} standard deviations of noise, {best.noise_std:.2g} each."
        )
    elif best.steady_kurtosis < single_event * best.kurtosis:
        doubts.append(
            f"A single event accounts for most of the kurtosis: {best.kurtosis:.3g} with and "
            f"{best.steady_kurtosis:.3g} without the loudest two sixteenths of the record; remove it before "
            "demodulation."
        )
    # the slope of the envelope spectrum within a section adds at most 0.02 (measured: 0.01)
    if best.envelope_negentropy < NOISE_NEGENTROPY + 0.02 + _SIGNIFICANT * NEGENTROPY_SCATTER / np.sqrt(lines):
        doubts.append(
            "The impulses are not periodic: the squared envelope spectrum is as flat as that of noise (negentropy "
            f"{best.envelope_negentropy:.2f}, noise {NOISE_NEGENTROPY:.2f})."
        )
    return doubts


def _about_others(gram: Kurtogram, allowed: NDArray[np.bool_], best: Candidate, by_negentropy: Candidate) -> list[str]:
    """Return the reservations from other bands: more regular impulses elsewhere, and tones that mask impulses."""
    doubts = []
    apart = by_negentropy.high_hz <= best.low_hz or by_negentropy.low_hz >= best.high_hz
    regular, here = (c.envelope_negentropy - NOISE_NEGENTROPY for c in (by_negentropy, best))
    clearly_more = 1.5
    if apart and regular > clearly_more * here:
        doubts.append(
            f"Another band has a more periodic envelope: in {by_negentropy} the negentropy is "
            f"{by_negentropy.envelope_negentropy:.2f}, here {best.envelope_negentropy:.2f}; the cause may be a second "
            "fault or beating tones."
        )
    # kurtosis -s^2 = -0.5 with a fraction s = 0.7 of the band's power in one tone
    tonal = np.flatnonzero(allowed & (gram.kurtosis < np.minimum(-0.5, -_SIGNIFICANT * gram.noise_std)))
    if tonal.size:
        strongest = _candidate(gram, tonal[np.argmax(gram.level[tonal] + gram.power_share[tonal])])
        doubts.append(
            f"A steady tone fills {strongest} ({strongest.power_share:.0%} of the power, kurtosis "
            f"{strongest.kurtosis:.2f}) and masks impulses there; remove tones first if these matter."
        )
    return doubts
