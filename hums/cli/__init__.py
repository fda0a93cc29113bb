"""The command line `hums`, a module for each command."""

import atexit
import gc
import logging
import os
import signal
import sys
import threading
import warnings
from collections import Counter
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperOption

from hums.cli.options import UsageError, echo

__all__ = ["main"]

REFUSED, WRONG_USAGE, INTERRUPTED = 1, 2, 130  # the last is 128 + SIGINT, as in shells

app = typer.Typer(
    name="hums",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(requested: bool) -> None:
    if requested:
        from importlib.metadata import version  # noqa: PLC0415

        echo(f"hums {version('hums-toolkit')}")
        raise typer.Exit


@app.callback()
def common(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Order tracking for gearboxes: kinematics, records, analysis, reports and synthetic data."""


class _EachOptionOnce(TyperCommand):
    """A command that refuses an option given twice; click would silently take the last value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 - typer brings its own click or not
        *_, given = self.make_parser(ctx).parse_args(args=list(args))
        for option, times in Counter(given).items():
            if times > 1 and isinstance(option, TyperOption) and not option.multiple:
                raise typer.BadParameter(f"given {times} times, but it takes a single value; keep one.", ctx, option)
        return list(super().parse_args(ctx, args))


_COMMANDS = (  # in the order of the help
    "drawing", "dynamics", "bearings", "orders", "schema", "convert", "info",
    "analyze", "report", "synth", "dataset", "fleet", "demo",
)  # fmt: skip
for name in _COMMANDS:
    app.command(name, cls=_EachOptionOnce)(getattr(import_module(f"hums.cli.{name}"), name))


def main() -> int:
    """Run the command; exit status 0 success, 1 failure, 2 wrong usage, 3 some inputs refused, 130 Ctrl-C."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller: else the next file opened takes its number
            setattr(sys, name, Path(os.devnull).open("r+", encoding="utf-8"))  # noqa: SIM115
    _show_steps()
    # Objects made by imports stay alive: collecting them during a short run and at exit would take a fifth of it.
    gc.set_threshold(500_000)
    atexit.register(gc.freeze)
    with warnings.catch_warnings():
        warnings.showwarning = _print_warning
        hook, sys.unraisablehook = sys.unraisablehook, _interrupt_again
        try:
            status = app(standalone_mode=False)  # the status of typer.Exit, 130 after Ctrl-C; else None
            sys.stdout.flush()
        except (typer.Abort, KeyboardInterrupt):  # typer misses the latter in C callbacks and while it exits
            return INTERRUPTED
        except (ValueError, OSError) as error:
            unnamed = isinstance(error, OSError) and error.errno is not None and error.filename is None
            echo(f"hums: {'standard output: ' if unnamed else ''}{error}", err=True)
            return WRONG_USAGE if isinstance(error, UsageError) else REFUSED
        except Exception as error:
            if error.__class__.__module__.split(".")[0] not in {"click", "typer"}:
                raise
            error.show()  # type: ignore[attr-defined]
            return WRONG_USAGE
        finally:
            sys.unraisablehook = hook
            _drop_what_is_not_taken()
    return status or 0


def _drop_what_is_not_taken() -> None:
    """Drop what a full device does not take: the interpreter would try again at its end, and exit with 120."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _interrupt_again(ignored: Any) -> None:  # noqa: ANN401
    """Interrupt again where Ctrl-C arrived in a callback of the interpreter, which cannot raise."""
    if ignored.exc_type is KeyboardInterrupt:
        threading.Timer(0.01, signal.raise_signal, [signal.SIGINT]).start()
    else:
        sys.__unraisablehook__(ignored)


def _show_steps() -> None:
    """Log each step of a command to standard error once, if that is a terminal."""
    logger = logging.getLogger("hums")
    if not sys.stderr.isatty() or logger.handlers:
        return
    shown: set[str] = set()

    def new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        return not (text in shown or shown.add(text))  # type: ignore[func-returns-value]

    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("hums: %(message)s"))
    handler.addFilter(new)
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)


def _print_warning(message: Warning | str, *_: object, **__: object) -> None:
    echo(f"warning: {message}", err=True)
