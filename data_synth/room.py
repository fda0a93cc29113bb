"""Check before a simulation that the record fits into memory and onto the disk."""

import os
import shutil
from pathlib import Path

from data_synth.explanation import BYTES, count
from data_synth.scene import Scene, SceneError, load_scene
from data_synth.stage import PreparedScene

_SMALL_BYTES = 100_000_000  # any machine has this, so smaller records are not checked
_MEMINFO, _CGROUP = Path("/proc/meminfo"), Path("/sys/fs/cgroup")


def refuse_too_large(
    scene: Scene | str | Path, out: Path | None = None, *, by_source: bool = False, phases: bool = False
) -> None:
    """Raise SceneError for a scene whose record is larger than the free memory or disk space.

    Parameters
    ----------
    scene : Scene, path or catalogue name
    out : Path, optional
        Where the record is to be written; left out, it only has to fit into memory.
    by_source, phases : bool
        As for `simulate`.

    Raises
    ------
    SceneError
        With what it needs, what is free, and how long a record would fit.
    """
    declared = scene if isinstance(scene, Scene) else load_scene(scene)
    rows = len(declared.sensors)
    if phases:
        rows += len(declared.gearbox.links) + 2 * sum(len(bearing.names) for bearing in declared.gearbox.bearings)
    if not by_source and rows * declared.samples * BYTES <= _SMALL_BYTES:
        return
    counted = count(declared)
    rows += len(declared.sensors) * _sources(counted.stage) if by_source else 0
    samples = rows * declared.samples * BYTES
    places = [(samples + counted.working_bytes, free_memory_bytes(), "of memory")]
    if out is not None:
        folder = next(parent for parent in out.absolute().parents if parent.exists())
        places.append((samples, shutil.disk_usage(folder).free, f"on the disk of {folder}"))
    for need, free, where in places:
        if free is not None and need > free:
            raise SceneError(
                f"duration_s = {declared.duration_s:g}: the record has {declared.samples} samples of {rows} row(s) and "
                f"needs {need / 1e9:.3g} GB {where}, but {free / 1e9:.3g} GB are free; shorten it to about "
                f"{0.9 * declared.duration_s * free / need:.2g} s, lower rate_hz, or make several records."
            )


def _sources(stage: PreparedScene) -> int:
    sources = {(family.component, family.kind) for family in stage.families}
    sources |= {(train.component, train.kind) for _, train in stage.trains}
    return len(sources) + (stage.scene.fidelity != "kinematic")


def free_memory_bytes() -> int | None:
    """Return the memory available to this process in bytes; None where the system does not report it."""
    if _MEMINFO.exists():
        rows = dict(line.split(":", 1) for line in _MEMINFO.read_text(encoding="utf-8").splitlines())
        free = int(rows["MemAvailable"].split()[0]) * 1024
    elif "SC_PHYS_PAGES" in getattr(os, "sysconf_names", {}):
        free = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    else:
        return None
    limit, used = _CGROUP / "memory.max", _CGROUP / "memory.current"
    if limit.exists() and used.exists() and (text := limit.read_text(encoding="utf-8").strip()).isdigit():
        free = min(free, max(0, int(text) - int(used.read_text(encoding="utf-8"))))
    return free
