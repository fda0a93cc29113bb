"""Ranges that stand in a plan where the scene has a value, each by its distribution."""

from typing import Annotated, Any, TypeAlias

from pydantic import AfterValidator, Field

from hums.gearbox import Declared, Name, Positive

__all__ = ["RANGES", "Choice", "Log", "Range", "Uniform"]


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    if not low < high:
        raise ValueError(f"[{low:g}, {high:g}] does not rise; give [low, high]")
    return ends


class Uniform(Declared):
    """Values spread evenly from low to high."""

    uniform: Annotated[tuple[float, float], AfterValidator(_rising)]
    label: Name | None = None

    def at(self, share: float) -> float:
        """Return the value below which `share` of all values lie."""
        low, high = self.uniform
        return low + share * (high - low)


class Log(Declared):
    """Values whose logarithm is spread evenly from low to high."""

    log: Annotated[tuple[Positive, Positive], AfterValidator(_rising)]
    label: Name | None = None

    def at(self, share: float) -> float:
        """Return the value below which `share` of all values lie."""
        low, high = self.log
        return float(low * (high / low) ** share)


class Choice(Declared):
    """One of several values, each as likely; name one twice to have it twice as often."""

    choice: Annotated[tuple[Any, ...], Field(min_length=1)]
    label: Name | None = None

    def at(self, share: float) -> Any:  # noqa: ANN401
        """Return the value at `share` of the way through the list."""
        return self.choice[min(int(share * len(self.choice)), len(self.choice) - 1)]


Range: TypeAlias = Uniform | Log | Choice

RANGES: dict[str, type[Range]] = {"uniform": Uniform, "log": Log, "choice": Choice}
"""By the key that a range is written with."""
