"""Mean variance of a gear's records so far, which NA4 and NB4 are normalised with."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from signals._validation import positive, whole
from signals.angle.residual import MeshBand, ResidualSignal

Kind = Literal["residual", "mesh envelope"]


@dataclass(frozen=True, kw_only=True)
class VarianceHistory:
    """Mean variance of the records so far, the denominator of NA4 and NB4; `update` returns a new one.

    For NA4 and NB4 every record updates the mean, so that a lasting fault becomes part of it. NA4* and NB4* keep the
    variance of the healthy gear (Decker, Handschuh & Zakrajsek 1994, NASA TM-106553): freeze the history after run-in,
    or set `limit_std` so that it freezes itself.

    Attributes
    ----------
    records : int
        Number of records.
    mean_variance : float
        Mean of their variances, in the squared unit of the signal.
    squares : float
        Sum of squared deviations of the variances from their mean.
    kind : "residual", "mesh envelope" or None
        The signal they are of; None before the first.
    frozen : bool
        Whether further records leave the history as it is.
    limit_std : float or None
        It freezes itself at the first record after `learning` whose variance exceeds the mean by so many standard
        deviations of the variances before.
    learning : int
        Number of records before it may freeze itself.

    Examples
    --------
    >>> import numpy as np
    >>> from signals import ResidualSignal
    >>> from signals.indicators import VarianceHistory
    >>> tone = np.cos(2 * np.pi * np.arange(360) / 360)
    >>> history = VarianceHistory()
    >>> for amplitude in (1, 2):  # variances 0.5 and 2
    ...     history = history.update(ResidualSignal(values=amplitude * tone, removed_orders=()))
    >>> history.records, round(history.mean_variance, 6)
    (2, 1.25)
    """

    records: int = 0
    mean_variance: float = 0.0
    squares: float = 0.0
    kind: Kind | None = None
    frozen: bool = False
    limit_std: float | None = None
    learning: int = 10

    def __post_init__(self) -> None:
        whole(self.records, name="records", least=0)
        whole(self.learning, name="learning", least=2)
        if self.limit_std is not None:
            positive(self.limit_std, name="limit_std")

    @property
    def std(self) -> float:
        """Standard deviation of the variances; NaN below two records."""
        return math.sqrt(self.squares / (self.records - 1)) if self.records > 1 else math.nan

    def update(self, signal: ResidualSignal | MeshBand) -> "VarianceHistory":
        """Return the history with one more record, or itself where it is frozen.

        Raises
        ------
        ValueError
            A signal of another kind than those before.
        """
        variance = self.variance_of(signal)
        if self.frozen:
            return self
        if (
            self.limit_std is not None
            and self.records >= self.learning
            and variance > self.mean_variance + self.limit_std * self.std
        ):
            return self.freeze()
        records = self.records + 1
        apart = variance - self.mean_variance
        mean = self.mean_variance + apart / records
        return replace(
            self,
            records=records,
            mean_variance=mean,
            squares=self.squares + apart * (variance - mean),
            kind=kind_of(signal),
        )

    def freeze(self) -> "VarianceHistory":
        """Return a frozen copy, which further records leave as it is.

        Raises
        ------
        ValueError
            Before the first record.
        """
        if not self.records:
            raise ValueError("the history holds no record yet; update it with those of the sound gear, then freeze it.")
        return replace(self, frozen=True)

    def variance_of(self, signal: ResidualSignal | MeshBand) -> float:
        """Return the variance of `signal`, or refuse a signal of another kind than those before."""
        kind = kind_of(signal)
        if self.kind not in (None, kind):
            raise ValueError(
                f"this history holds the variance of the {self.kind}, not of the {kind}; keep one for each indicator."
            )
        return float(np.var(signal.values if isinstance(signal, ResidualSignal) else signal.amplitude))


def kind_of(signal: object) -> Kind:
    """Return the kind of a signal, or raise TypeError."""
    if isinstance(signal, ResidualSignal):
        return "residual"
    if isinstance(signal, MeshBand):
        return "mesh envelope"
    raise TypeError(
        f"a history takes a ResidualSignal (NA4) or a MeshBand (NB4), not a {type(signal).__name__}; see "
        "residual_signal and mesh_band."
    )
