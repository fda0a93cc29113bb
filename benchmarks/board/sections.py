"""A section of the scoreboard: rows, and the measurements for them, in pieces that may run side by side."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from board.table import Figure, Row

Size = Literal["quick", "plain", "full"]
Task = Callable[[], Any]


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much is measured: the size, the number of the first synthetic record, and where measured records lie."""

    size: Size = "quick"
    first: int = 0
    data: Path | None = None

    def pick(self, quick: Any, plain: Any, full: Any) -> Any:  # noqa: ANN401
        """Return what is for this size."""
        return {"quick": quick, "plain": plain, "full": full}[self.size]

    def numbers(self, quick: int, plain: int, full: int) -> range:
        """Return the numbers of the synthetic records of this size."""
        return range(self.first, self.first + int(self.pick(quick, plain, full)))


@dataclass(frozen=True, kw_only=True)
class Section:
    """Rows, the tasks that measure them, and what makes figures of the tasks' results; `alone` where time is taken."""

    name: str
    rows: tuple[Row, ...]
    tasks: Callable[[Effort], Sequence[Task]]
    figures: Callable[[Sequence[Any]], Mapping[str, Figure]]
    alone: bool = False
