"""What listens: accelerometers with white noise, and a tachometer whose pulse times are exact."""

import numpy as np

from data_synth.profile import Array, ShaftAngle


def add_noise(signal: Array, *, rms: float, rng: np.random.Generator) -> None:
    """Add white Gaussian noise of `rms`, in the signal's units, to a signal (n,) in place."""
    if rms > 0:
        signal += rms * rng.standard_normal(signal.size)


def pulse_times(angle: ShaftAngle, *, turns_per_rev: float, pulses_per_rev: int, stop_s: float) -> Array:
    """Return when a tachometer pulses, from revolution zero of `angle` to `stop_s`.

    Parameters
    ----------
    angle : ShaftAngle
        Of the reference shaft, revolution zero at the first pulse.
    turns_per_rev : float
        Turns of the tachometer's link for one of the reference.
    pulses_per_rev : int
        Pulses of one turn of that link.
    stop_s : float
        Time of the last sample in s.

    Returns
    -------
    (m,) array
        Times in s, exact.
    """
    per_rev = turns_per_rev * pulses_per_rev
    last = int(np.floor(float(angle.revolutions(stop_s)) * per_rev))
    return angle.times(np.arange(last + 1) / per_rev)
