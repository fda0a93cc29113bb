"""Distributions that a plan may have where the scene has a value."""

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
    """A uniform distribution from low to high."""

    uniform: Annotated[tuple[float, float], AfterValidator(_rising)]
    label: Name | None = None

    def at(self, share: float) -> float:
        """Return the quantile at probability `share`."""
        low, high = self.uniform
        return low + share * (high - low)


class Log(Declared):
    """A log-uniform distribution from low to high."""

    log: Annotated[tuple[Positive, Positive], AfterValidator(_rising)]
    label: Name | None = None

    def at(self, share: float) -> float:
        """Return the quantile at probability `share`."""
        low, high = self.log
        return float(low * (high / low) ** share)


class Choice(Declared):
    """A discrete distribution over listed values, equally likely; a value named twice is twice as likely."""

    choice: Annotated[tuple[Any, ...], Field(min_length=1)]
    label: Name | None = None

    def at(self, share: float) -> Any:  # noqa: ANN401
        """Return the quantile at probability `share`, in the order of the list."""
        return self.choice[min(int(share * len(self.choice)), len(self.choice) - 1)]


Range: TypeAlias = Uniform | Log | Choice

RANGES: dict[str, type[Range]] = {"uniform": Uniform, "log": Log, "choice": Choice}
"""By the key that a range is written with."""
