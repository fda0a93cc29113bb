"""Compiled kernels of the kurtogram: one node of the filter tree, and the moments of a band."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_sums

Array = NDArray[np.float64]
Single = NDArray[np.float32]


@compiled_sums
def _add_up(values: Single, taps: Single, factor: int, width: int, phases: Single, sums: Single) -> None:
    """Fill `width` columns of the sums R_r of `split_band` from its real or imaginary part; `phases` is workspace."""
    residues, last = 2 * factor, taps.size - 1
    groups = min(phases.shape[1], values.size // factor)
    for n in range(groups):  # strides known at compile time are vectorised
        if factor == 2:  # noqa: PLR2004
            phases[0, n] = values[2 * n]
            phases[1, n] = values[2 * n + 1]
        else:
            phases[0, n] = values[3 * n]
            phases[1, n] = values[3 * n + 1]
            phases[2, n] = values[3 * n + 2]
    for r in range(residues):
        total = sums[r][:width]
        at = (last - r) // factor - 22
        row = phases[(last - r) % factor][at : at + 22 + width]
        # twelve taps at once, so that each sum is stored only once and never loaded
        t0 = taps[r]
        t1 = -taps[r + residues]
        t2 = taps[r + 2 * residues]
        t3 = -taps[r + 3 * residues]
        t4 = taps[r + 4 * residues]
        t5 = -taps[r + 5 * residues]
        t6 = taps[r + 6 * residues]
        t7 = -taps[r + 7 * residues]
        t8 = taps[r + 8 * residues]
        t9 = -taps[r + 9 * residues]
        t10 = taps[r + 10 * residues]
        t11 = -taps[r + 11 * residues]
        for n in range(width):
            total[n] = (
                t0 * row[n + 22]
                + t1 * row[n + 20]
                + t2 * row[n + 18]
                + t3 * row[n + 16]
                + t4 * row[n + 14]
                + t5 * row[n + 12]
                + t6 * row[n + 10]
                + t7 * row[n + 8]
                + t8 * row[n + 6]
                + t9 * row[n + 4]
                + t10 * row[n + 2]
                + t11 * row[n]
            )


@compiled_sums
def split_band(re: Single, im: Single, taps: Single, factor: int, out_re: Single, out_im: Single) -> None:
    """Split an analytic band into `factor` equal bands, each at 1 / `factor` of the rate.

    Band b is filtered by ``h[m] exp(j pi m (2 b + 1) / (2 factor))``. The exponential changes sign when m increases by
    ``2 factor``, in every band alike, so the taps are first summed by their remainder r = m mod ``2 factor``,

        R_r[n] = sum_q (-1)^q h[2 factor q + r] c[factor n + last - 2 factor q - r],

    and each band is a combination of the R_r, so that all bands cost one filter. Odd bands are reversed in frequency,
    which a factor (-1)^n corrects. `out_re`, `out_im` (factor, outputs) hold only outputs whose taps all lie on the
    record. The number of taps must be ``24 factor``.
    """
    residues = 2 * factor
    count = out_re.shape[1]
    block = 512  # outputs at a time, so that the sums stay in the first cache
    length = block + (taps.size - 1) // factor
    phases = np.empty((factor, length), dtype=np.float32)
    sums_re = np.empty((residues, block), dtype=np.float32)
    sums_im = np.empty((residues, block), dtype=np.float32)
    for start in range(0, count, block):
        width = min(block, count - start)
        _add_up(re[factor * start :], taps, factor, width, phases, sums_re)
        _add_up(im[factor * start :], taps, factor, width, phases, sums_im)
        for band in range(factor):
            band_re = out_re[band][start : start + width]
            band_im = out_im[band][start : start + width]
            band_re[:] = 0.0
            band_im[:] = 0.0
            for r in range(0, residues, 2):
                angle = np.pi * r * (2 * band + 1) / residues
                next_angle = np.pi * (r + 1) * (2 * band + 1) / residues
                a = np.float32(np.cos(angle))
                b = np.float32(np.sin(angle))
                c = np.float32(np.cos(next_angle))
                d = np.float32(np.sin(next_angle))
                total_re = sums_re[r][:width]
                total_im = sums_im[r][:width]
                next_re = sums_re[r + 1][:width]
                next_im = sums_im[r + 1][:width]
                for n in range(width):
                    band_re[n] += a * total_re[n] - b * total_im[n] + c * next_re[n] - d * next_im[n]
                    band_im[n] += a * total_im[n] + b * total_re[n] + c * next_im[n] + d * next_re[n]
            if band % 2 == 1:
                for n in range((start + 1) % 2, width, 2):
                    band_re[n] = -band_re[n]
                    band_im[n] = -band_im[n]


@compiled_sums
def squared_envelope(re: Single, im: Single, squared: Single, seconds: Array, fourths: Array) -> None:
    """Fill `squared`, unless empty, with ``|c|^2``, and `seconds` and `fourths` with the sums of it and its square."""
    parts = seconds.size
    for p in range(parts):
        first, stop = p * re.size // parts, (p + 1) * re.size // parts
        own_re, own_im = re[first:stop], im[first:stop]  # loops over slices from 0 are vectorised
        second = 0.0
        fourth = 0.0
        for n in range(own_re.size):
            power = np.float64(own_re[n] * own_re[n] + own_im[n] * own_im[n])
            second += power
            fourth += power * power
        seconds[p] = second
        fourths[p] = fourth
    for n in range(squared.size):
        squared[n] = re[n] * re[n] + im[n] * im[n]
