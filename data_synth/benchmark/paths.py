"""A family of transfer paths from the bearings of a gearbox to an accelerometer, as modes of one structure.

The accelerance is a sum of modes with common poles, each bearing with its own participation. Far below the modes and
above its mounts a housing moves as a rigid body, so the gains of each bearing add up to 1 / mass. Frequencies, damping
and mass are in ranges that are ours and illustrative. The sensor belongs to the path: its mount and its calibration.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_synth.scene.imperfections import Gains, Mounts

__all__ = ["DrawnPath", "draw_path"]

FREQUENCY_HZ = (300.0, 9500.0)
DAMPING_RATIO = (0.01, 0.04)
MASS_KG = (30.0, 120.0)
MODES = (4, 6)
MOUNT_HZ = (7000.0, 31000.0)
"""From a magnet to a stud: Serridge and Licht (1987)."""
MOUNT_DAMPING = Mounts().damping_ratio
POSITIONS = 4
"""Bearings of the longest gearbox."""


@dataclass(frozen=True, kw_only=True)
class DrawnPath:
    """A structure between bearings and sensor.

    Attributes
    ----------
    name : str
    mass_kg : float
        Of the rigid housing.
    frequencies_hz, damping_ratios : tuple of float
        Of each mode.
    gains : (position, mode) array
        Static part of each mode at each bearing, from the input on, m s-2 N-1; each row adds up to 1 / mass_kg.
    mount_hz : float
        Resonance of the sensor on its mount.
    sensor_gain : float
        Error of its calibration, as a factor.
    """

    name: str
    mass_kg: float
    frequencies_hz: tuple[float, ...]
    damping_ratios: tuple[float, ...]
    gains: NDArray[np.float64] = field(repr=False)
    mount_hz: float
    sensor_gain: float

    def sensor(self) -> dict[str, Any]:
        """Return the keys of the sensor in a scene that belong to the path."""
        return {
            "gain": self.sensor_gain,
            "resonance": {"frequency_hz": self.mount_hz, "damping_ratio": MOUNT_DAMPING},
        }

    def transfers(self, bearings: Sequence[str], *, sensor: str) -> list[dict[str, Any]]:
        """Return the transfers of a scene, from each bearing to the sensor.

        Parameters
        ----------
        bearings : list of str
            From the input on, four at most.
        sensor : str

        Returns
        -------
        list of dict

        Examples
        --------
        >>> import numpy as np
        >>> from data_synth.benchmark.paths import draw_path
        >>> drawn = draw_path("p", rng=np.random.default_rng(1))
        >>> [item["source"] for item in drawn.transfers(["input bearing", "output bearing"], sensor="a")]
        ['input bearing', 'output bearing']
        """
        if len(bearings) > len(self.gains):
            raise ValueError(f"{len(bearings)} bearings, but a path has {len(self.gains)} places; name fewer.")
        modes = list(zip(self.frequencies_hz, self.damping_ratios, strict=True))
        return [
            {
                "source": bearing,
                "sensor": sensor,
                "units": "m s-2",
                "modes": [
                    {"frequency_hz": frequency, "damping_ratio": damping, "gain": float(gain)}
                    for (frequency, damping), gain in zip(modes, gains, strict=True)
                ],
            }
            for bearing, gains in zip(bearings, self.gains, strict=False)
        ]


def draw_path(name: str, *, rng: np.random.Generator) -> DrawnPath:
    """Return a structure with four to six modes, spread over its band in the logarithm of frequency.

    Parameters
    ----------
    name : str
    rng : numpy.random.Generator

    Returns
    -------
    DrawnPath

    Examples
    --------
    As a rigid body it has its mass:

    >>> import numpy as np
    >>> from data_synth.benchmark.paths import draw_path
    >>> drawn = draw_path("p", rng=np.random.default_rng(1))
    >>> bool(np.allclose(drawn.gains.sum(axis=1), 1 / drawn.mass_kg))
    True
    """
    count = int(rng.integers(MODES[0], MODES[1] + 1))
    low, high = np.log(FREQUENCY_HZ)
    frequencies = np.exp(low + (high - low) * (np.arange(count) + rng.uniform(0.1, 0.9, count)) / count)
    mass = math.exp(rng.uniform(*np.log(MASS_KG)))
    participation = rng.standard_normal((POSITIONS, count)) * rng.standard_normal(count)
    gains = participation / mass
    gains += (1 / mass - gains.sum(axis=1, keepdims=True)) / count
    return DrawnPath(
        name=name,
        mass_kg=mass,
        frequencies_hz=tuple(float(round(f, 1)) for f in frequencies),
        damping_ratios=tuple(float(round(z, 4)) for z in rng.uniform(*DAMPING_RATIO, count)),
        gains=gains,
        mount_hz=float(round(math.exp(rng.uniform(*np.log(MOUNT_HZ))))),
        sensor_gain=10 ** (float(rng.standard_normal()) * Gains().std_db / 20),
    )
