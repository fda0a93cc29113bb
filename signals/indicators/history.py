"""What a gear's indicators remember: the variance of its records so far, learned, and frozen when told or in time."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from signals._checks import positive, whole
from signals.residues import MeshBand, ResidualSignal

Kind = Literal["residual", "mesh envelope"]


@dataclass(frozen=True, kw_only=True)
class VarianceHistory:
    """Mean variance of the records so far, the denominator of NA4 and NB4; `update` returns a new one.

    NA4 and NB4 let every record in; then a fault that stays makes itself the norm. NA4* and NB4* keep the variance of
    the sound gear (Decker, Handschuh & Zakrajsek 1994, NASA TM-106553): freeze the history when the gear has run in, or
    let it freeze itself with `limit_std`, at the first record after `learning` whose variance exceeds the mean of those
    before by that many of their standard deviations.

    Attributes
    ----------
    records : int
        How many it rests on.
    mean_variance : float
        In the squared unit of the signal.
    squares : float
        Sum of squared deviations of the variances from their mean.
    kind : "residual", "mesh envelope" or None
        Of which signal; None before the first.
    frozen : bool
    limit_std : float or None
    learning : int
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
        """Return the history with one more record, or as it is where it is frozen."""
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
        """Return the history that no further record changes.

        Raises
        ------
        ValueError
            Before the first record.
        """
        if not self.records:
            raise ValueError("the history holds no record yet; update it with those of the sound gear, then freeze it.")
        return replace(self, frozen=True)

    def variance_of(self, signal: ResidualSignal | MeshBand) -> float:
        """Return the variance that `signal` adds, or refuse a signal of another kind than those before."""
        kind = kind_of(signal)
        if self.kind not in (None, kind):
            raise ValueError(
                f"this history holds the variance of the {self.kind}, not of the {kind}; keep one for each indicator."
            )
        return float(np.var(signal.values if isinstance(signal, ResidualSignal) else signal.amplitude))


def kind_of(signal: object) -> Kind:
    """Tell which of the two signals it is, or raise TypeError."""
    if isinstance(signal, ResidualSignal):
        return "residual"
    if isinstance(signal, MeshBand):
        return "mesh envelope"
    raise TypeError(
        f"a history takes a ResidualSignal (NA4) or a MeshBand (NB4), not a {type(signal).__name__}; see "
        "residual_signal and mesh_band."
    )
