"""Parts of a long run: what each finds is kept in a file, so that a run that was stopped goes on."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


def kept_or_made(folder: Path, name: str, make: Callable[[], Any]) -> Any:  # noqa: ANN401 - what JSON holds
    """Return what a part found; it is made unless a file of an earlier run has it."""
    file = folder / f"{name}.json"
    if not file.exists():
        part = file.with_suffix(".part")
        part.write_text(json.dumps(make()), encoding="utf-8")
        part.replace(file)
    return json.loads(file.read_text(encoding="utf-8"))
