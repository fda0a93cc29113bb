"""Options and steps that several commands share."""

import inspect
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Optional

import typer

if TYPE_CHECKING:
    from fractions import Fraction

    from hums.analysis.settings import AnalysisSettings
    from hums.gearbox.kinematics import Kinematics
    from hums.jobs import Workers

Out = Annotated[Path, typer.Option("--out", "-o", help="Output folder.")]
SpeedUnits = Annotated[Literal["rpm", "Hz"], typer.Option("--units", help="Unit in which speeds are stated first.")]
WorkerCount = Annotated[
    int | None, typer.Option("--workers", metavar="N", help="Number of worker processes. Default: one per CPU core.")
]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Scheduler of a Dask cluster to run on, tcp://HOST:PORT.")
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite files written by other programs.")]
FigureFormat = Annotated[Literal["svg", "png"], typer.Option("--format", help="Format of figures written to a folder.")]
LinkSpeeds = Annotated[
    list[str] | None, typer.Option("--speed", metavar="LINK=RPM", help="Speed of a link in rpm; repeatable.")
]


class UsageError(ValueError):
    """Options or arguments that are missing, contradictory or invalid: exit status 2."""


@contextmanager
def option_values() -> Iterator[None]:
    """Report invalid values in the block as wrong usage."""
    try:
        yield
    except ValueError as error:
        raise UsageError(str(error)) from None


def parse_speeds(texts: list[str] | None, kinematics: "Kinematics") -> "dict[str, Fraction] | None":
    """Return the speeds of options ``--speed LINK=RPM`` by link, in rpm, as exact fractions; None without one.

    Raises
    ------
    UsageError
        If a text is malformed, or there are fewer speeds than degrees of freedom.
    """
    from fractions import Fraction  # noqa: PLC0415

    from hums.drawing import START_RPM, free_links  # noqa: PLC0415

    found = {}
    for text in texts or ():
        link, separator, rpm = text.rpartition("=")
        try:
            found[link] = Fraction(rpm)
        except (ValueError, ZeroDivisionError):
            separator = ""
        if not separator:
            raise UsageError(f'--speed "{text}": write LINK=RPM, as in --speed "sun=1500".')
    if max(1, len(found)) < kinematics.dof:
        links = free_links(kinematics)
        example = " ".join(f'--speed "{link}={START_RPM * (link == links[0])}"' for link in links)
        raise UsageError(
            f'gearbox "{kinematics.gearbox.name}" has {kinematics.dof} degrees of freedom; give as many speeds, as in '
            f"{example}."
        )
    return found or None


# Options by field of AnalysisSettings.
SHARED_SETTINGS: dict[str, tuple[Any, Any]] = {
    "channels": (list[str] | None, typer.Option("--channel", help="Channel to analyse; repeatable. Default: all.")),
    "tachometer": (str | None, typer.Option(help="Tachometer that measures the shaft angle. Default: the first.")),
    "speed_range_hz": (
        Optional[tuple[float, float]],  # noqa: UP045  (typer reads this form)
        typer.Option(
            "--speed-range",
            metavar="LOW HIGH",
            help="Without a tachometer: speed range of the reference in rev/s (1500 rpm = 25); requires "
            "--max-acceleration.",
        ),
    ),
    "max_acceleration_hz_s": (
        float | None,
        typer.Option(
            "--max-acceleration",
            metavar="HZ_PER_S",
            help="Maximum rate of change of that speed in rev/s per second; 1 suits a steady drive.",
        ),
    ),
    "envelope_band_hz": (
        Optional[tuple[float, float]],  # noqa: UP045
        typer.Option(
            "--envelope-band",
            metavar="LOW HIGH",
            help="Demodulation band in Hz. Default: chosen for each channel; the report gives the reason.",
        ),
    ),
    "no_envelope": (
        bool | None,
        typer.Option("--no-envelope", help="Skip the envelope analysis; bearings are then not judged."),
    ),
    "false_alarm_probability": (
        float | None,
        typer.Option(help="False-alarm probability of a whole record. Default: 0.01."),
    ),
}
SETTINGS = SHARED_SETTINGS | {
    "freeze_baseline": (
        bool | None,
        typer.Option("--freeze-baseline", help="Do not update the baseline (NA4*, NB4*)."),
    ),
    "max_order": (float | None, typer.Option(help="Highest order of the order spectrum.")),
    "track_bandwidth_orders": (
        float | None,
        typer.Option("--track-bandwidth", help="Bandwidth of amplitude tracks in orders. Default: maximum likelihood."),
    ),
    "velocity_limits_mm_s": (
        Optional[tuple[float, float, float]],  # noqa: UP045
        typer.Option(
            "--velocity-limits",
            metavar="AB BC CD",
            help="RMS velocities in mm/s of zone boundaries A/B, B/C and C/D, from the part of ISO 20816 that applies.",
        ),
    ),
    "machine_class": (str | None, typer.Option(help="Part of ISO 20816 and machine class, for the report.")),
}


def with_settings(
    options: Mapping[str, tuple[Any, Any]], **fixed: object
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds these options to a command and passes it the settings they and `fixed` define."""

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        def run(**given: Any) -> None:  # noqa: ANN401  (each option keeps its own type)
            chosen = {name: given.pop(name) for name in options}
            command(**given, settings=_settings_of(chosen | fixed))

        keyword = inspect.Parameter.KEYWORD_ONLY
        own = [one.replace(kind=keyword) for one in inspect.signature(command).parameters.values()]
        run.__doc__ = command.__doc__
        run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]  # what typer reads
            [one for one in own if one.name != "settings"]
            + [inspect.Parameter(n, keyword, default=None, annotation=Annotated[of]) for n, of in options.items()]
        )
        return run

    return decorated


def _settings_of(chosen: Mapping[str, Any]) -> "AnalysisSettings":
    """Return the settings given by options, the others at their defaults."""
    from hums.analysis.settings import AnalysisSettings  # noqa: PLC0415

    stated = {name: value for name, value in chosen.items() if value is not None and value != []}
    if stated.pop("no_envelope", None):
        if "envelope_band_hz" in stated:
            raise UsageError("--envelope-band and --no-envelope are both given; keep one.")
        stated["envelope_band_hz"] = None
    with option_values():
        return AnalysisSettings(**stated)


def workers_of(count: int | None, scheduler: str | None) -> "Workers":
    """Return the workers for many records: processes of this machine, or a Dask cluster."""
    from hums.jobs import Cluster, Processes  # noqa: PLC0415

    if count is not None and scheduler is not None:
        raise UsageError("--workers and --scheduler are both given; keep one.")
    with option_values():
        if scheduler is not None:
            return Cluster(address=scheduler)
        return Processes(count=os.cpu_count() or 1 if count is None else count)


RECORD_SUFFIXES = (".h5", ".hdf5")


def check_record_target(target: Path, *, inputs: Iterable[str | Path], force: bool) -> None:
    """Refuse an output record that is not named as HDF5, is also an input, or was written by another program."""
    from hums.records.outputs import check_outputs  # noqa: PLC0415

    check_outputs([target], inputs=inputs, force=force)
    if target.suffix.lower() not in RECORD_SUFFIXES:
        raise UsageError(f"{target}: records are HDF5 files; name it {target.with_suffix('.h5')}.")


def echo(text: str, *, err: bool = False, nl: bool = True) -> None:
    """Print a text with control characters and undecodable bytes of file names escaped.

    If standard error is closed, the exit status still tells what happened.
    """
    from signals._validation import plain_text  # noqa: PLC0415

    with suppress(OSError) if err else nullcontext():
        typer.echo(plain_text(text, keep="\n\t"), err=err, nl=nl)


def say(step: str) -> None:
    """Announce a step through the logger "hums", as the packages do."""
    logging.getLogger("hums").info(step)


def end_with_refusals(word: str, reasons: Mapping[str, str], total: int, table: str) -> None:
    """Print the first inputs that were refused and then their number; exit with status 3 if there are any.

    Raises
    ------
    ValueError
        If all were refused.
    """
    from signals._validation import plain_message  # noqa: PLC0415

    for name, reason in list(reasons.items())[:5]:
        echo(plain_message(f"{word} {name}: {reason}"))
    told = f"{len(reasons)} of {total} {word}; reasons: {table}"
    if reasons and len(reasons) == total:
        raise ValueError(f"{told}.")
    if reasons:
        echo(told)
        raise typer.Exit(3)  # done, except for inputs that were refused


def save_picture(
    draws: Sequence[Callable[..., object]], path: Path, size: tuple[float, float], *, force: bool, columns: int = 2
) -> None:
    """Draw plots, each on axes of its own, in rows of at most `columns`, into a figure of a size in inches."""
    say(f"drawing {path.name}")
    from hums.plots import save_figure  # noqa: PLC0415

    def draw(ax: Any) -> None:  # noqa: ANN401 - matplotlib stays in hums.plots
        figure = ax.figure
        ax.remove()
        places = figure.subplots(-(-len(draws) // columns), min(columns, len(draws)), squeeze=False).ravel()
        for one, place in zip(draws, places, strict=False):
            one(ax=place)

    save_figure(draw, path, width=size[0], height=size[1], force=force)
    echo(f"wrote {path}")
