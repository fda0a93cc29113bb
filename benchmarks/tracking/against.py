"""Two checkouts of this project side by side: processes of each, in turn, run the same calls on the same records.

As a program (`against.py compile`, `against.py FILE SAMPLES`) it prints the processor time of each call as JSON, and
puts the amplitudes of the exact smoother into FILE.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from tracking.targets import Target

ROOT = Path(__file__).resolve().parents[2]
ROUNDS = 3
COUPLED, LARGEST_RMS, LARGEST_RATIO, COMPILE_S = 4.0, 0.003, 1.5, 12.0


def exact_cases(samples: int) -> dict[str, dict[str, Any]]:
    """Return records and settings on which the exact smoother is compared, amplitudes known to differ in size."""
    rng = np.random.default_rng(0)
    t = np.arange(samples) / 50e3
    run_up, noise = 2 * np.pi * (10 * t + 0.75 * t**2), rng.standard_normal(samples)
    ten = (1.0, 2.0, 3.0, 4.6, 7.1, 12.3, 20.0, 27.0, 36.0, 54.0)
    x = noise + sum(0.7 * np.cos(order * run_up + order) for order in ten)
    clipped = np.where(np.mod(run_up, 2 * np.pi) < 0.3 * np.pi, np.nan, x)
    common = {"phase_rad": run_up, "rate_hz": 50e3, "output_every": 200}
    few = slice(0, samples // 5)
    angle = 2 * np.pi * np.arange(samples // 5) / 512
    cases = {
        f"ten orders, {poles} pole{'s' * (poles > 1)}": common
        | {"x": x, "orders": ten, "bandwidth_hz": 1.6, "poles": poles}
        for poles in (1, 2)
    }
    cases["a seventh missing in step with the shaft"] = common | {
        "x": clipped, "orders": ten, "bandwidth_hz": 1.6, "poles": 2
    }  # fmt: skip
    for size, apart, poles in ((300, 0.02, 1), (300, 0.02, 4), (300, 0.002, 4), (1, 0.002, 4)):
        lines = size * (np.cos(20 * angle) + 0.5 * np.cos((20 + apart) * angle + 1))
        cases[f"amplitude {size}, {apart} orders apart, poles: {poles}"] = {
            "x": noise[few] + lines, "phase_rad": angle, "orders": (20, 20 + apart), "bandwidth_orders": 0.05,
            "samples_per_rev": 512, "poles": poles, "output_every": 100,
        }  # fmt: skip
    for part in (167, 20):
        cases[f"two orders, 1 / bandwidth of {part} samples"] = {
            "x": x[few], "phase_rad": run_up[few], "orders": (7.1, 12.3), "bandwidth_hz": 50e3 / part,
            "rate_hz": 50e3, "poles": 2, "output_every": 10,
        }  # fmt: skip
    return cases


def against(folder: Path | None, *, samples: int) -> "tuple[list[tuple[str, ...]], list[Target]]":
    """Return lines of (what, RMS of the difference in std, CPU s of the other checkout, of ours, ratio), and verdicts.

    Parameters
    ----------
    folder : the other checkout; None to measure only what needs none.
    samples : of the longest record.
    """
    from tracking.targets import Target  # noqa: PLC0415  (not in a process that only runs calls)

    checkouts = [ROOT] if folder is None else [ROOT, folder]
    with TemporaryDirectory() as room:
        kernels = [_run(root, Path(room) / f"cold{k}", "compile", samples) for k, root in enumerate(checkouts)]
        files = [Path(room) / f"{k}.npz" for k in range(len(checkouts))]
        took: list[list[dict[str, float]]] = [[] for _ in checkouts]
        for _ in range(ROUNDS if folder else 0):
            for k, root in enumerate(checkouts):
                took[k].append(_run(root, Path(room) / f"warm{k}", str(files[k]), samples))
        found = [np.load(file) for file in files] if folder else []
    compiling = sum(kernels[0].values())
    lines = [
        (f"compile: {name}", "", f"{kernels[1][name]:.3g}" if folder else "", f"{mine:.3g}", "")
        for name, mine in kernels[0].items()
    ]
    what, needed = "all tracker paths compiled with an empty cache", f"{COMPILE_S:g} s of CPU"
    verdicts = [Target(what=what, needed=needed, measured=f"{compiling:.3g} s", passed=compiling <= COMPILE_S)]
    if folder is None:
        return lines, verdicts
    least = [{name: min(times[name] for times in each) for name in each[0]} for each in took]
    for name, mine in least[0].items():
        ratio, rms = mine / least[1][name], None
        if f"{name} amplitude" in found[0]:
            ours, theirs = (arrays[f"{name} amplitude"] for arrays in found)
            rms = float(np.sqrt(np.mean(np.abs((ours - theirs) / found[1][f"{name} std"]) ** 2)))
        most = COUPLED if rms is None else LARGEST_RATIO
        passed = ratio <= most and (rms is None or rms <= LARGEST_RMS)
        apart = "" if rms is None else f"{rms:.1e}"
        lines.append((name, apart, f"{least[1][name]:.3g}", f"{mine:.3g}", f"{ratio:.2f}"))
        needed = f"{most:g} times the time before" + ("" if rms is None else f", RMS {LARGEST_RMS:g} std from it")
        measured = f"{ratio:.2f} times" + ("" if rms is None else f", RMS {apart} std")
        what = name if rms is None else f"exact smoother, {name}"
        verdicts.append(Target(what=what, needed=needed, measured=measured, passed=passed))
    return lines, verdicts


def _run(root: Path, kernels: Path, what: str, samples: int) -> dict[str, float]:
    """Run this file as a program on the packages of a checkout; its kernels are kept in a folder of their own."""
    threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    environment = os.environ | dict.fromkeys(threads, "1")
    environment |= {"PYTHONPATH": str(root), "NUMBA_CACHE_DIR": str(kernels)}
    words = [sys.executable, __file__, what, str(samples)]
    printed = subprocess.run(words, env=environment, cwd=root, check=True, capture_output=True, text=True)  # noqa: S603
    return dict(json.loads(printed.stdout))


def _cpu(call: Callable[[], Any]) -> tuple[float, Any]:
    start = time.process_time()
    answer = call()
    return time.process_time() - start, answer


def _compile() -> dict[str, float]:
    """Return the processor time of the first call of each estimator less that of the second."""
    from signals.harmonics import track_orders  # noqa: PLC0415  (of the checkout that is measured)

    phase = 0.3 * np.arange(4000)
    x = np.random.default_rng(0).standard_normal(phase.size)
    given: dict[str, Any] = {"phase_rad": phase, "orders": [0.1, 0.3], "bandwidth_hz": 2e-3, "rate_hz": 1.0}
    took = {}
    for estimator, method, poles in (
        ("smoother", "fast", 2), ("smoother", "exact", 2), ("filter", "exact", 1), ("filter", "fast", 1),
    ):  # fmt: skip

        def call(estimator: Any = estimator, method: Any = method, poles: int = poles) -> None:  # noqa: ANN401
            track_orders(x, estimator=estimator, method=method, poles=poles, **given)

        took[f"{estimator}, {method}, poles: {poles}"] = _cpu(call)[0] - _cpu(call)[0]
    return took


def calls(file: Path, samples: int) -> dict[str, float]:
    """Return the processor time of each call, after one that compiles."""
    from signals.harmonics import track_orders  # noqa: PLC0415

    took, kept = {}, {}
    for name, settings in exact_cases(samples).items():

        def call(settings: dict[str, Any] = settings) -> Any:  # noqa: ANN401
            return track_orders(estimator="smoother", method="exact", noise_variance=1.0, **settings)

        found = call()
        kept[f"{name} amplitude"], kept[f"{name} std"] = found.complex_amplitude, found.std
        took[name] = min(_cpu(call)[0] for _ in range(2))
    many, angle = 20 + 0.05 * np.arange(80), 2 * np.pi / 512 * np.arange(samples)
    coupled: dict[str, Any] = {
        "phase_rad": angle, "orders": many, "bandwidth_orders": 0.05, "samples_per_rev": 512, "poles": 2,
        "output_every": 200, "method": "fast",
    }  # fmt: skip
    x = np.random.default_rng(0).standard_normal(angle.size)
    track_orders(x[:20_000], **coupled | {"phase_rad": angle[:20_000]})
    took["80 coupled orders, 0.05 wide"] = _cpu(lambda: track_orders(x, **coupled))[0]
    np.savez(file, **kept)
    return took


if __name__ == "__main__":
    print(json.dumps(_compile() if sys.argv[1] == "compile" else calls(Path(sys.argv[1]), int(sys.argv[2]))))  # noqa: T201
