"""Fleets killed, doubled and deprived of what they need: python benchmarks/load.py [FOLDER [RECORDS [KILLS]]].

Writes load.md into FOLDER (default docs/benchmarks).
"""

import sys
import tempfile
from pathlib import Path

from attacks.loads import FEW, attack_fleets

RECORDS, KILLS = 300, 50
NOTE = """\
# Load

Made by `python benchmarks/load.py {folder} {records} {kills}`. A fleet of small records on two processes; its table has
to be that of an undisturbed run, byte for byte, with nothing left behind. Loads below the second have {few} records."""
HEADER = "| load | outcome | s |\n|---|---|---|"


def main(folder: Path, *, records: int = RECORDS, kills: int = KILLS) -> int:
    """Write the page; return 1 where something was lost, doubled or said in no sentence."""
    with tempfile.TemporaryDirectory() as scratch:
        rows, wrong = attack_fleets(Path(scratch) / "fleets", records=records, kills=kills)
    note = NOTE.format(folder=folder, records=records, kills=kills, few=FEW)
    shown = [f"- `{line[:300].replace('`', '')}`".replace("\n", " ") for line in wrong]
    page = "\n".join([note, "", HEADER, *rows, "", *(shown or ["Nothing was lost, doubled or left behind."]), ""])
    (folder / "load.md").write_text(page, encoding="utf-8")
    print(page)  # noqa: T201 - what the command is for
    return int(bool(wrong))


if __name__ == "__main__":
    words = sys.argv[1:]
    sizes = dict(zip(("records", "kills"), map(int, words[1:]), strict=False))
    sys.exit(main(Path(words[0] if words else "docs/benchmarks"), **sizes))
