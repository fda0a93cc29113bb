"""The band to demodulate, chosen from a record, with the reasons and the doubts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from signals._checks import Array, choice, positive
from signals.kurtogram import (
    NEGENTROPY_SCATTER,
    NOISE_NEGENTROPY,
    Kurtogram,
    fast_kurtogram,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Measure = Literal["steady_kurtosis", "kurtosis", "envelope_negentropy"]

RUNNERS_UP = 3
_SURELY = 5.0  # standard deviations of noise: among 444 bands of noise alone one passes it in some hundred records
_SLACK = 0.02  # negentropy that the slope of the envelope's spectrum within a stretch adds at most (measured: 0.01)
_SINGLE = 0.5  # a kurtosis that falls below this part of itself without two sixteenths of the record hung on them
_MUCH_MORE = 1.5
_TONE = -0.5  # a kurtosis of -s^2: seven tenths of the band's power in one tone


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A band of a kurtogram with its figures: see `signals.kurtogram.Kurtogram`."""

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
        """Both edges, as `signals.envelope` takes them."""
        return self.low_hz, self.high_hz

    def __str__(self) -> str:
        return f"{self.low_hz:.6g}-{self.high_hz:.6g} Hz"


@dataclass(frozen=True, kw_only=True)
class Band(Candidate):
    """The band chosen, why, and what speaks against it.

    ``runners_up`` are the next best bands that overlap neither it nor each other; ``by_kurtosis`` and
    ``by_negentropy`` what those measures alone would have chosen.
    """

    measure: Measure
    runners_up: tuple[Candidate, ...]
    by_kurtosis: Candidate
    by_negentropy: Candidate
    why: str
    doubts: tuple[str, ...]


def choose_band(
    x: ArrayLike,
    *,
    rate_hz: float,
    levels: int | None = None,
    modulation_hz: float | None = None,
    measure: Measure = "steady_kurtosis",
) -> Band:
    """Choose the band of a record in which something repeats impulsively.

    By default the band of the highest steady kurtosis: that of the record without its loudest two sixteenths. A
    single spike, which the plain kurtosis falls for, leaves it at the level of noise; a tone lowers it in its own
    bands alone. Whether the impulses also repeat *regularly*, the negentropy of the squared envelope's spectrum
    tells; where the measures disagree, `Band.doubts` says so.

    Parameters
    ----------
    x : (n,) array
    rate_hz : float
    levels : int, optional
        As in `fast_kurtogram`.
    modulation_hz : float, optional
        The fastest modulation that must be seen, say three times a defect rate: narrower bands cannot carry it and are
        left out. Default: all bands compete, however narrow.
    measure : str
        What is maximised: ``steady_kurtosis``, ``kurtosis`` or ``envelope_negentropy``.

    Raises
    ------
    ValueError
        As `fast_kurtogram`; or where no band is as wide as `modulation_hz`.
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


def _candidate(gram: Kurtogram, place: int) -> Candidate:
    return Candidate(**{name: float(_column(gram, name)[place]) for name in Candidate.__dataclass_fields__})


def _apart(gram: Kurtogram, order: NDArray[np.intp]) -> tuple[Candidate, ...]:
    """Return the best bands after the first, none overlapping another or the first."""
    taken = [int(order[0])]
    low, high = gram.low_hz * (1 + 1e-9), gram.high_hz * (1 - 1e-9)  # edges that meet are rounded apart
    for place in order[1:]:
        if all(high[place] <= low[t] or low[place] >= high[t] for t in taken):
            taken.append(int(place))
        if len(taken) > RUNNERS_UP:
            break
    return tuple(_candidate(gram, place) for place in taken[1:])


def _why(best: Candidate, by_kurtosis: Candidate, *, measure: Measure, bands: int) -> str:
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
    doubts = []
    if best.steady_kurtosis < _SURELY * best.noise_std:
        doubts.append(
            f"Steady noise could be all there is: the steady kurtosis of {best.steady_kurtosis:.2g} is less than "
            f"{_SURELY:g} times the scatter of noise, {best.noise_std:.2g}."
        )
    elif best.steady_kurtosis < _SINGLE * best.kurtosis:
        doubts.append(
            f"A single event makes most of the kurtosis: {best.kurtosis:.3g} with, {best.steady_kurtosis:.3g} without "
            "the loudest two sixteenths of the record; cut it out before you demodulate."
        )
    if best.envelope_negentropy < NOISE_NEGENTROPY + _SLACK + _SURELY * NEGENTROPY_SCATTER / np.sqrt(lines):
        doubts.append(
            f"Nothing repeats regularly: the spectrum of the squared envelope is as level as that of noise "
            f"(negentropy {best.envelope_negentropy:.2f}, noise {NOISE_NEGENTROPY:.2f})."
        )
    return doubts


def _about_others(gram: Kurtogram, allowed: NDArray[np.bool_], best: Candidate, by_negentropy: Candidate) -> list[str]:
    doubts = []
    apart = by_negentropy.high_hz <= best.low_hz or by_negentropy.low_hz >= best.high_hz
    regular, here = (c.envelope_negentropy - NOISE_NEGENTROPY for c in (by_negentropy, best))
    if apart and regular > _MUCH_MORE * here:
        doubts.append(
            f"Elsewhere the envelope repeats more regularly: in {by_negentropy} its negentropy is "
            f"{by_negentropy.envelope_negentropy:.2f}, here {best.envelope_negentropy:.2f}; a second fault "
            "would do that, or tones that beat."
        )
    tonal = np.flatnonzero(allowed & (gram.kurtosis < np.minimum(_TONE, -_SURELY * gram.noise_std)))
    if tonal.size:
        strongest = _candidate(gram, tonal[np.argmax(gram.level[tonal] + gram.power_share[tonal])])
        doubts.append(
            f"A steady tone fills {strongest} ({strongest.power_share:.0%} of the power, kurtosis "
            f"{strongest.kurtosis:.2f}) and hides impulses there; take tones out first if they matter."
        )
    return doubts
