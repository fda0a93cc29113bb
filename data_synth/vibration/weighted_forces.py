"""Anti-aliasing of mesh forces that jump: triangular weights (linear B-splines), and their inverse filter.

A triangle over two sample intervals has the spectrum ``sinc^2``, which attenuates aliases. The passband is corrected by
the first terms of ``1 / sinc^2(x / 2) = (asin(s) / s)^2``, ``s = sin(x / 2)``: to 1e-6 up to a tenth of the rate, and
to 2e-4 up to a fifth.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from data_synth.dynamics.system import Array
from data_synth.integrators.problem import Output

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
class WeightedForces:
    """Sums channels of motion and channels of weighted mesh forces, block by block.

    Attributes
    ----------
    output : Output
        Output to integrate: the channels of motion, of weighted mesh forces, and of mesh forces at samples.
    trial_output : Output
        The same without the last, for the choice of the step size.
    """

    output: Output
    trial_output: Output
    _buffer: Array = field(default_factory=lambda: np.empty((0, 0)), init=False, repr=False)

    @classmethod
    def of(cls, output: Output) -> "WeightedForces | None":
        """Return the replacement of an output with mesh forces; None where it has none."""
        if output.mesh_force is None:
            return None
        maps = {
            name: np.vstack([value, np.zeros((2 * output.channels, value.shape[1]))])
            for name, value in output.maps.items()
            if name != "mesh_force"
        }
        zero = np.zeros_like(output.mesh_force)
        weighted_rows = np.vstack([zero, output.mesh_force, zero])
        trial_output = Output(rate_hz=output.rate_hz, **maps, weighted_mesh_force=weighted_rows)
        points = np.vstack([zero, zero, output.mesh_force])
        return cls(output=replace(trial_output, mesh_force=points), trial_output=trial_output)

    def push(self, values: Array) -> tuple[Array, Array]:
        """Return the channels (n, channels), `LAG` samples behind the next values (n, 3 channels).

        First free of aliases, for a filter, then as samples. Before the first values they are taken to be constant.
        """
        if not self._buffer.size:
            self._buffer = np.repeat(values[:1], LAG + _TERMS, axis=0)
        joined = np.concatenate([self._buffer, values])
        self._buffer = joined[-LAG - _TERMS :]
        count, channels = values.shape[0], values.shape[1] // 3
        # a triangle is centred one sample back, and the filter is symmetric
        now = joined[_TERMS : _TERMS + count]
        motion, points = now[:, :channels], now[:, 2 * channels :]
        taps = _correction()
        weighted = [np.convolve(joined[1:, channels + c], taps, mode="valid") for c in range(channels)]
        return np.asarray(motion + np.stack(weighted, axis=1)), np.asarray(motion + points)
