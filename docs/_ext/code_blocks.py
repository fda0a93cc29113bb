"""Run the code blocks of the pages: a page is a session, its blocks run from top to bottom in an empty folder.

``python`` blocks share a namespace, ``sh`` blocks are given to bash. What fails is a warning, so that
``sphinx-build -W`` fails, too. A block within a comment of HTML runs unseen: it makes the files that a reader has. A
block after the comment ``<!-- not run: reason -->`` is left out. Scenes and other tables in TOML run in the tests. What
a block of a tutorial prints stands below it.
"""

import contextlib
import io
import os
import re
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)
PAGES = ("*.md", "tutorials/*.md", "howto/*.md", "methods/*.md")
BLOCK = re.compile(r"(<!-- not run: [^>]+ -->\n)?^```(python|sh)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)

PRINTED: dict[str, dict[str, str]] = {}  # page -> source of a block -> what it printed
MOST_LINES, MOST_COLUMNS = 30, 160


def _run_python(source: str, page: Path, names: dict[str, Any]) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(source, str(page), "exec"), names)  # noqa: S102
    return printed.getvalue()


def _run_shell(source: str) -> str:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    words = ["bash", "-euo", "pipefail", "-c", source]
    done = subprocess.run(words, env=os.environ | {"PATH": path}, check=True, capture_output=True, text=True)  # noqa: S603
    return done.stdout


def run_page(page: Path, printed: dict[str, str]) -> str:
    """Run the blocks of a page, enter what each prints, and return what went wrong."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for left_out, language, source in blocks:
            if left_out:
                continue
            try:
                said = _run_python(source, page, names) if language == "python" else _run_shell(source)
                if said.strip():
                    printed[source] = said.replace(f"{Path.cwd()}{os.sep}", "")
            except subprocess.CalledProcessError as error:
                return f"{source}{error.stderr}"
            except Exception:  # noqa: BLE001 - a page may fail in any way
                return traceback.format_exc()
    return ""


def run_pages(app: Sphinx) -> None:
    """Run every page."""
    root = Path(app.srcdir)
    PRINTED.clear()
    for page in sorted(found for pattern in PAGES for found in root.glob(pattern)):
        name = str(page.relative_to(root).with_suffix(""))
        if trouble := run_page(page, PRINTED.setdefault(name, {})):
            logger.warning("a code block fails: %s", trouble, location=name)


def show_printed(_app: Sphinx, page: str, content: list[str]) -> None:
    """Put below each block of a tutorial what it prints, the first lines of it."""
    if not page.startswith("tutorials/"):
        return

    def shown(match: re.Match[str]) -> str:
        said = PRINTED.get(page, {}).get(match.group(3), "").rstrip().splitlines()
        lines = [line[:MOST_COLUMNS] for line in said[:MOST_LINES]] + ["..."] * (len(said) > MOST_LINES)
        return f"{match.group(0)}\n\n```text\n" + "\n".join(lines) + "\n```" if lines else match.group(0)

    content[0] = BLOCK.sub(shown, content[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("builder-inited", run_pages)
    app.connect("source-read", show_printed)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
