"""Run the code blocks of the pages: a page is a session, its blocks run from top to bottom in an empty folder.

Pages run in processes of their own, while the gallery runs in the process of Sphinx.

``python`` blocks share a namespace, ``sh`` blocks are commands, a line each. What fails is a warning, so that
``sphinx-build -W`` fails, too. A block within a comment of HTML runs unseen: it makes the files that a reader has. A
block after the comment ``<!-- not run: reason -->`` is left out. Scenes and other tables in TOML run in the tests. What
a block prints, and the pictures (``.svg``) that it leaves in the folder, stand below it.
"""

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import textwrap
import traceback
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

import hums.jobs
from hums.cli import main

logger = logging.getLogger(__name__)
PAGES = ("*.md", "tutorials/*.md", "howto/*.md", "methods/*.md")
BLOCK = re.compile(r"(<!-- not run: [^>]+ -->\n)?^```(python|sh)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)

MADE = "made"  # folder of the pictures that blocks leave, beside the pages
MOST_LINES, MOST_COLUMNS = 30, 100


@dataclass(frozen=True)
class Shown:
    """What a block prints, and the pictures it leaves, by their paths from the root of the pages."""

    text: str
    pictures: tuple[str, ...]


POOL = ProcessPoolExecutor()
RUNNING: dict[str, Future[tuple[dict[str, Shown], str]]] = {}  # page -> what its blocks show, and what went wrong
SHOWN: dict[str, dict[str, Shown]] = {}  # page -> source of a block -> what stands below it


def _run_python(source: str, page: Path, names: dict[str, Any]) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(source, str(page), "exec"), names)  # noqa: S102
    return printed.getvalue()


def _run_shell(source: str) -> str:
    """Run a block line by line, the commands of the toolkit in this process, which has its modules and kernels."""
    lines = [shlex.split(line, comments=True) for line in source.replace("\\\n", " ").splitlines()]
    return "".join(_run_hums(words) if words[0] == "hums" else _run_other(words) for words in lines if words)


def _run_hums(words: list[str]) -> str:
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()) as complaint:
        sys.argv = words
        status = main()
    if status:
        raise subprocess.CalledProcessError(status, words, stderr=complaint.getvalue())
    return said.getvalue()


def _run_other(words: list[str]) -> str:
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout  # noqa: S603


def run_page(page: Path, root: Path) -> tuple[dict[str, Shown], str]:
    """Run the blocks of a page, and return what each shows and what went wrong."""
    names: dict[str, Any] = {"__name__": "__main__"}
    shown: dict[str, Shown] = {}
    hums.jobs.Processes = lambda **_: hums.jobs.Serial()  # each process would load all that this one has
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for left_out, language, source in BLOCK.findall(page.read_text(encoding="utf-8")):
            if left_out:
                continue
            before = set(Path().glob("*.svg"))
            try:
                said = _run_python(source, page, names) if language == "python" else _run_shell(source)
            except subprocess.CalledProcessError as error:
                return shown, f"{shlex.join(error.cmd)}\n{error.stderr}"
            except Exception:  # noqa: BLE001 - a page may fail in any way
                return shown, traceback.format_exc()
            pictures = [_kept(picture, page, root) for picture in sorted(set(Path().glob("*.svg")) - before)]
            shown[source] = Shown(said.replace(f"{Path.cwd()}{os.sep}", ""), tuple(pictures))
    return shown, ""


def _kept(picture: Path, page: Path, root: Path) -> str:
    kept = root / MADE / f"{page.parent.name}-{page.stem}-{picture.name}"
    shutil.copyfile(picture, kept)
    return f"/{MADE}/{kept.name}"


def start_pages(app: Sphinx) -> None:
    """Start to run the pages that have blocks, those with the most commands first."""
    root = Path(app.srcdir)
    (root / MADE).mkdir(exist_ok=True)
    SHOWN.clear()
    texts = {page: page.read_text(encoding="utf-8") for pattern in PAGES for page in root.glob(pattern)}
    for page in sorted(texts, key=lambda page: -texts[page].count("\nhums ")):
        if BLOCK.search(texts[page]):
            name = str(page.relative_to(root).with_suffix(""))
            RUNNING[name] = POOL.submit(run_page, page, root)


def end_pages(_app: Sphinx) -> None:
    """Wait for the pages, and enter what they show."""
    for name, page in sorted(RUNNING.items()):
        SHOWN[name], trouble = page.result()
        if trouble:
            logger.warning("a code block fails: %s", trouble, location=name)
    POOL.shutdown()


def _wrapped(line: str) -> list[str]:
    """Return a line as it is, or a long sentence over several; a row of a table, which has gaps, stays one."""
    if len(line) <= MOST_COLUMNS or "  " in line.strip():
        return [line]
    return textwrap.wrap(line, MOST_COLUMNS, subsequent_indent="    ", break_long_words=False)


def show_below(_app: Sphinx, page: str, content: list[str]) -> None:
    """Put below each block the first lines of what it prints, and its pictures."""

    def shown(match: re.Match[str]) -> str:
        below = SHOWN.get(page, {}).get(match.group(3), Shown("", ()))
        said = below.text.rstrip().splitlines()
        lines = [part for line in said[:MOST_LINES] for part in _wrapped(line)] + ["..."] * (len(said) > MOST_LINES)
        text = "\n\n```text\n" + "\n".join(lines) + "\n```" if lines else ""
        return match.group(0) + text + "".join(f"\n\n![made by the lines above]({path})" for path in below.pictures)

    content[0] = BLOCK.sub(shown, content[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.connect("builder-inited", start_pages, priority=100)  # before the gallery, which has 500
    app.connect("builder-inited", end_pages, priority=900)
    app.connect("source-read", show_below)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
