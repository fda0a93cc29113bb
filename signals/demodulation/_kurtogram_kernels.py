"""Compiled kernels of the kurtogram: one node of the filter tree, and the moments of a band."""

import numpy as np
from numpy.typing import NDArray

from signals._compile import compiled_sums

Array = NDArray[np.float64]
Single = NDArray[np.float32]

_BLOCK = 512  # outputs at a time, so that the sums stay in the first cache


@compiled_sums
def split_band(re: Single, im: Single, taps: Single, factor: int, out_re: Single, out_im: Single) -> None:
    """Split an analytic band into `factor` equal ones, each at 1 / `factor` of the rate.

    Band b is filtered by ``h[m] exp(j pi m (2 b + 1) / (2 factor))``. That factor changes sign when m grows by
    ``2 factor``, in every band alike, so the taps are first added up by their remainder r = m mod ``2 factor``,

        R_r[n] = sum_q (-1)^q h[2 factor q + r] c[factor n + last - 2 factor q - r],

    and each band is a sum of the R_r, so that all bands cost one filter. Odd bands are reversed in frequency, which a
    factor (-1)^n corrects. `out_re`, `out_im`: (factor, outputs), only those whose taps all lie on the record. The
    number of taps must be ``24 factor``.
    """
    residues = 2 * factor
    count = out_re.shape[1]
    last = taps.size - 1
    length = _BLOCK + last // factor
    phases_re = np.empty((factor, length), dtype=np.float32)
    phases_im = np.empty((factor, length), dtype=np.float32)
    sums_re = np.empty((residues, _BLOCK), dtype=np.float32)
    sums_im = np.empty((residues, _BLOCK), dtype=np.float32)
    for start in range(0, count, _BLOCK):
        width = min(_BLOCK, count - start)
        groups = min(length, re.size // factor - start)
        block_re = re[factor * start : factor * (start + groups)]
        block_im = im[factor * start : factor * (start + groups)]
        for n in range(groups):  # strides that are known when this is compiled use vector registers
            if factor == 2:  # noqa: PLR2004
                phases_re[0, n] = block_re[2 * n]
                phases_re[1, n] = block_re[2 * n + 1]
                phases_im[0, n] = block_im[2 * n]
                phases_im[1, n] = block_im[2 * n + 1]
            else:
                phases_re[0, n] = block_re[3 * n]
                phases_re[1, n] = block_re[3 * n + 1]
                phases_re[2, n] = block_re[3 * n + 2]
                phases_im[0, n] = block_im[3 * n]
                phases_im[1, n] = block_im[3 * n + 1]
                phases_im[2, n] = block_im[3 * n + 2]
        for r in range(residues):
            total_re = sums_re[r][:width]
            total_im = sums_im[r][:width]
            at = (last - r) // factor - 22
            row_re = phases_re[(last - r) % factor][at : at + 22 + width]
            row_im = phases_im[(last - r) % factor][at : at + 22 + width]
            # twelve taps at once, so that the sums are stored but once and never loaded
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
                total_re[n] = (
                    t0 * row_re[n + 22]
                    + t1 * row_re[n + 20]
                    + t2 * row_re[n + 18]
                    + t3 * row_re[n + 16]
                    + t4 * row_re[n + 14]
                    + t5 * row_re[n + 12]
                    + t6 * row_re[n + 10]
                    + t7 * row_re[n + 8]
                    + t8 * row_re[n + 6]
                    + t9 * row_re[n + 4]
                    + t10 * row_re[n + 2]
                    + t11 * row_re[n]
                )
                total_im[n] = (
                    t0 * row_im[n + 22]
                    + t1 * row_im[n + 20]
                    + t2 * row_im[n + 18]
                    + t3 * row_im[n + 16]
                    + t4 * row_im[n + 14]
                    + t5 * row_im[n + 12]
                    + t6 * row_im[n + 10]
                    + t7 * row_im[n + 8]
                    + t8 * row_im[n + 6]
                    + t9 * row_im[n + 4]
                    + t10 * row_im[n + 2]
                    + t11 * row_im[n]
                )
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
    """Fill `squared`, unless empty, with ``|c|^2``; `seconds`, `fourths` with sums of it and its square over parts."""
    parts, kept = seconds.size, squared.size > 0
    for p in range(parts):
        first = p * re.size // parts
        stop = (p + 1) * re.size // parts
        second = 0.0
        fourth = 0.0
        for n in range(first, stop):
            power = re[n] * re[n] + im[n] * im[n]
            if kept:
                squared[n] = power
            exact = np.float64(power)
            second += exact
            fourth += exact * exact
        seconds[p] = second
        fourths[p] = fourth
