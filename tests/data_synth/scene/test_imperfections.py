"""The defaults of healthy machines are pinned to a version, and each has its source or is said to be ours."""

import ast
import re
from pathlib import Path

import pytest

from data_synth.scene import imperfections, machine_history
from data_synth.scene.imperfections import DEFAULTS_VERSION, Imperfections
from data_synth.scene.machine_history import History

SOURCE = re.compile(r"\bours\b|\bISO \d|\b(?:IEC|EN) \d|\((18|19|20)\d\d\b")  # a standard, a year, or our own choice

# Fixed before any detector was run. A change of one number is another version of them all.
PINNED = {
    "gears": {"grade": 6, "deflection_um": 10.0},
    "planets": {"position_um": 10.0, "load_std": 0.07},
    "imbalance": {"grade": 6.3, "rotor_kg": 2.0},
    "bearings": {"waviness_um": 0.02, "stiffness_n_m": 1e8, "harmonics": 2},
    "electrical": {"mains_hz": 50.0, "amplitude_m_s2": 0.05, "harmonics": 3, "decay": 0.4},
    "electrical.inverter": {
        "pole_pairs": 2,
        "slip": 0.02,
        "lines": [(0, 1, 1), (0, 5, 0.2), (0, 6, 0.5), (0, 7, 0.14), (1, 6, 0.1),
                  (-1, 6, 0.1), (5, 6, 0.05), (-5, 6, 0.05)],
    },
    "electrical.tachometer": {"jitter_s": 2e-6, "extra_share": 1e-3},
    "neighbour": {
        "speed_hz": 24.3,
        "teeth": 31,
        "shaft_m_s2": 0.05,
        "mesh_m_s2": 0.1,
        "harmonics": 3,
        "decay": 0.5,
        "sideband": 0.2,
        "impact_m_s2": 0.5,
        "impacts_per_rev": 3.58,
        "frequency_hz": 3100.0,
        "damping_ratio": 0.04,
    },
    "knocks": {"per_second": 0.5, "mean_m_s2": 3.0},
    "noise": {"std_db": 1.5, "time_scale_s": 5.0},
    "mounts": {"frequency_hz": 28_000.0, "spread": 0.1, "damping_ratio": 0.03},
    "gains": {"std_db": 0.4},
    "temperature": {"celsius": 45.0, "drift_k_per_h": 5.0, "per_k": 1e-3},
}  # fmt: skip
PINNED_HISTORY = {
    "machines": 1,
    "short_records": 5.0,
    "long_records": 50.0,
    "season_records": 365.0,
    "season_share": 0.2,
    "gain_db": 0.2,
    "temperature_k": 5.0,
    "noise_db": 1.5,
    "load_share": 0.1,
}


def test_the_defaults_are_those_of_their_version():
    named = {key: {} for key in Imperfections.model_fields} | {"electrical": {"inverter": {}, "tachometer": {}}}
    found = Imperfections.model_validate(named).model_dump(exclude_none=True)
    for part in ("inverter", "tachometer"):
        found[f"electrical.{part}"] = found["electrical"].pop(part)
    found["electrical.inverter"]["lines"] = list(found["electrical.inverter"]["lines"])
    assert (DEFAULTS_VERSION, found) == ("1.1", PINNED)
    assert History().model_dump() == PINNED_HISTORY


def numbers_without_source(module):
    """Return the names of numeric defaults with a source neither beside or above them, nor in their class."""
    text = Path(module.__file__).read_text(encoding="utf-8")
    lines, missing = text.splitlines(), []
    for table in (node for node in ast.parse(text).body if isinstance(node, ast.ClassDef)):
        for field in (node for node in table.body if isinstance(node, ast.AnnAssign) and node.value is not None):
            if isinstance(field.value, ast.Constant) and field.value.value is None:
                continue
            above = lines[field.lineno - 2] if lines[field.lineno - 2].lstrip().startswith("#") else ""
            comment = lines[field.lineno - 1].partition("#")[2]
            if not any(SOURCE.search(words) for words in (above, comment, ast.get_docstring(table) or "")):
                missing.append(f"{table.name}.{ast.unparse(field.target)}")
    return missing


@pytest.mark.parametrize("module", [imperfections, machine_history])
def test_every_default_has_a_source(module):
    assert numbers_without_source(module) == []


def test_a_default_without_a_source_is_found(tmp_path):
    path = tmp_path / "made.py"
    path.write_text("class A:\n    x: int = 1  # many\n    # ISO 1\n    y: int = 2\n    z: int = 3  # ours\n")
    assert numbers_without_source(type("made", (), {"__file__": str(path)})) == ["A.x"]
