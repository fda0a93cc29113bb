"""The house rules that no single module can keep alone: who may import whom, and what an import may cost."""

import ast
import importlib
import itertools
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("signals", "hums", "data_synth")

# Inside a package later rooms may use earlier ones. A module that is not named here has no place in the order
# yet, but must not close a circle either.
ORDER = {
    "signals": [
        "pulses",
        "quadrature",
        "repairs",
        "smoothing",
        "phase",
        "tachometer",
        "resampling",
        "resampling_stream",
        "combs",
        "averaging",
        "residues",
        "planet_passes",
        "planet_averaging",
        "separation",
        "spectra",
        "order_map",
        "envelope",
        "lines",
        "kurtogram",
        "bands",
        "cyclostationary",
        "integration",
        "phase_demodulation",
        "speed",
        "harmonics",
        "indicators",
        "health",
    ],
    "signals.harmonics": [
        "bandwidth",
        "model",
        "tracks",
        "inputs",
        "innovations",
        "separability",
        "kalman_filter",
        "grid",
        "smoothing",
        "coupling",
        "blocks",
        "reference",
        "tracker",
        "waveform",
        "stream",
        "slip_chain",
        "slip",
        "likelihood",
        "vold_kalman",
    ],
    "hums": [
        "components",
        "gearbox",
        "adjacency",
        "kinematics",
        "loads",
        "statics",
        "equilibrium",
        "tooth_forces",
        "bearing_loads",
        "power_flow",
        "torques",
        "orders",
        "families",
        "catalogue",
        "entries",
        "record_parts",
        "record_check",
        "record",
        "calibration",
        "store",
        "readers",
        "search",
        "judging",
        "findings",
        "layout",
        "settings",
        "machine",
        "channels",
        "baseline",
        "gears",
        "planetary",
        "indicators",
        "notes",
        "tracking",
        "analysis",
        "scoring",
        "tables",
        "jobs",
        "shards",
        "fleet_table",
        "fleet",
        "plots",
        "report",
        "printing",
        "cli",
    ],
    "data_synth": [
        "driving",
        "chain",
        "growth",
        "mesh",
        "transmission_error",
        "gear_geometry",
        "tooth_stiffness",
        "teeth_in_mesh",
        "gear_faults",
        "defects",
        "excitation",
        "dynamics",
        "frf",
        "scene",
        "profile",
        "passages",
        "speeds",
        "run_up",
        "drive",
        "friction",
        "mechanics",
        "elements",
        "cones",
        "layout",
        "parts",
        "bodies",
        "mesh_parts",
        "assembly",
        "modal",
        "campbell",
        "floquet",
        "integrate",
        "load_zone",
        "slip",
        "rolling",
        "bearings",
        "bearing_dynamics",
        "combs",
        "shaft_faults",
        "faults",
        "bearing_faults",
        "pole_filter",
        "transfer",
        "path",
        "ways",
        "planet_pass",
        "passing",
        "damage",
        "pulses",
        "sensors",
        "stage",
        "bearing_run",
        "impacts",
        "housing",
        "meshing",
        "listening",
        "hearing",
        "loads",
        "hats",
        "motion",
        "hastened",
        "reduction",
        "mesh_response",
        "levels",
        "likeness",
        "fidelity",
        "truth",
        "explanation",
        "room",
        "simulation",
        "ranges",
        "plan",
        "schema",
        "dataset",
        "catalogue",
    ],
}
FIRST = {"hums.declared"}  # ranks before all, like modules whose names start with an underscore

# Rooms of `hums` that data_synth may enter.
OPEN_TO_SYNTH = {"gearbox", "adjacency", "kinematics", "torques", "orders", "record", "store", "jobs"}

# What only one module may import.
ONE_DOOR = {
    "h5py": ("hums.store", "hums._netcdf"),
    "h5netcdf": "hums.store",
    "matplotlib": "hums.plots",
    "dask": "hums.jobs",
    "filterpy": "signals.harmonics.reference",
    "numba": ("signals._compile", "signals._lanes", "signals._tiles", "data_synth._compile"),
}
HEAVY = ["scipy.signal", "scipy.stats", "filterpy", "numba", "dask", "h5py", "matplotlib", "jinja2", "typer"]


@dataclass(frozen=True)
class Import:
    """One imported module, as the module that imports it writes it."""

    by: str
    line: int
    module: str

    def __str__(self):
        return f"{self.by}, line {self.line}, imports {self.module}"


def _modules():
    """Every module of the project: dotted name -> file."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = _modules()


def _guards_types(node):
    return isinstance(node, ast.If) and ast.unparse(node.test).removeprefix("typing.") == "TYPE_CHECKING"


def _named(node, by):
    """Modules an import statement names; ``from package import room`` names the room."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    base = node.module or ""
    if node.level:
        is_package = MODULES[by].name == "__init__.py"
        above = by.split(".")[: len(by.split(".")) - node.level + is_package]
        base = ".".join([*above, base] if base else above)
    rooms = [f"{base}.{alias.name}" for alias in node.names]
    return list(dict.fromkeys(room if room in MODULES else base for room in rooms))


def imports_of(by):
    """All imports of a module: in functions and for type checkers too, and by `import_module` with a written name."""
    for node in ast.walk(ast.parse(MODULES[by].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from (Import(by, node.lineno, name) for name in _named(node, by))
        elif (
            isinstance(node, ast.Call)
            and ast.unparse(node.func).split(".")[-1] in ("import_module", "__import__")
            and node.args
            and isinstance(node.args[0], ast.Constant)
        ):
            yield Import(by, node.lineno, node.args[0].value)


@cache
def all_imports():
    return [found for module in MODULES for found in imports_of(module)]


def ours():
    """Return the imports of our own modules."""
    return [found for found in all_imports() if found.module.split(".")[0] in PACKAGES]


def broken(rule):
    """Imports that break a rule, as sentences."""
    return [str(found) for found in all_imports() if rule(found)]


class TestDoors:
    def test_imports_are_seen(self):
        # the rules below would hold of nothing at all
        seen = {(found.by, found.module) for found in all_imports()}
        assert ("signals._warp", "signals._resampling_kernel") in seen  # inside a function
        assert ("signals._compile", "numba") in seen
        assert ("signals", "signals.harmonics") in seen  # for type checkers

    def test_signals_imports_nothing_of_ours(self):
        assert not broken(
            lambda i: i.by.split(".")[0] == "signals" and i.module.split(".")[0] in {"hums", "data_synth", "tests"}
        )

    def test_hums_imports_hums_and_signals(self):
        assert not broken(
            lambda i: i.by.split(".")[0] == "hums" and i.by != "hums.cli" and i.module.split(".")[0] == "data_synth"
        )

    def test_data_synth_imports_the_open_rooms_of_hums_and_never_signals(self):
        def rule(found):
            if found.by.split(".")[0] != "data_synth":
                return False
            top, *room = found.module.split(".")
            return top == "signals" or (top == "hums" and (not room or room[0] not in OPEN_TO_SYNTH))

        assert not broken(rule)

    @pytest.mark.parametrize(("library", "door"), ONE_DOOR.items())
    def test_one_door(self, library, door):
        def rule(found):
            doors = (door,) if isinstance(door, str) else door
            return found.module.split(".")[0] == library and not f"{found.by}.".startswith(
                tuple(f"{d}." for d in doors)
            )

        assert not broken(rule)

    def test_nothing_of_the_tests(self):
        assert not broken(lambda i: i.module.split(".")[0] in {"pytest", "hypothesis", "tests", "conftest"})


class TestOrder:
    @staticmethod
    def room(module, package):
        """The room of `package` a module belongs to; None for the package itself and what lies outside it."""
        parts = module.split(".")
        depth = len(package.split("."))
        return parts[depth] if ".".join(parts[:depth]) == package and len(parts) > depth else None

    @pytest.mark.parametrize("package", ORDER)
    def test_later_rooms_use_earlier_ones(self, package):
        def rank(room):
            if room.startswith("_") or f"{package}.{room}" in FIRST:
                return -1
            return ORDER[package].index(room) if room in ORDER[package] else None

        wrong = []
        for found in ours():
            by, used = self.room(found.by, package), self.room(found.module, package)
            if None in (by, used) or by in (used, "__main__"):
                continue
            later, earlier = rank(by), rank(used)
            if None not in (later, earlier) and (earlier > later or earlier == later >= 0):
                wrong.append(str(found))
        assert not wrong

    def test_no_circles(self):
        # what a package's __init__ offers lazily is resolved when it is asked for, so it closes no circle
        uses = {module: set() for module in MODULES}
        for found in ours():
            if MODULES[found.by].name != "__init__.py" and found.module in MODULES:
                uses[found.by].add(found.module)
        done, path = set(), []

        def visit(module):
            if module in path:
                raise AssertionError(" -> ".join([*path[path.index(module) :], module]))
            if module not in done:
                path.append(module)
                for used in sorted(uses[module]):
                    visit(used)
                done.add(path.pop())

        for module in MODULES:
            visit(module)

    def test_helpers_use_no_room(self):
        for found in ours():
            helper = found.by.split(".")[-1].startswith("_") and not found.by.endswith("__main__")
            if helper or found.by in FIRST:
                assert found.module.split(".")[-1].startswith("_") or found.module in FIRST, found


class TestLazyExports:
    LAZY = tuple(name for name, path in MODULES.items() if path.name == "__init__.py" and "_HOME" in path.read_text())

    def test_the_packages_export_lazily(self):
        assert set(PACKAGES) <= set(self.LAZY)

    @pytest.mark.parametrize("package", LAZY)
    def test_home_agrees_with_what_type_checkers_see(self, package):
        tree = ast.parse(MODULES[package].read_text(encoding="utf-8"))
        typed = {}
        for block in filter(_guards_types, tree.body):
            for statement in block.body:
                if isinstance(statement, ast.ImportFrom):
                    for alias in statement.names:
                        assert alias.asname == alias.name, f"{alias.name}: write `as {alias.name}` to export it"
                        typed[alias.name] = statement.module
        module = importlib.import_module(package)
        assert typed == module._HOME
        assert module.__all__ == sorted(module._HOME)

    @pytest.mark.parametrize("package", LAZY)
    def test_every_name_resolves(self, package):
        module = importlib.import_module(package)
        for name, home in module._HOME.items():
            assert getattr(module, name) is getattr(importlib.import_module(home), name)
        assert set(module._HOME) <= set(dir(module))

    @pytest.mark.parametrize("package", LAZY)
    def test_no_other_name_does(self, package):
        with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'no_such_name'"):
            importlib.import_module(package).no_such_name  # noqa: B018


def run(code):
    """Run code in a fresh interpreter and return what it prints."""
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def loaded(*statements):
    """Modules in memory after some statements in a fresh interpreter."""
    return set(run("; ".join([*statements, "import sys", "print(*sys.modules)"])).split())


class TestImportCost:
    def test_data_synth_loads_no_signals(self):
        assert not {name for name in loaded("import data_synth") if name.split(".")[0] == "signals"}

    def test_no_module_of_data_synth_loads_signals(self):
        every = [f"import {name}" for name in MODULES if name.split(".")[0] == "data_synth"]
        assert not {name for name in loaded(*every) if name.split(".")[0] == "signals"}

    def test_importing_the_packages_loads_nothing_heavy(self):
        names = loaded("import hums, signals, data_synth")
        assert not names & set(HEAVY)

    def test_the_packages_load_nothing_but_themselves(self):
        # what they export is imported where it is first used, numpy and xarray too
        names = loaded("import numpy, xarray")
        assert loaded("import numpy, xarray", "import hums, signals, data_synth") - names == set(PACKAGES)

    def test_help_loads_the_command_line_and_no_numbers(self):
        shown = (
            "import contextlib, io, sys; from hums.cli import main\n"
            "sys.argv, page = ['hums', '--help'], io.StringIO()\n"
            "with contextlib.redirect_stdout(page): code = main()\n"
            "print(code, 'synth' in page.getvalue(), *sys.modules)"
        )
        code, shows, *names = run(shown).split()
        assert (code, shows) == ("0", "True")
        assert not set(names) & {"numpy", "scipy", "pandas", "xarray", *HEAVY} - {"typer"}
        # of ours the packages' doors, the command line and what it prints with
        assert len([name for name in names if name.split(".")[0] in PACKAGES]) <= 5


def test_the_order_names_each_room_once():
    for rooms in ORDER.values():
        assert not [a for a, b in itertools.combinations(rooms, 2) if a == b]
