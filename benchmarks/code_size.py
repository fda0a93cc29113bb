"""Code lines, modules and constants by folder: python benchmarks/code_size.py [--lower] [--tree PATH].

Code lines are those that hold code: no docstring or other bare string, no comment, no blank line. Constants are names
in capitals that a module assigns at its top level. `--lower` brings the ceilings in `tests/test_architecture.py` down
to today's counts, and raises none: for a commit that removes code, and again where two such commits met in a rebase.
"""

import argparse
import ast
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("signals", "hums", "data_synth")
TABLE = Path("tests", "test_architecture.py")  # the string BUDGETS in it
CONSTANT = re.compile(r"_*[A-Z][A-Z0-9_]*")


@dataclass(frozen=True, kw_only=True)
class Size:
    """What a file or folder holds; `test_functions` are those named `test_...`, in classes or not."""

    lines: int = 0
    modules: int = 0
    constants: int = 0
    test_functions: int = 0

    def __add__(self, other: "Size") -> "Size":
        """Return both together."""
        return Size(
            lines=self.lines + other.lines,
            modules=self.modules + other.modules,
            constants=self.constants + other.constants,
            test_functions=self.test_functions + other.test_functions,
        )


def size_of(source: str) -> Size:
    """Return the size of one module, from its text."""
    nodes, bare = list(ast.walk(tree := ast.parse(source))), set[int]()
    lines = {number for number, line in enumerate(source.splitlines(), 1) if line.strip()[:1] not in ("", "#")}
    for node in nodes:
        if isinstance(node, ast.Expr) and _is_bare_string(node):
            bare.update(range(node.lineno, (node.end_lineno or 0) + 1))
        elif isinstance(node, ast.Constant | ast.JoinedStr):  # blank lines in a string that is used count
            lines.update(range(node.lineno, (node.end_lineno or 0) + 1))
    tests = (isinstance(node, ast.FunctionDef) and node.name.startswith("test_") for node in nodes)
    return Size(lines=len(lines - bare), modules=1, constants=len(list(_constants(tree))), test_functions=sum(tests))


def _is_bare_string(statement: ast.Expr) -> bool:
    return isinstance(statement.value, ast.Constant) and isinstance(statement.value.value, str)


def _constants(tree: ast.Module) -> Iterable[str]:
    for statement in tree.body:
        targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
        for target in targets:
            for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(name, ast.Name) and CONSTANT.fullmatch(name.id):
                    yield name.id


@cache
def folders(root: Path, top: str) -> dict[str, Size]:
    """Return the size of each folder below `top`, without that of the folders in it."""
    found: dict[str, Size] = {}
    for path in sorted((*(root / top).rglob("*.py"), *(root / top).rglob("*.pyi"))):
        name, size = path.parent.relative_to(root).as_posix(), size_of(path.read_text(encoding="utf-8"))
        found[name] = found.get(name, Size()) + replace(size, modules=int(path.suffix == ".py"))
    return found


def total(root: Path, *tops: str) -> Size:
    """Return the size of everything below some folders."""
    return sum((size for top in tops for size in folders(root, top).values()), Size())


WHOLE: dict[str, tuple[tuple[str, ...], str]] = {
    "all code lines": (PACKAGES, "lines"),
    "all modules": (PACKAGES, "modules"),
    "all constants": (PACKAGES, "constants"),
    "tests": (("tests",), "lines"),
    "benchmarks": (("benchmarks",), "lines"),
}


def count(row: str, root: Path = ROOT) -> int:
    """Return today's count of a row: one of `WHOLE`, or the code lines of folders, of "(root)" without those in it."""
    if row in WHOLE:
        tops, what = WHOLE[row]
        return int(getattr(total(root, *tops), what))
    lines = 0
    for part in row.split(","):
        name, _, alone = part.strip().partition(" ")
        for folder, size in folders(root, name.split("/")[0]).items():
            lines += size.lines if folder == name or (not alone and folder.startswith(f"{name}/")) else 0
    return lines


ROW = re.compile(r"^ +(?P<row>[a-z].*?)  +(?P<start>\d+)(?P<gap> +)(?P<ceiling>\d+) +(?P<final>\d+)$", re.MULTILINE)


def lowered(text: str, root: Path = ROOT) -> str:
    """Return a table of budgets with each ceiling at today's count, where that is lower."""

    def lower(match: re.Match[str]) -> str:
        before, ceiling = match.start("gap") - match.start(), match["gap"] + match["ceiling"]
        now = str(min(count(match["row"], root), int(match["ceiling"]))).rjust(len(ceiling))
        return match[0][:before] + now + match[0][before + len(ceiling) :]

    return ROW.sub(lower, text)


def main() -> None:
    """Print the counts, or lower the ceilings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lower", action="store_true", help="bring the ceilings down to today's counts")
    parser.add_argument("--tree", type=Path, default=ROOT, help="another working tree to count")
    given = parser.parse_args()
    if given.lower:
        table = ROOT / TABLE
        table.write_text(lowered(table.read_text(encoding="utf-8")), encoding="utf-8")
    for top in (*PACKAGES, "tests", "benchmarks"):
        for name, size in folders(given.tree, top).items():
            print(f"{name:40}{size.modules:5} modules{size.lines:7} code lines{size.constants:6} constants")  # noqa: T201
    for row in WHOLE:
        print(f"{row:40}{count(row, given.tree):7}")  # noqa: T201


if __name__ == "__main__":
    main()
