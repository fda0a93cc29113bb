"""Run the code blocks of the pages: a page is a session, its blocks run from top to bottom in an empty folder.

``python`` blocks share a namespace, ``sh`` blocks are given to bash. What fails is a warning, so that
``sphinx-build -W`` fails, too. A block within a comment of HTML runs unseen: it makes the files that a reader has. A
block after the comment ``<!-- not run: reason -->`` is left out. Scenes and other tables in TOML run in the tests.
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


def _run_python(source: str, page: Path, names: dict[str, Any]) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(source, str(page), "exec"), names)  # noqa: S102


def _run_shell(source: str) -> None:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    words = ["bash", "-euo", "pipefail", "-c", source]
    subprocess.run(words, env=os.environ | {"PATH": path}, check=True, capture_output=True, text=True)  # noqa: S603


def run_page(page: Path) -> str:
    """Run the blocks of a page, and return what went wrong."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for left_out, language, source in blocks:
            if left_out:
                continue
            try:
                _run_python(source, page, names) if language == "python" else _run_shell(source)
            except subprocess.CalledProcessError as error:
                return f"{source}{error.stderr}"
            except Exception:  # noqa: BLE001 - a page may fail in any way
                return traceback.format_exc()
    return ""


def run_pages(app: Sphinx) -> None:
    """Run every page."""
    root = Path(app.srcdir)
    for page in sorted(found for pattern in PAGES for found in root.glob(pattern)):
        if trouble := run_page(page):
            logger.warning("a code block fails: %s", trouble, location=str(page.relative_to(root).with_suffix("")))


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("builder-inited", run_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
