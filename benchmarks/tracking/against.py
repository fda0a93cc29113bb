"""Times of the standard jobs against another working tree: python benchmarks/tracking/against.py TREE [REPEATS].

Each tree runs in a process of its own, and the two in turn. Prints for every case how long this tree takes as a
multiple of the other, both at their quickest, with the noise estimated and with its variance given.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SMOOTHER: dict[str, Any] = {"estimator": "smoother", "method": "fast", "rtol": 0.01, "poles": 2, "output_every": 200}
FILTER: dict[str, Any] = {"estimator": "filter", "poles": 1}
CASES: dict[str, tuple[str, float, dict[str, Any]]] = {  # job, bandwidth, settings
    "J1 smoother": ("J1 run-up", 1.19, SMOOTHER),
    "J2 smoother": ("J2 crossing", 1.02, SMOOTHER),
    "J3 smoother": ("J3 angle", 0.0109, SMOOTHER),
    "J1 filter, steady-state gains": ("J1 run-up", 4.02, FILTER | {"method": "fast"}),
    "J3 filter, steady-state gains": ("J3 angle", 0.033, FILTER | {"method": "fast"}),
    "J1 filter, exact": ("J1 run-up", 4.02, FILTER | {"method": "exact"}),
}


def serve() -> None:
    """Run the cases named on standard input, and print the seconds of each."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    from jobs import standard_job  # noqa: PLC0415  (only here)

    from signals.harmonics import track_orders  # noqa: PLC0415  (that of the tree that is measured)

    for line in sys.stdin:
        name, given = json.loads(line)
        job, bandwidth, settings = CASES[name]
        arguments = standard_job(job).tracking(bandwidth) | settings | given  # type: ignore[arg-type]
        track_orders(**arguments)
        start = time.perf_counter()
        track_orders(**arguments)
        print(time.perf_counter() - start, flush=True)  # noqa: T201


def main(other: Path, repeats: int) -> None:
    """Print the ratios."""
    trees = [
        subprocess.Popen(  # noqa: S603
            [sys.executable, __file__], cwd=tree, env=os.environ | {"PYTHONPATH": str(tree)}, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )
        for tree in (ROOT, other)
    ]  # fmt: skip

    def seconds(tree: subprocess.Popen[str], case: tuple[str, dict[str, float]]) -> float:
        assert tree.stdin is not None  # noqa: S101
        assert tree.stdout is not None  # noqa: S101
        tree.stdin.write(json.dumps(case) + "\n")
        tree.stdin.flush()
        return float(tree.stdout.readline())

    for name in CASES:
        ratios = []
        for given in ({}, {"noise_variance": 1.0}):
            mine, others = zip(*([seconds(tree, (name, given)) for tree in trees] for _ in range(repeats)), strict=True)
            ratios.append(min(mine) / min(others))
        print(f"{name}: {ratios[0]:.2f}, {ratios[1]:.2f} with the noise variance given", flush=True)  # noqa: T201
    for tree in trees:
        tree.communicate()


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]).resolve(), int(sys.argv[2]) if len(sys.argv) > 2 else 15)  # noqa: PLR2004
    else:
        serve()
