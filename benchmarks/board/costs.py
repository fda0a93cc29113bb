"""What it costs: analyses and records in rffts, memory, start, and the size of the code."""

import json
import tempfile
from functools import partial
from pathlib import Path

import code_size
import numpy as np
import startup

from board.estimates import TREE, in_rffts, rfft_s
from board.sections import Section
from board.table import Figure, Row, times
from data_synth import load_scene, simulate
from hums import AnalysisSettings, analyze, load_gearbox

Timed = partial(Row, timed=True)
SCENES = {"demo": "demo", "gears in motion": "gears-in-motion"}


class Tree(startup.Checkout):
    """The tree that is measured, with the kernels that are compiled in it."""

    @property
    def environment(self) -> dict[str, str]:
        """Variables of its processes."""
        return {name: value for name, value in super().environment.items() if name != "NUMBA_CACHE_DIR"}

    def least(self, *words: str, runs: int = 3) -> float:
        """Return the least processor time of some runs of Python, in s."""
        return min(self.run(*words)[0] for _ in range(runs))


def in_units() -> dict[str, float]:
    """Return the cost of making and of analysing records, in rffts of them."""
    gearbox, found = load_gearbox("two-stage"), {}
    for name, file in SCENES.items():
        scene = load_scene(file)
        record = simulate(scene, seed=1)
        x = record[scene.sensors[0].name].to_numpy().astype(np.float64)
        found[f"making {name}"] = in_rffts(lambda scene=scene: simulate(scene, seed=1), x)
        if name == "demo":
            for key, settings in (("tracked", AnalysisSettings()), ("untracked", AnalysisSettings(most_tracks=0))):
                analyze(record, gearbox, settings=settings)
                found[f"analysis, {key}"] = in_rffts(
                    lambda record=record, settings=settings: analyze(record, gearbox, settings=settings), x
                )
    return found


def in_processes(samples: int = 5_000_000) -> dict[str, float]:
    """Return memory and time of the analysis of a long record, and the time to start, in processes of their own."""
    with tempfile.TemporaryDirectory() as room:
        tree = Tree(root=TREE, room=Path(room))
        path = str(Path(room) / "long.h5")
        tree.run("-c", startup.LONG, path, str(samples))
        seconds, printed = tree.run("-c", startup.MEMORY, path)
        found = json.loads(printed)
        imports = tree.least("-c", "import hums; hums.analyze")
        return {
            "long record, MB": found["memory"],
            "long record, reads": found["reads"],
            "long record, rffts": (seconds - imports) / rfft_s(np.random.default_rng(1).standard_normal(samples)),
            "start: help": tree.least("-m", "hums", "--help") / tree.least("-c", "import typer"),
            "start: analysis": imports / tree.least("-c", "import xarray, scipy.signal"),
        }


COSTS = Section(
    name="costs",
    rows=(
        Timed(name="analysis, tracked", what="analysis of the demo's record, rffts", limit=times(2.0)),
        Timed(name="analysis, untracked", what="as above, without tracks", limit=times(2.0)),
        Timed(name="making demo", what="simulation of the demo's record, rffts", limit=times(2.0)),
        Timed(name="making gears in motion", what="simulation of `gears-in-motion`, rffts", limit=times(2.0)),
        Timed(name="long record, rffts", what="analysis of a long record in its own process, rffts", limit=times(2.0)),
        Row(name="long record, MB", what="peak memory of that process", limit=times(1.1)),
        Row(name="long record, reads", what="how often its samples are read", limit=times(1.2)),
        # of processes this short an unchanged tree has had ratios from 1.5 to 3.0
        Timed(name="start: help", what="CPU time of `hums --help` over `import typer`", limit=times(3.0)),
        Timed(name="start: analysis", what="CPU time of its imports over `xarray, scipy.signal`", limit=times(3.0)),
    ),
    tasks=lambda _: [in_units, in_processes],
    figures=lambda found: {name: Figure(value=value) for part in found for name, value in part.items()},
    alone=True,
)


# ---- size ------------------------------------------------------------------------------------------------------------


def sizes() -> dict[str, int]:
    """Return the counts of the tree that is measured."""
    found = {row: code_size.count(row, TREE) for row in code_size.WHOLE}
    return found | {"test functions": code_size.total(TREE, "tests").test_functions}


SIZE = Section(
    name="size",
    rows=(
        Row(name="size: all code lines", what="code lines of `signals`, `hums`, `data_synth`", limit=times(1.01)),
        Row(name="size: all modules", what="modules", limit=times(1.02)),
        Row(name="size: all constants", what="module constants", limit=times(1.02)),
        Row(name="size: tests", what="code lines of the tests", limit=times(1.05)),
        Row(name="size: test functions", what="test functions"),
        Row(name="size: benchmarks", what="code lines of the benchmarks", limit=times(1.15)),
    ),
    tasks=lambda _: [sizes],
    figures=lambda found: {f"size: {row}": Figure(value=value) for row, value in found[0].items()},
)
SECTIONS = (COSTS, SIZE)
