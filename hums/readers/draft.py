"""Draft of an import description: what a file states, and lines to fill in for what it lacks."""

import math
from pathlib import Path

from hums.readers.columns import ForeignFile, Stated, descriptions, located
from hums.readers.description import ImportDescription
from hums.readers.time_axis import Import, is_time
from hums.records.fields import CANONICAL_UNITS, UNITS, RecordError, utc_text
from hums.records.quantities import SPELLINGS


def draft(file: ForeignFile) -> str:
    r"""Return an import description of a file as TOML, with comments to fill in for what the file does not state.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from hums.readers import read_file
    >>> from hums.readers.draft import draft
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "log.csv")
    ...     _ = path.write_text("time (s),DE (g)\n" + "".join(f"{k / 100},{k}\n" for k in range(9)), encoding="utf-8")
    ...     print(draft(read_file(path)).partition("[units]")[2].split()[:3])
    ['DE', '=', '"g"']
    """
    import tomli_w  # noqa: PLC0415
    from jinja2 import Environment, StrictUndefined  # noqa: PLC0415 - heavy

    rows = {
        _named(file, name): math.prod(shape)
        for name, shape in descriptions(file.fields).items()
        if not isinstance(shape, str) and math.prod(shape) == max(shape) > 1 and name.isprintable()
    }
    longest = max(rows.values(), default=0)
    stated = {name: file.metadata(name) for name in rows if not is_time(file, name)}
    units = {name: one.units or "" for name, one in stated.items()}
    full = {name: unit for name, unit in units.items() if rows[name] == longest}
    own = [name for name, one in stated.items() if one.rate_hz is not None or one.times_s is not None]
    known = {name: unit for name, unit in full.items() if unit in CANONICAL_UNITS}
    measured = {name: units[name] for name in (*full, *own) if units.get(name) in SPELLINGS and name not in known}
    unknown = {name: unit for name, unit in full.items() if name not in {**known, **measured}}
    channels = [*known, *unknown]
    rate_hz, recorded_at, no_rate = None, "", ""
    try:
        for clock in map(Import(file=located(file, None), spec=ImportDescription()).of, channels[:1]):
            rate_hz, recorded_at = clock.rate_hz, utc_text(clock.epoch)
    except RecordError as error:
        no_rate = " ".join(str(error).split())
    if not channels:
        raise RecordError(f"{file.path.name} has no row of numbers that could be a channel. {file.contents()}")
    page = Environment(autoescape=False, trim_blocks=True, undefined=StrictUndefined)  # noqa: S701 - no HTML
    return page.from_string(Path(__file__).with_name("draft.toml.jinja").read_text(encoding="utf-8")).render(
        file=file,
        channels=channels,
        known=known,
        unknown=unknown,
        measured=measured,
        rows=rows,
        others=[name for name in rows if name not in {**known, **measured, **unknown}],
        rate_hz=rate_hz,
        no_rate=no_rate,
        recorded_at=recorded_at,
        local=[one.epoch.isoformat() for one in file.stated.values() if one.epoch and one.epoch.tzinfo is None],
        valid_units=", ".join(UNITS),
        line=lambda key, value: tomli_w.dumps({key: value}).strip(),
    )


def _named(file: ForeignFile, name: str) -> str:
    """Return the title of a struct that holds only this array, "vibration_1" for "K001.Y(3).Data"; else the name."""
    title = file.stated.get(name.rpartition(".")[0], Stated()).title
    return title if title and file.name(title) == name else name
