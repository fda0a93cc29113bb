"""Licences of all that the toolkit installs, from their own metadata: python benchmarks/licences.py [FOLDER].

Writes licences.md into FOLDER (default docs). A distribution that is not installed where it runs is named without one.
"""

import re
import sys
import tomllib
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
NOTE = """\
# Licences

Distributions that `pip install hums-toolkit` installs, with what each of its extras for users adds, and the licence
that each states of itself. Written by `python benchmarks/licences.py` from the metadata of what is installed.
`hums/pages` also holds plotly.js's cartesian bundle 4.1.1 (MIT, its licence beside it).

Known vulnerabilities of what is installed are listed by `pip install pip-audit && pip-audit --skip-editable`, on a
machine that reaches the advisories of PyPI; elsewhere it says of each distribution that it could not be audited, which
is no finding."""
HEADER = "| distribution | licence | for |\n|---|---|---|"
FOR_DEVELOPERS = {"test", "docs", "bench"}


def needed(requirements: list[str], extra: str, found: dict[str, Distribution | None]) -> None:
    """Add the distributions that requirements name, and what those need."""
    for text in requirements:
        one = Requirement(text)
        if one.marker is not None and not one.marker.evaluate({"extra": extra}):
            continue
        if extra and (one.marker is None or "extra" not in str(one.marker)):
            continue
        key = re.sub(r"[-_.]+", "-", one.name).lower()
        if key in found:
            continue
        try:
            found[key] = distribution(one.name)
        except PackageNotFoundError:
            found[key] = None
            continue
        for wanted in ("", *one.extras):
            needed(found[key].requires or [], wanted, found)


def licence(of: Distribution | None) -> str:
    """Return the licence that a distribution states: its expression, its classifiers, or its first line."""
    if of is None:
        return "not installed here"
    about = of.metadata
    if about.get("License-Expression"):
        return about["License-Expression"]
    named = [
        line.rpartition("::")[2].strip() for line in about.get_all("Classifier") or [] if line.startswith("License ::")
    ]
    return ", ".join(named) or ((about.get("License") or "").strip().splitlines() or ["not stated"])[0][:60]


def main(folder: Path) -> int:
    """Write the table; return 1 where a licence is not stated."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    extras = {name: what for name, what in project["optional-dependencies"].items() if name not in FOR_DEVELOPERS}
    rows: dict[str, tuple[str, str]] = {}
    for extra, requirements in {"": project["dependencies"], **extras}.items():
        found: dict[str, Distribution | None] = {}
        needed(requirements, "", found)
        for name, one in found.items():
            version = f" {one.version}" if one is not None else ""
            rows.setdefault(name, (f"{name}{version} | {licence(one)}", f"`[{extra}]`" if extra else "all"))
    table = [f"| {text} | {where} |" for _, (text, where) in sorted(rows.items())]
    (folder / "licences.md").write_text("\n".join([NOTE, "", HEADER, *table, ""]), encoding="utf-8")
    return int(any("not stated" in row for row in table))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs")))
