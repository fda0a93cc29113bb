"""The house rules that no single module can keep alone: who may import whom, and what an import may cost."""

import ast
import importlib
import itertools
import re
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import code_size
import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("signals", "hums", "data_synth")

# Who may import whom inside a package: what stands later may use what stands before it in its row, and what that may
# use; what stands between the same two signs, and what shares no row, keeps apart. Modules of a package itself whose
# names start with an underscore are open to all of it.
ORDER = {
    "signals": """
        shaft < resampling < angle, spectra < demodulation, indicators
        harmonics < slipping_order
        health
        monitoring
    """,
    "hums": """
        gearbox, records < readers, plots, drawing, jobs, analysis
        records < pages < drawing
        plots, analysis, pages < report
        jobs, analysis, pages < fleet
        jobs, readers < conversion
        records, analysis < scoring
        readers, plots, drawing, report, fleet, conversion, scoring < cli
    """,
    "data_synth": """
        gears < scene < operation < bearings < kinematic < transfer < sources
        gears < dynamics < integrators
        sources, integrators < vibration < fidelity < truth, cost < simulation < plan < dataset_folder, scene_schema
        scene < draws < plan < card < dataset_folder
    """,
}
LARGEST_FOLDER = 20  # modules, the __init__ not among them
LONGEST_CHAIN = 19  # modules, each importing the next

# From package to package: what each may enter of the others. The command line enters all, inside its commands.
OPEN = {
    "signals": (),
    "hums": ("signals",),
    "data_synth": (
        *("hums.gearbox", "hums.records", "hums.jobs", "signals._validation", "signals._compile", "signals._lazy"),
    ),
    "hums.cli": ("signals", "data_synth"),
}

# What only one module may import.
ONE_DOOR = {
    "h5py": ("hums.records.store", "hums.records._netcdf"),
    "matplotlib": ("hums.plots",),
    "dask": ("hums.jobs",),
    "pyarrow": ("data_synth.dataset_folder",),
    "filterpy": ("signals.harmonics.reference",),
    "numba": ("signals._compile",),
}

# Code lines of folders ("(root)": without the folders in it), then of everything: when the reduction began, the ceiling
# of today, and what is to be reached. Ceilings only fall: `python benchmarks/code_size.py --lower` brings them down.
BUDGETS = """
    signals (root)                                              560    486    400
    signals/angle                                              1111    828    900
    signals/demodulation                                        905    726    750
    signals/harmonics, signals/slipping_order                  4012   2657   2500
    signals/health, signals/indicators                          955    836    800
    signals/monitoring                                         1135    531    700
    signals/resampling                                          799    743    600
    signals/shaft                                              3006   1916   2000
    signals/spectra                                             866    775    700
    hums (root)                                                 830    720    600
    hums/analysis                                              5359   5359   3000
    hums/cli                                                   1120   1039    700
    hums/fleet                                                 2161   1461   1300
    hums/gearbox                                               3541   3427   2600
    hums/plots, hums/drawing, hums/pages                       1667   1370   1200
    hums/readers                                               1267   1267   1000
    hums/records                                               1831   1831   1200
    hums/report                                                 977    933    800
    data_synth (root)                                          2400   1408   1300
    data_synth/dynamics, data_synth/integrators                4106   2581   2600
    data_synth/fidelity, data_synth/vibration                  4287   2119   2000
    data_synth/gears, data_synth/bearings                      1478   1210   1300
    data_synth/kinematic, data_synth/operation, data_synth/scene  2873   2485   2200
    data_synth/sources, data_synth/transfer                    1545   1219   1200
    all code lines                                            48791  39064  33500
    all modules                                                 345    275    240
    all constants                                              1492    912    750
    tests                                                     35938  26555  23000
    benchmarks                                                 7891   7891   6000
"""
SLACK, SLACK_LINES = 0.02, 10  # by which a ceiling may stand above the count, and at least so many

# What a row may have above its ceiling for a while: how much, why, and what ends it.
MENDS = "mends of faults that users meet", "when the package is reduced"
ANGLE = (
    "the declared angle and drawing are tested, for code removed in hums/cli, hums/fleet, signals/slipping_order",
    "with one score for every part",
)
READ = "reading and comparing all that files state", "when readers and records are reduced"
FORMATS = (
    "import descriptions, LabVIEW and MDF files, for code removed in hums/cli and hums",
    "when readers are reduced",
)
OWNED = "files of the user's own are kept, and exits say what happened", "when hums/cli is reduced"
ALLOWANCES = {
    "data_synth/gears, data_synth/bearings": (
        10,
        "modified flanks and a second crack, for code removed in kinematic and operation",
        "when bearings are reduced",
    ),
    "data_synth/sources, data_synth/transfer": (
        8,
        "instants of the truth at equal angles, for code removed in integrators",
        "when sources are reduced",
    ),
    "hums/analysis": (332, *ANGLE),
    "signals/monitoring": (
        7,
        "explanations of an alarm are compared, for code removed in hums/fleet",
        "when the package is reduced",
    ),
    "signals/demodulation": (13, "the end of a filtered signal, for code removed in signals/monitoring", ANGLE[1]),
    "signals/harmonics, signals/slipping_order": (2, *MENDS),
    "signals (root)": (17, "compilation for data_synth too, names through one function", "when hums/cli is reduced"),
    "hums (root)": (25, *OWNED),
    "hums/cli": (107, *OWNED),
    "hums/plots, hums/drawing, hums/pages": (
        52,
        "maps, averages and control charts as figures, for code removed in hums/gearbox",
        "when the package is reduced",
    ),
    "hums/readers": (558, *FORMATS),
    "hums/records": (162, *READ),
    "hums/report": (32, *MENDS),
    "all code lines": (246, *OWNED),
    "all modules": (3, *FORMATS),
    "all constants": (13, *OWNED),
    "tests": (683, *FORMATS),
    "benchmarks": (851, "the scoreboard beside the scripts that it replaces", "when those are removed"),
}
HEAVY = ["scipy.signal", "scipy.stats", "filterpy", "numba", "dask", "h5py", "matplotlib", "pyarrow", "jinja2", "typer"]

# Tests that mirror no module, and why.
NO_MIRROR = {
    "test_architecture.py": "of all modules",
    "test_examples.py": "of all public names",
    "test_numbers.py": "of all public functions",
    "test_readme.py": "of the README",
    "hums/analysis/test_tachometers_together.py": "of several tachometers in one record",
    "data_synth/test_fault_effects.py": "of every fault in every fidelity",
}


@dataclass(frozen=True)
class Import:
    """One imported module, as the module that imports it writes it."""

    by: str
    line: int
    module: str
    inside: bool
    """In a function, or for type checkers alone."""

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


def _tree(module):
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


@cache
def _homes(module):
    """Where a package that exports lazily has its names from."""
    stub = MODULES[module].with_suffix(".pyi")
    tree = ast.parse(stub.read_text(encoding="utf-8")) if stub.exists() else ast.Module([], [])
    return {alias.asname: statement.module for statement in tree.body for alias in statement.names}


def _guards_types(node):
    return isinstance(node, ast.If) and ast.unparse(node.test).removeprefix("typing.") == "TYPE_CHECKING"


def _named(node, by):
    """Modules an import statement names; ``from package import module`` names the module, or the home of a name."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    base = node.module or ""
    if node.level:
        is_package = MODULES[by].name == "__init__.py"
        above = by.split(".")[: len(by.split(".")) - node.level + is_package]
        base = ".".join([*above, base] if base else above)
    homes = _homes(base) if base in MODULES else {}
    modules = [(f"{base}.{alias.name}", homes.get(alias.name, base)) for alias in node.names]
    return list(dict.fromkeys(full if full in MODULES else home for full, home in modules))


def _nodes(tree):
    """Every node below another, and whether it runs when the module is imported."""
    waiting = [(tree, False)]
    while waiting:
        node, inside = waiting.pop()
        inside = inside or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) or _guards_types(node)
        for child in ast.iter_child_nodes(node):
            yield child, inside
            waiting.append((child, inside))


def _last_name(function):
    """Last part of the name of what is called."""
    return getattr(function, "attr", getattr(function, "id", ""))


def imports_of(by):
    """All imports of a module: in functions and for type checkers too, and by `import_module` with a written name."""
    for node, inside in _nodes(_tree(by)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from (Import(by, node.lineno, name, inside) for name in _named(node, by))
        elif (
            isinstance(node, ast.Call)
            and _last_name(node.func) in ("import_module", "__import__")
            and node.args
            and isinstance(node.args[0], ast.Constant)
        ):
            yield Import(by, node.lineno, node.args[0].value, inside)


@cache
def all_imports():
    return [found for module in MODULES for found in imports_of(module)]


def ours():
    """Return the imports of our own modules."""
    return [found for found in all_imports() if found.module.split(".")[0] in PACKAGES]


def broken(rule):
    """Imports that break a rule, as sentences."""
    return [str(found) for found in all_imports() if rule(found)]


def within(module, packages):
    return f"{module}.".startswith(tuple(f"{package}." for package in packages))


class TestDoors:
    def test_imports_are_seen(self):
        # the rules below would hold of nothing at all
        seen = {(found.by, found.module) for found in all_imports()}
        assert ("signals.resampling._engine", "signals.resampling._engine_kernels") in seen  # inside a function
        assert ("signals._compile", "numba") in seen
        assert ("hums.analysis.tracks", "signals.harmonics.tracker") in seen  # by way of an __init__

    def test_packages_enter_what_is_open_to_them(self):
        def rule(found):
            package = "hums.cli" if within(found.by, ["hums.cli"]) else found.by.split(".")[0]
            top = found.module.split(".")[0]
            return top in PACKAGES and top != package.split(".")[0] and not within(found.module, OPEN[package])

        assert not broken(rule)

    def test_the_command_line_imports_inside_its_commands(self):
        assert not broken(
            lambda i: (
                within(i.by, ["hums.cli"])
                and i.module.split(".")[0] in PACKAGES
                and not (i.inside or within(i.module, ["hums.cli"]))
            )
        )

    @pytest.mark.parametrize(("library", "doors"), ONE_DOOR.items())
    def test_one_door(self, library, doors):
        assert not broken(lambda i: i.module.split(".")[0] == library and not within(i.by, doors))

    def test_nothing_of_the_tests(self):
        assert not broken(lambda i: i.module.split(".")[0] in {"pytest", "hypothesis", "tests", "conftest"})


def allowed(package):
    """What each folder or module of a package may import of the others: read from ORDER."""
    may = {}
    for row in ORDER[package].strip().splitlines():
        before = set()
        for group in row.split("<"):
            names = [name.strip() for name in group.split(",")]
            for name in names:
                may.setdefault(name, set()).update(before)
            before |= set(names)
    for _ in may:  # what may be used of what may be used
        may = {by: used.union(*(may[name] for name in used)) for by, used in may.items()}
    return may


def circle(uses):
    """Return a circle of a graph as a list of its nodes, or nothing."""
    done, path = set(), []

    def visit(node):
        if node in path:
            return [*path[path.index(node) :], node]
        if node not in done:
            path.append(node)
            for used in sorted(uses.get(node, ())):
                if found := visit(used):
                    return found
            done.add(path.pop())
        return []

    return next(filter(None, map(visit, sorted(uses))), [])


def uses():
    """Which module imports which; what a package offers lazily is resolved when it is asked for, so it uses nothing."""
    graph = {module: set() for module in MODULES}
    for found in ours():
        if not _homes(found.by) and found.module in MODULES:
            graph[found.by].add(found.module)
    return graph


class TestOrder:
    @staticmethod
    def place(module, package):
        """The folder or module of `package` that a module belongs to; None for the package itself and outside it."""
        top, *below = module.split(".")
        return below[0] if top == package and below else None

    @pytest.mark.parametrize("package", PACKAGES)
    def test_everything_has_its_place(self, package):
        places = {self.place(module, package) for module in MODULES} - {None}
        assert {place for place in places if not place.startswith("_")} == set(allowed(package))

    @pytest.mark.parametrize("package", PACKAGES)
    def test_later_ones_use_earlier_ones(self, package):
        may = allowed(package)
        wrong = []
        for found in ours():
            by, used = self.place(found.by, package), self.place(found.module, package)
            if None in (by, used) or by in (used, "__main__") or _homes(found.by):
                continue
            if not used.startswith("_") and used not in may.get(by, set()):
                wrong.append(str(found))
        assert not wrong

    def test_a_package_is_not_imported_from_within(self):
        # what it offers is imported there from where it stands
        assert not broken(lambda i: i.module == i.by.split(".")[0] != i.by)

    def test_no_circles_of_files(self):
        assert not circle(uses())

    def test_no_circles_of_folders(self):
        def folder(module):
            return module if MODULES[module].name == "__init__.py" else module.rpartition(".")[0]

        graph = {}
        for module, used in uses().items():
            graph.setdefault(folder(module), set()).update({folder(name) for name in used} - {folder(module)})
        for package in PACKAGES:  # a package's own modules stand beside its folders, in ORDER, and are no part of them
            graph.pop(package)
        assert not circle(graph)

    def test_the_longest_chain(self):
        graph = uses()

        @cache
        def chain(module):
            return (module, *max((chain(used) for used in sorted(graph[module])), key=len, default=()))

        longest = max((chain(module) for module in sorted(graph) if not module.endswith("__main__")), key=len)
        assert len(longest) <= LONGEST_CHAIN, " -> ".join(longest)

    def test_no_folder_is_too_large(self):
        sizes = Counter(path.parent for path in MODULES.values() if path.name != "__init__.py")
        assert not {str(folder): size for folder, size in sizes.items() if size > LARGEST_FOLDER}


@dataclass(frozen=True, kw_only=True)
class Budget:
    """A row of BUDGETS."""

    row: str
    start: int
    ceiling: int

    def complaint(self, count):
        """Say what is wrong with today's count or the ceiling, or nothing."""
        more, *_ = ALLOWANCES.get(self.row, (0,))
        if count > self.ceiling + more:
            return (
                f"{self.row}: {count} are {count - self.ceiling - more} more than the ceiling of {self.ceiling} and an "
                f"allowance of {more}; remove as many, here or, with an allowance that names it, in another folder."
            )
        if self.ceiling > self.start:
            return f"{self.row}: the ceiling of {self.ceiling} is above {self.start}, where it began; ceilings fall."
        if self.ceiling - count > max(SLACK * count, SLACK_LINES):
            lower = f"lower it to {count}; `python benchmarks/code_size.py --lower` does"
            return f"{self.row}: {count} stand under a ceiling of {self.ceiling}: {lower}."
        return ""


class TestBudgets:
    """Rows above what is to be reached stand with today's number, which may only fall."""

    ROWS = tuple(
        Budget(row=m["row"], start=int(m["start"]), ceiling=int(m["ceiling"])) for m in code_size.ROW.finditer(BUDGETS)
    )

    def test_each_row_is_within_its_ceiling(self):
        complaints = [budget.complaint(code_size.count(budget.row)) for budget in self.ROWS]
        assert not list(filter(None, complaints))

    def test_every_folder_has_one_row(self):
        assert len(self.ROWS) == len(BUDGETS.strip().splitlines())
        of_folders = [code_size.count(budget.row) for budget in self.ROWS if budget.row not in code_size.WHOLE]
        assert sum(of_folders) == code_size.count("all code lines")

    def test_allowances_name_a_row_a_reason_and_an_end(self):
        assert set(ALLOWANCES) <= {budget.row for budget in self.ROWS}
        assert all(more > 0 and why and end for more, why, end in ALLOWANCES.values())


class TestMirror:
    """A test stands where its module does: ``test_module.py``, or ``test_module_what.py`` where there are several."""

    TESTS = sorted(path.relative_to(ROOT / "tests") for path in (ROOT / "tests").rglob("test_*.py"))

    @pytest.mark.parametrize("test", TESTS, ids=str)
    def test_of_a_module(self, test):
        if str(test) in NO_MIRROR:
            return
        folder = ROOT / test.parent
        named = {path.stem.lstrip("_") for path in folder.glob("*.py")} | {folder.name}
        assert any(re.fullmatch(f"test_{name}(_.+)?", test.stem) for name in named), f"no module in {test.parent}"

    def test_the_exceptions_are_there(self):
        assert set(NO_MIRROR) <= set(map(str, self.TESTS))


class TestLazyExports:
    LAZY = tuple(name for name in MODULES if _homes(name))

    def test_the_packages_export_lazily(self):
        assert set(PACKAGES) <= set(self.LAZY)

    @pytest.mark.parametrize("package", LAZY)
    def test_every_name_resolves(self, package):
        module, homes = importlib.import_module(package), _homes(package)
        assert module.__all__ == sorted(homes)
        for name, home in homes.items():
            assert getattr(module, name) is getattr(importlib.import_module(home), name)
        assert set(homes) <= set(dir(module))

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
    def test_no_module_of_data_synth_loads_estimators(self):
        every = [f"import {name}" for name in MODULES if name.split(".")[0] == "data_synth"]
        found = {name for name in loaded(*every) if name.split(".")[0] == "signals"}
        # which estimate nothing
        assert found == {"signals", "signals._lazy", "signals._validation", "signals._compile"}

    def test_the_packages_load_nothing_but_themselves(self):
        # what they export is imported where it is first used, numpy and xarray too
        bare = loaded()
        names = loaded("import hums, signals, data_synth") - bare
        foreign = {name for name in names if name.split(".")[0] not in sys.stdlib_module_names}
        assert foreign == {*PACKAGES, "signals._lazy"}

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
        # of ours the package's door and the command line
        ours = {name for name in names if name.split(".")[0] in PACKAGES and not within(name, ["hums.cli"])}
        assert ours == {"hums", "signals", "signals._lazy"}


def test_the_order_is_one():
    for package in PACKAGES:
        may = allowed(package)
        assert not [(a, b) for a, b in itertools.combinations(may, 2) if a in may[b] and b in may[a]]
