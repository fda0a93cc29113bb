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
    number of taps must be a multiple of ``8 factor``.
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
        for p in range(factor):
            row_re = phases_re[p]
            row_im = phases_im[p]
            first = factor * start + p
            for n in range(min(length, (re.size - first + factor - 1) // factor)):
                row_re[n] = re[first + factor * n]
                row_im[n] = im[first + factor * n]
        for r in range(residues):
            total_re = sums_re[r][:width]
            total_im = sums_im[r][:width]
            total_re[:] = 0.0
            total_im[:] = 0.0
            row_re = phases_re[(last - r) % factor]
            row_im = phases_im[(last - r) % factor]
            # four taps at a time, so that the sums are loaded and stored a quarter as often
            for m in range(r, taps.size, 4 * residues):
                at = (last - m) // factor
                a = taps[m]
                b = -taps[m + residues]
                c = taps[m + 2 * residues]
                d = -taps[m + 3 * residues]
                a_re = row_re[at : at + width]
                a_im = row_im[at : at + width]
                b_re = row_re[at - 2 : at - 2 + width]
                b_im = row_im[at - 2 : at - 2 + width]
                c_re = row_re[at - 4 : at - 4 + width]
                c_im = row_im[at - 4 : at - 4 + width]
                d_re = row_re[at - 6 : at - 6 + width]
                d_im = row_im[at - 6 : at - 6 + width]
                for n in range(width):
                    total_re[n] += a * a_re[n] + b * b_re[n] + c * c_re[n] + d * d_re[n]
                    total_im[n] += a * a_im[n] + b * b_im[n] + c * c_im[n] + d * d_im[n]
        for band in range(factor):
            band_re = out_re[band][start : start + width]
            band_im = out_im[band][start : start + width]
            band_re[:] = 0.0
            band_im[:] = 0.0
            for r in range(residues):
                angle = np.pi * r * (2 * band + 1) / residues
                cosine = np.float32(np.cos(angle))
                sine = np.float32(np.sin(angle))
                total_re = sums_re[r][:width]
                total_im = sums_im[r][:width]
                for n in range(width):
                    band_re[n] += cosine * total_re[n] - sine * total_im[n]
                    band_im[n] += cosine * total_im[n] + sine * total_re[n]
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
