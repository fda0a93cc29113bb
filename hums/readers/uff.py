"""Universal files (UFF): time histories in data sets of type 58."""

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hums.readers.columns import Field, ForeignFile, Stated, moment_of, rate_of_step
from hums.readers.description import ImportDescription
from hums.records.clock import time_scale
from hums.records.fields import RecordError


def read(path: Path, _: ImportDescription) -> ForeignFile:
    """Return every function by its response degree of freedom: entity, if named, node and direction, "case 3+Z".

    Functions of the same degree of freedom are numbered by data set, "3+Z (2)". An evenly spaced abscissa of times
    states the rate and the start; text files print its step with six digits, so a declared rate may be more precise. An
    unevenly spaced one states the time of each sample. Units are the label of the ordinate.

    Raises
    ------
    RecordError
        If the file is truncated.
    """
    import pyuff  # noqa: PLC0415

    found = pyuff.UFF(str(path)).read_sets()
    sets = [entry for entry in (found if isinstance(found, list) else [found]) if entry]
    if not sets:
        raise RecordError(f"{path} is not a universal file with a complete data set. Export it again.")
    function = 58
    functions = [entry for entry in sets if entry.get("type") == function]
    with path.open("rb") as stream:
        stream.seek(-min(path.stat().st_size, 4096), os.SEEK_END)
        complete = stream.read().rstrip().endswith(b"-1")
    if not complete or any(entry["num_pts"] != len(entry["data"]) for entry in functions):
        raise RecordError(f"{path} is damaged: its last part is cut off. Copy it again from its source.")
    names = _names(functions)
    return ForeignFile(
        path=path,
        fields={name: _field(entry) for name, entry in zip(names, functions, strict=True)},
        stated={name: _stated(entry) for name, entry in zip(names, functions, strict=True)},
    )


def _names(functions: list[Mapping[str, Any]]) -> list[str]:
    dofs = [_response_dof(entry) for entry in functions]
    counts = Counter(dofs)
    return [dof if counts[dof] == 1 else f"{dof} ({number})" for number, dof in enumerate(dofs, start=1)]


def _response_dof(entry: Mapping[str, Any]) -> str:
    """Return entity, node and direction; the number of a direction, 1 to 6, is negative if opposite to its axis."""
    direction = int(entry["rsp_dir"])
    directions = ("", "+X", "+Y", "+Z", "+RX", "+RY", "+RZ")
    axis = directions[abs(direction)] if abs(direction) < len(directions) else f" direction {direction}"
    entity = _label(entry["rsp_ent_name"])
    dof = f"{int(entry['rsp_node'])}{axis.replace('+', '-') if direction < 0 else axis}"
    return f"{entity} {dof}".replace("/", ".") if entity else dof


def _field(entry: Mapping[str, Any]) -> Field:
    values = np.asarray(entry["data"])
    time_response = 1
    if entry["func_type"] != time_response or values.dtype.kind == "c":
        return f"a function of type {entry['func_type']}, no time history"
    return values if values.size else "empty"


def _stated(entry: Mapping[str, Any]) -> Stated:
    units, written = _label(entry["ordinate_axis_units_lab"]), _label(entry["id3"])
    began = moment_of(written)
    notes = (f'states "{written}", which is no date and time',) if written and not began else ()
    stated = Stated(units=units, epoch=began, notes=notes)
    over_time = 17  # specific data type of an abscissa in seconds
    if entry["abscissa_spec_data_type"] != over_time:
        return stated
    step_s, epoch = time_scale(_label(entry["abscissa_axis_units_lab"])) or (1.0, None)
    stated = replace(stated, epoch=epoch or began)
    if entry["abscissa_spacing"] != 1:
        return replace(stated, times_s=step_s * np.asarray(entry["x"], dtype=np.float64))
    rate_hz = rate_of_step(step_s * entry["abscissa_inc"])
    return replace(stated, rate_hz=rate_hz, start_s=step_s * float(entry["abscissa_min"]) if rate_hz else None)


def _label(text: object) -> str | None:
    """Return a label; None if blank or the word NONE."""
    label = str(text).strip()
    return None if label.upper() in {"", "NONE"} else label
