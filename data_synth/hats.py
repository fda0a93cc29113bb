"""Mesh forces that jump, as samples that a filter can take: weighted with hats, and set right for that.

A hat over two samples has the spectrum ``sinc^2``, so of what folds back from beyond half the rate it leaves the square
of the part that point values would. What lies below is set right by the first terms of ``1 / sinc^2(x / 2) = (asin(s) /
s)^2``, ``s = sin(x / 2)``: to 1e-6 up to a tenth of the rate, and to 2e-4 up to a fifth.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from data_synth.integrate import Output
from data_synth.mechanics import Array

_TERMS = 6
LAG = _TERMS + 1  # samples


def _correction() -> Array:
    """Return the symmetric filter (2 terms + 1,) with the response ``sum_n 2^(2n+1) n!^2 / (2n+2)! s^2n``."""
    taps, power = np.zeros(2 * _TERMS + 1), np.ones(1)
    for n in range(_TERMS + 1):
        share = 2 ** (2 * n + 1) * math.factorial(n) ** 2 / math.factorial(2 * n + 2)
        taps[_TERMS - n : _TERMS + n + 1] += share * power
        power = np.convolve(power, [-0.25, 0.5, -0.25])
    return taps


@dataclass(kw_only=True)
class Hats:
    """Adds up, block after block, channels of motions and channels of mesh forces.

    Attributes
    ----------
    output : Output
        To be integrated: the channels of motions, then those of mesh forces under hats, then those at samples.
    judged : Output
        The same without the last, by which steps are judged.
    """

    output: Output
    judged: Output
    _kept: Array = field(default_factory=lambda: np.empty((0, 0)), init=False, repr=False)

    @classmethod
    def of(cls, output: Output) -> "Hats | None":
        """Return what takes the place of an output with mesh forces; None where it has none."""
        if output.mesh_force is None:
            return None
        maps = {
            name: np.vstack([value, np.zeros((2 * output.channels, value.shape[1]))])
            for name, value in output.maps.items()
            if name != "mesh_force"
        }
        silent = np.zeros_like(output.mesh_force)
        hats = np.vstack([silent, output.mesh_force, silent])
        judged = Output(rate_hz=output.rate_hz, **maps, weighted_mesh_force=hats)
        points = np.vstack([silent, silent, output.mesh_force])
        return cls(output=replace(judged, mesh_force=points), judged=judged)

    def push(self, values: Array) -> tuple[Array, Array]:
        """Return the channels (n, channels) that the next values (n, 3 channels) allow: they lag them by `LAG`.

        First as a filter takes them, then as they are at samples. Before the first values all was as it is there.
        """
        if not self._kept.size:
            self._kept = np.repeat(values[:1], LAG + _TERMS, axis=0)
        joined = np.concatenate([self._kept, values])
        self._kept = joined[-LAG - _TERMS :]
        count, channels = values.shape[0], values.shape[1] // 3
        # hats stand a sample back, and the filter takes as many samples before as after
        now = joined[_TERMS : _TERMS + count]
        moved, points = now[:, :channels], now[:, 2 * channels :]
        taps = _correction()
        felt = [np.convolve(joined[1:, channels + c], taps, mode="valid") for c in range(channels)]
        return np.asarray(moved + np.stack(felt, axis=1)), np.asarray(moved + points)
