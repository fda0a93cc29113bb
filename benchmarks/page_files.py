"""Tables in Markdown, and the pages that scripts write with them."""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Return the lines of a table, and an empty one after it."""
    cells = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(map(str, row)) + " |" for row in cells] + [""]


def folder_given() -> Path:
    """Return the folder that the command line names, docs/benchmarks without one."""
    return Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "docs" / "benchmarks"


def write_page(path: Path, lines: Iterable[str]) -> None:
    """Write the lines of a page into its folder, and print them."""
    text = "\n".join(lines).rstrip() + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    print(text)  # noqa: T201
