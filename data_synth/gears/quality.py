"""Flank tolerances of ISO 1328-1:2013, and random pitch deviations of given run-out and single pitch deviation."""

import math

import numpy as np

from data_synth.gears.mesh_stiffness import Array

_GRADES = 1, 11
_DIAMETER_MM, _MODULE_MM = (5.0, 15_000.0), (0.5, 70.0)
_UM = 1e-6


def single_pitch_tolerance_m(*, diameter_m: float, module_m: float, grade: int) -> float:
    """Return f_pT of ISO 1328-1:2013, eq. 5, in m, not rounded: ``(0.001 d + 0.4 m_n + 5) sqrt(2)^(A - 5)`` um.

    Parameters
    ----------
    diameter_m, module_m : float
        Reference diameter d and normal module m_n, in mm in the formula.
    grade : int
        Flank tolerance class A, 1 to 11.

    Raises
    ------
    ValueError
        If a value is outside the range of the standard: A 1 to 11, d 5 to 15,000 mm, m_n 0.5 to 70 mm.

    Examples
    --------
    >>> from data_synth.gears.quality import single_pitch_tolerance_m
    >>> round(1e6 * single_pitch_tolerance_m(diameter_m=0.1, module_m=4e-3, grade=5), 3)
    6.7
    """
    _check(diameter_m, module_m, grade)
    return _UM * (diameter_m + 400 * module_m + 5) * _step(grade)


def cumulative_pitch_tolerance_m(*, diameter_m: float, module_m: float, grade: int) -> float:
    """Return F_pT of ISO 1328-1:2013, eq. 6, in m: ``(0.002 d + 0.55 sqrt(d) + 0.7 m_n + 12) sqrt(2)^(A - 5)`` um.

    Parameters and errors are those of `single_pitch_tolerance_m`.

    Examples
    --------
    >>> from data_synth.gears.quality import cumulative_pitch_tolerance_m
    >>> round(1e6 * cumulative_pitch_tolerance_m(diameter_m=0.1, module_m=4e-3, grade=5), 3)
    20.5
    """
    _check(diameter_m, module_m, grade)
    return _UM * (2 * diameter_m + 0.55 * math.sqrt(1000 * diameter_m) + 700 * module_m + 12) * _step(grade)


def runout_tolerance_m(*, diameter_m: float, module_m: float, grade: int) -> float:
    """Return F_rT of ISO 1328-1:2013, ``0.9 F_pT``, in m; parameters and errors as for `single_pitch_tolerance_m`.

    Examples
    --------
    >>> from data_synth.gears.quality import runout_tolerance_m
    >>> round(1e6 * runout_tolerance_m(diameter_m=0.1, module_m=4e-3, grade=5), 3)
    18.45
    """
    return 0.9 * cumulative_pitch_tolerance_m(diameter_m=diameter_m, module_m=module_m, grade=grade)


def cumulative_pitch_m(*, teeth: int, runout_m: float, single_pitch_m: float, rng: np.random.Generator) -> Array:
    """Draw the cumulative pitch deviation of each tooth along the pitch circle, (teeth,) in m, zero on average.

    Its first harmonic, of half the run-out in amplitude, is that of an eccentric gear. Random scatter from tooth to
    tooth is added until the largest difference between neighbours equals the single pitch deviation; none is added
    where eccentricity alone exceeds it.

    Parameters
    ----------
    teeth : int
        Number of teeth.
    runout_m : float
        Radial run-out, peak to peak: twice the eccentricity.
    single_pitch_m : float
        Largest absolute single pitch deviation.
    rng : numpy.random.Generator

    Returns
    -------
    (teeth,) array
        m.

    Examples
    --------
    >>> import numpy as np
    >>> from data_synth.gears.quality import cumulative_pitch_m
    >>> rng = np.random.default_rng(1)
    >>> deviation = cumulative_pitch_m(teeth=30, runout_m=20e-6, single_pitch_m=7e-6, rng=rng)
    >>> round(1e6 * float(np.max(np.abs(deviation - np.roll(deviation, 1)))), 3)
    7.0
    """
    spectrum = np.fft.rfft(rng.standard_normal(teeth))
    start = rng.random()
    spectrum[:2] = 0.0
    scatter = np.fft.irfft(spectrum, teeth)
    eccentric = runout_m / 2 * np.sin(2 * np.pi * (np.arange(teeth) / teeth + start))

    own, more = (each - np.roll(each, 1) for each in (eccentric, scatter))
    size = 0.0
    if np.any(more) and np.max(np.abs(own)) < single_pitch_m:  # scatter at which the first pitch reaches it
        rising = more[more != 0]
        size = float(np.min((np.copysign(single_pitch_m, rising) - own[more != 0]) / rising))
    return np.asarray(eccentric + size * scatter)


def _step(grade: int) -> float:
    return math.sqrt(2) ** (grade - 5)


def _check(diameter_m: float, module_m: float, grade: int) -> None:
    for name, value, (low, high), unit in (
        ("grade", grade, _GRADES, ""),
        ("diameter", 1e3 * diameter_m, _DIAMETER_MM, " mm"),
        ("module", 1e3 * module_m, _MODULE_MM, " mm"),
    ):
        if not low <= value * (1 + 1e-12) or value > high * (1 + 1e-12):
            raise ValueError(f"{name} = {value:g}{unit}: ISO 1328-1:2013 covers {low:g} to {high:g}{unit} only.")
