"""What was asked of the trackers, beside what was measured."""

from collections.abc import Mapping, Sequence

from page_files import table

from tracking.measuring import Row, only
from tracking.settings import DECIMATED

SMOOTHER = {"estimator": "smoother", "poles": 2, "outputs": f"every {DECIMATED}"}
FILTER = {"estimator": "filter", "poles": 1, "outputs": "all"}
ASKED = (  # job, settings, largest error, most time in rffts
    ("J1", SMOOTHER, 0.0155, 3.5),
    ("J2", SMOOTHER, 0.0150, 2.9),
    ("J3", SMOOTHER, 0.0176, 2.1),
    ("J1", FILTER | {"method": "exact"}, 0.0489, 35),
    ("J1", FILTER | {"method": "fast"}, 0.0489, 8),
    ("J3", FILTER | {"method": "fast"}, 0.0529, 8),
)
EXPONENT = 2.1  # of the time of coupled orders in their number


def targets(rows: Sequence[Row], exponents: Mapping[str, float]) -> list[str]:
    """Return the table of what was asked: of the rows of a job that are as accurate, the quickest counts."""
    lines = []
    for job, settings, error, most in ASKED:
        if mine := only(rows, job, **settings):
            best = min(mine, key=lambda row: (row.error > error, row.time))
            held = best.error <= error and best.time <= most
            words = ", ".join(str(value) for value in ({"method": best.setting.method} | settings).values())
            needed, found = (f"error {e:.4f}, time {t:.3g}" for e, t in ((error, most), (best.error, best.time)))
            lines.append((f"{job}: {words}", needed, found, "yes" if held else "**no**"))
    for what, exponent in exponents.items():
        if "coupled" in what:
            held = exponent <= EXPONENT
            lines.append((what, f"exponent {EXPONENT:g}", f"{exponent:.2f}", "yes" if held else "**no**"))
    return table(("case", "target", "measured", "reached"), lines)
