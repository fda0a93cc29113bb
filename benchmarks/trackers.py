"""Time against error of every way to track orders: python benchmarks/trackers.py [FOLDER].

Writes trackers.md and trackers.svg into FOLDER (default docs/benchmarks). Every estimator runs on the standard jobs
(jobs.py) at the bandwidth that suits it best there, beside the usual ways on other packages (peers.py; statsmodels
comes with the extra `bench`). The package `tracking` has the parts.
"""

import os
import sys

if __name__ == "__main__":  # the libraries read these once, when they are imported
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
    )

from functools import partial
from pathlib import Path
from typing import get_args

from jobs import JobName
from tracking.clock import Effort
from tracking.measuring import measure, only
from tracking.picture import draw
from tracking.scaling import scaling
from tracking.settings import our_settings, peer_settings
from tracking.speedups import speedups
from tracking.tables import job_table, table
from tracking.targets import targets

from hums.plots import save_figure

NOTE = """\
Made by `python benchmarks/trackers.py`, one thread. Time as a multiple of `numpy.fft.rfft` of the same record, the two
timed in turn ({repeats} times, {slow} where a call takes more than a second) and their medians divided; compilation is
apart. Error: `sqrt(sum |Z' - Z|^2 / sum |Z|^2)` over all orders and the middle 90 % of the outputs. Bandwidth: the best
of a search on the job itself, one number for all orders, in Hz (J3: in orders). Memory: how far the process grew.
Records: J1 ten orders of a shaft that runs up from 10 to 40 Hz in 20 s; J2 orders 20 and 20.2 of it, crossed by a line
at 300 Hz; J3 the ten orders at 512 samples a turn; a million samples each, in noise of variance 1 (`jobs.py`)."""


def main(folder: Path, *, effort: Effort | None = None) -> int:
    """Measure, and write the tables and the picture."""
    effort = effort or Effort()
    settings = our_settings() + (peer_settings() if effort.with_peers else [])
    names: tuple[JobName, ...] = get_args(JobName)
    rows, refusals = measure(names, settings, effort)
    faster, fast_enough = speedups(rows, effort)
    widths = {row.setting.family: row.bandwidth for row in only(rows, "J1")}
    grown, straight = scaling((widths.get("smoother 2", 1.0), widths.get("filter 1", 1.0)), effort)
    verdicts = [
        (target.what, target.needed, target.measured, "yes" if target.passed else "**no**")
        for target in [*targets(rows), *fast_enough, *straight]
    ]
    note = NOTE.format(repeats=effort.repeats, slow=effort.slow_repeats)
    lines = ["# Trackers: time against error", "", note, "", "![Time against error](trackers.svg)", ""]
    lines += ["## Targets", "", *table(("what", "needed", "measured", "reached"), verdicts)]
    for name in names:
        lines += [f"## {name}", "", *job_table(only(rows, name))]
    lines += ["## Times as fast as other packages, a sample", "", *faster] if effort.with_peers else []
    lines += ["## Scaling", "", *grown]
    lines += ["## Left out", "", *(f"- {refusal}" for refusal in refusals), ""] if refusals else []
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "trackers.md").write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")
    save_figure(partial(draw, rows), folder / "trackers.svg", width=11, height=4.6)
    print("\n".join(lines))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/benchmarks")))
