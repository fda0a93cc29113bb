"""Run the code blocks of the pages: a page is a session, its blocks run from top to bottom in an empty folder.

``python`` blocks share a namespace; of ``sh`` blocks the lines that call ``hums`` run. What fails is a warning, so that
``sphinx-build -W`` fails, too. Pages that tests run already are left out.
"""

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

logger = logging.getLogger(__name__)
FOLDERS = ("tutorials", "howto", "methods")
BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)


def _run_python(source: str, page: Path, names: dict[str, Any]) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(source, str(page), "exec"), names)  # noqa: S102


def _run_shell(source: str) -> None:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    for line in re.sub(r"\s+#.*", "", source.replace("\\\n", " ")).splitlines():
        if line.startswith("hums "):
            subprocess.run(  # noqa: S603
                shlex.split(line), env=os.environ | {"PATH": path}, check=True, capture_output=True, text=True
            )


def run_page(page: Path) -> str:
    """Run the blocks of a page, and return what went wrong."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for language, source in blocks:
            try:
                _run_python(source, page, names) if language == "python" else _run_shell(source)
            except subprocess.CalledProcessError as error:
                return f"{shlex.join(error.cmd)}: {error.stderr}"
            except Exception:  # noqa: BLE001 - a page may fail in any way
                return traceback.format_exc()
    return ""


def run_pages(app: Sphinx) -> None:
    """Run every page that the tests do not."""
    for folder in FOLDERS:
        for page in sorted((Path(app.srcdir) / folder).glob("*.md")):
            if trouble := run_page(page):
                logger.warning("a code block fails: %s", trouble, location=f"{folder}/{page.stem}")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("builder-inited", run_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
