"""Options that several commands share."""

import os
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from hums.jobs import Workers

__all__ = ["Scheduler", "WorkerCount", "chosen_workers", "parse_speeds"]

WorkerCount = Annotated[
    int | None, typer.Option("--workers", metavar="N", help="Processes to work in. Default one a processor.")
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Scheduler of a Dask cluster to work on, tcp://HOST:PORT.")
]


def parse_speeds(texts: list[str] | None) -> dict[str, float] | None:
    """Return the speeds of options ``--speed LINK=RPM`` by link, in rpm; None without one."""
    return dict(_parse_speed(text) for text in texts) if texts else None


def _parse_speed(text: str) -> tuple[str, float]:
    link, separator, rpm = text.rpartition("=")
    try:
        return link, float(rpm)
    except ValueError:
        separator = ""
    if not separator:
        raise ValueError(f'--speed "{text}": write LINK=RPM, as in --speed "sun=1500".')
    return link, 0.0


def chosen_workers(count: int | None, scheduler: str | None) -> "Workers":
    """Return where jobs run, by the options --workers and --scheduler."""
    from hums.jobs import Cluster, Processes  # noqa: PLC0415

    if count is not None and scheduler is not None:
        raise ValueError("--workers and --scheduler are both given; keep one.")
    if scheduler is not None:
        return Cluster(address=scheduler)
    return Processes(count=os.cpu_count() or 1 if count is None else count)
