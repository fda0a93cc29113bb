"""A report on paper: its page printed by Chromium."""

import os
import shutil
import subprocess
from pathlib import Path

from hums.records.outputs import atomic_write, check_outputs

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_TIMEOUT_S = 180.0  # a page of 16 channels takes 20 s on one core


def write_pdf(page: str | Path, *, full: bool = False, force: bool = False) -> Path:
    """Print a report to a PDF next to it, with Chromium, Chrome or Edge.

    Parameters
    ----------
    page : str or Path
        Page written by `hums.write_report`.
    full : bool
        Whether to print the whole page. Default: a summary to forward, with the answer, the mechanism, the plots that
        show the findings, and the verdict on every component.
    force : bool
        Whether to overwrite a PDF that another program wrote.

    Returns
    -------
    Path
        The page's path with the suffix ``.pdf``. An existing file is replaced only when the new one is complete.

    Raises
    ------
    ValueError
        If no such browser is on the PATH, printing fails, or, without `force`, another program wrote the PDF.
    """
    page = Path(os.path.realpath(page))
    target = page.with_suffix(".pdf")
    check_outputs([target], inputs=[page], force=force)
    browser = next((found for name in _BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        raise ValueError(
            f"no browser to print the PDF: none of {', '.join(_BROWSERS)} is on the PATH; install Chromium, Chrome "
            f"or Edge, or open {page} and print it from there."
        )
    as_root = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []  # its sandbox refuses root
    with atomic_write(target) as part:
        command = [
            browser,
            "--headless",
            "--disable-gpu",
            *as_root,
            "--no-pdf-header-footer",
            "--virtual-time-budget=20000",  # ms of the page's own clock, which runs as fast as its scripts allow
            f"--print-to-pdf={part}",
            f"{page.as_uri()}#print{'-full' if full else ''}",
        ]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)  # noqa: S603
            last = (done.stderr.strip().splitlines() or ["no reason was given"])[-1]
        except subprocess.TimeoutExpired:
            last = f"not finished after {_TIMEOUT_S:g} s"
        if not part.exists() or done.returncode:
            raise ValueError(f"{browser} did not print {page}: {last}; open the page and print it from there.")
    return target
