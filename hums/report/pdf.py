"""A report on paper: its page printed by Chromium."""

import os
import shutil
import subprocess
from pathlib import Path

from hums.records.outputs import atomic_write, check_outputs

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_DRAWING_MS = 20_000  # of the page's own clock, which runs as fast as its scripts allow
_TIMEOUT_S = 180.0  # a page of 16 channels takes 20 s on one core


def write_pdf(page: str | Path, *, full: bool = False, force: bool = False) -> Path:
    """Print a page to a PDF beside it, through Chromium, Chrome or Edge.

    Parameters
    ----------
    page : str or Path
        A page of `hums.write_report`.
    full : bool
        Whether to print all of it; by default what there is to forward: the answer, the mechanism, the plots that show
        what was found, and the verdict on every component.
    force : bool
        Whether a PDF of another program is replaced.

    Returns
    -------
    Path
        The page's path with the suffix ``.pdf``. An existing file is replaced only when the new one is complete.

    Raises
    ------
    ValueError
        If there is no such browser on the PATH, it prints nothing, or the PDF is one of another program.
    """
    page = Path(os.path.realpath(page))
    target = page.with_suffix(".pdf")
    check_outputs([target], inputs=[page], force=force)
    browser = next((found for name in _BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        raise ValueError(
            f"a PDF is printed by Chromium, Chrome or Edge, and none of {', '.join(_BROWSERS)} is on the PATH; install "
            f"one, or open {page} and print it from there."
        )
    as_root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []  # its sandbox refuses root
    with atomic_write(target) as part:
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            *as_root,
            "--no-pdf-header-footer",
            f"--virtual-time-budget={_DRAWING_MS}",
            f"--print-to-pdf={part}",
            f"{page.as_uri()}#print{'-full' if full else ''}",
        ]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)  # noqa: S603
        if done.returncode or not part.exists():
            last = (done.stderr.strip().splitlines() or ["no reason was given"])[-1]
            raise ValueError(f"{browser} did not print {page}: {last}; open the page and print it from there.")
    return target
