"""Speed against error of three ways to solve a train of gears: python benchmarks/kinematics.py [FOLDER].

Writes kinematics.md and kinematics.svg into FOLDER (default docs/benchmarks). A train of n links has n - 2 shafts
besides input and frame, each driven through a wheel and driving through a pinion of its own. Error: relative, of the
last shaft's speed, against the product of the tooth ratios in exact arithmetic. Times are ratios to the exact solver
at 10 links, medians of five, in one run.
"""

import statistics
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from page_files import folder_given, table, write_page

from hums.gearbox.kinematics import Kinematics, solve_kinematics
from hums.gearbox.model import Gearbox
from hums.plots import save_figure

LINKS = (10, 30, 100, 300, 1000)
DENSE_UP_TO = 1000
REPEATS = 5

NOTE = """\
Made by `python benchmarks/kinematics.py`. Compound trains of n links. Time as a multiple of the exact solver for 10
links, in one run; relative error of the speed of the last shaft, 1 if no digit is correct. The time of the exact solver
includes the graph, the carriers and the elimination; the other two start from the assembled matrix."""


def train(links: int) -> tuple[Gearbox, Fraction]:
    """Return a compound train with seeded teeth, and the exact speed of its last shaft for one turn of the first."""
    rng = np.random.default_rng(links)
    pairs = [(int(a), int(b)) for a, b in rng.integers(17, 90, (links - 2, 2))]
    axes = {f"a{i}": ["frame", f"s{i}"] for i in range(links - 1)}
    mesh = [{"teeth": {f"s{i}": a, f"s{i + 1}": b}} for i, (a, b) in enumerate(pairs)]
    ratio = Fraction(1)
    for a, b in pairs:
        ratio *= Fraction(-a, b)
    table = {"name": f"train of {links}", "frame": "frame", "reference": "s0", "axes": axes, "mesh": mesh}
    return Gearbox.from_mapping(table), ratio


def exact(kinematics: Kinematics) -> Fraction:
    """Solve in rational arithmetic, from the gearbox on."""
    solved = solve_kinematics(kinematics.gearbox)
    return solved.relative_speed(solved.links[-1], seen_from="frame")


def dense(kinematics: Kinematics) -> float:
    """Take the null space of the papers' matrix by singular value decomposition."""
    free = scipy.linalg.null_space(kinematics.constraint_matrix.real)
    return float(free[-1, 0] / free[1, 0]) if free.shape[1] == 1 else np.nan


def sparse(kinematics: Kinematics) -> float:
    """Impose the input's speed on the same matrix and factorise it as a sparse one."""
    matrix = kinematics.constraint_matrix.real
    turn = np.zeros((1, matrix.shape[1]))
    turn[0, 1] = 1
    system = scipy.sparse.csc_array(np.vstack([matrix, turn]))
    wanted = np.zeros(system.shape[0])
    wanted[-1] = 1
    return float(scipy.sparse.linalg.spsolve(system, wanted)[-1])


METHODS: dict[str, Callable[[Kinematics], float | Fraction]] = {"exact": exact, "dense SVD": dense, "sparse LU": sparse}


def measure() -> list[tuple[int, str, float, float]]:
    """Return (links, method, seconds, relative error)."""
    rows = []
    for links in LINKS:
        gearbox, ratio = train(links)
        kinematics = solve_kinematics(gearbox)
        _ = kinematics.constraint_matrix  # built once, outside the timing
        for name, solve in METHODS.items():
            times = []
            for _ in range(REPEATS if links < 1000 else 1):  # noqa: PLR2004
                start = time.perf_counter()
                found = solve(kinematics)
                times.append(time.perf_counter() - start)
            error = 1.0 if found != found else float(abs(Fraction(found) / ratio - 1))  # noqa: PLR0124
            rows.append((links, name, statistics.median(times), min(error, 1.0)))
    return rows


def main(folder: Path) -> None:
    """Measure, and write the table and the picture."""
    rows = measure()
    unit = next(seconds for links, name, seconds, _ in rows if (links, name) == (LINKS[0], "exact"))
    cells = ((links, name, f"{seconds / unit:.3g}", f"{error:.1e}") for links, name, seconds, error in rows)
    lines = ["# Kinematics: speed against error", "", NOTE, "", *table(("links", "method", "time", "error"), cells)]
    for name in METHODS:
        few, many = (next(s for links, m, s, _ in rows if (links, m) == (n, name)) for n in (100, 1000))
        lines += [f"From 100 to 1,000 links, {name} takes {many / few:.3g} times as long.", ""]
    write_page(folder / "kinematics.md", lines)

    def draw(ax: object) -> None:
        for name in METHODS:
            mine = [(links, seconds / unit) for links, m, seconds, _ in rows if m == name]
            ax.loglog(*zip(*mine, strict=True), "o-", label=name)  # type: ignore[attr-defined]
        ax.set(xlabel="links", ylabel="time, multiples of exact at 10 links")  # type: ignore[attr-defined]
        ax.legend(frameon=False)  # type: ignore[attr-defined]

    save_figure(draw, folder / "kinematics.svg", width=6, height=3.6)


if __name__ == "__main__":
    main(folder_given())
