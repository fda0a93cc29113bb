"""Time against error of every way to track orders: python benchmarks/trackers.py [FOLDER].

Writes trackers.md and trackers.svg into FOLDER (default docs/benchmarks). Every estimator runs on the standard jobs
(jobs.py) at the bandwidth that suits it best there, beside the usual ways on other packages (peers.py; statsmodels
comes with the extra `bench`). The package `tracking` has the parts; what changes from one tree to the next is on the
scoreboard.
"""

import os

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )

from functools import partial
from pathlib import Path

from page_files import folder_given, write_page
from tracking.channels import channels
from tracking.clock import ONCE_S, SLOW_S, Effort
from tracking.coverage import coverage
from tracking.measuring import Row, measure, only
from tracking.picture import draw
from tracking.scaling import SAMPLE_BY_SAMPLE, scaling
from tracking.settings import EVERYWHERE, our_settings, peer_settings
from tracking.slipping import slipping
from tracking.tables import job_table
from tracking.targets import targets

from hums.plots import save_figure

NOTE = """\
Made by `python benchmarks/trackers.py`, one thread. Time as a multiple of `numpy.fft.rfft` of the same record, both
timed alternately ({repeats} times, {slow_repeats} if a call takes more than {slow_s:g} s, once if more than {once_s:g}
s), ratio of medians, without compilation. `std` is computed on request, here never. Error: `sqrt(sum |Z' - Z|^2 / sum
|Z|^2)` over all orders and the middle 90 % of the outputs. Bandwidth: the best of a search on the job itself, one for
all orders, in Hz (J3: in orders). Memory: growth of the process. Records: J1, ten orders of a shaft that runs up from
10 to 40 Hz in 20 s; J2, orders 20 and 20.2 of it, crossed by a line at 300 Hz; J3, the ten orders at 512 samples per
revolution, a million samples each; J4, orders 10, 10.1 and 10.25 of a shaft at 10 Hz, 12,000 samples in 12 s; in noise
of variance 1 (`jobs.py`). With the noise variance given, the smoothers of the first three targets take 0.98, 0.92 and
0.79 times as long as in a135c42, the filters with steady-state gains 1.2 and 1.6 times, the exact one 2.3 times, which
filtered samples in pairs; without, the density of the noise on both sides of each order, which that did not estimate,
adds up to one rfft (`python benchmarks/tracking/against.py TREE 7`, TREE a working tree of a135c42)."""

CHANNELS = """\
Records of one channel and of {channels} with common phases; outputs every 200 samples, in rffts of one channel."""

COVERAGE = """\
Coverage of nominal 90 % intervals, and median `std` over the root mean square error. A record is 20 / bandwidth long; a
cell comprises 456 estimates of a line, 1 / bandwidth apart. Bold: outside 85 to 95 % or 0.8 to 1.25 with amplitudes of
the model, below 85 % or above 1.6 with constant ones."""

SLIPPING = """\
A line of amplitude 1 in noise of variance 1, whose order is 0.6 to 1.4 % below the nominal 9.46, a million samples at
512 per revolution; all estimators have a bandwidth of 0.02 orders. Error: RMS error of the complex amplitude relative
to the phase of the nominal order."""

SCALING = """\
In rffts of a million samples. With growing numbers of orders, the record has {grown:,} samples at 512 per revolution,
{exact:,} for the exact estimators; coupled orders are one bandwidth apart."""


def main(folder: Path, *, effort: Effort | None = None) -> None:
    """Measure, and write the tables and the picture."""
    effort = effort or Effort()
    settings = our_settings() + (peer_settings() if effort.with_peers else [])
    rows, refusals = measure(EVERYWHERE, settings, effort)
    write_page(folder / "trackers.md", _report(rows, refusals, effort))
    save_figure(partial(draw, rows), folder / "trackers.svg", width=11, height=9, force=True)


def _report(rows: list[Row], refusals: list[str], effort: Effort) -> list[str]:
    widths = {row.setting.family: row.bandwidth for row in only(rows, "J1")}
    grown, exponents = scaling((widths.get("smoother 2", 1.0), widths.get("filter 1", 1.0)), effort)
    about = SCALING.format(grown=effort.grown, exact=SAMPLE_BY_SAMPLE)
    note = NOTE.format(repeats=effort.repeats, slow_repeats=effort.slow_repeats, slow_s=SLOW_S, once_s=ONCE_S)
    lines = ["# Trackers: time against error", "", note, "", "![Time against error](trackers.svg)", ""]
    lines += ["## Targets", "", *targets(rows, exponents)]
    for name in EVERYWHERE:
        lines += [f"## {name}", "", *job_table(only(rows, name))]
    lines += ["## Several channels", "", CHANNELS.format(channels=effort.channels), "", *channels(effort)]
    lines += ["## Coverage of `std`", "", COVERAGE, "", *coverage(effort.poles, effort.kinds, effort.records)]
    lines += ["## A line that slips", "", SLIPPING, "", *slipping(effort)]
    lines += ["## Scaling", "", about, "", *grown]
    lines += ["## Omitted", "", *(f"- {refusal}" for refusal in refusals), ""] if refusals else []
    return lines


if __name__ == "__main__":
    main(folder_given())
