"""MDF files (ASAM, version 4 and earlier): channels in groups, each with its own times."""

from collections import Counter
from pathlib import Path

import numpy as np

from hums.readers.columns import Field, ForeignFile, Stated, phrase_of
from hums.readers.description import ImportDescription


def read(path: Path, _: ImportDescription) -> ForeignFile:
    """Return every channel in physical units, with its units, sample times and the start of the measurement.

    A name that occurs in several groups is preceded by the number of its group, "2.DE". Master channels other than
    time, such as angles, are ignored.
    """
    import asammdf  # noqa: PLC0415

    with asammdf.MDF(path) as contents:
        epoch, signals = contents.start_time, list(contents.iter_channels())
    counts = Counter(signal.name for signal in signals)
    fields, stated = dict[str, Field](), dict[str, Stated]()
    for signal in signals:
        title = signal.name.replace("/", ".")
        name = title if counts[signal.name] == 1 else f"{signal.group_index + 1}.{title}"
        fields[name] = phrase_of(signal.samples.dtype, signal.samples.size) or signal.samples
        over_time = (signal.master_metadata or ("time", 1))[1] == 1  # other masters are angles, distances and indices
        times_s = np.asarray(signal.timestamps, dtype=np.float64) if over_time else None
        stated[name] = Stated(units=signal.unit or None, times_s=times_s, epoch=epoch)
    return ForeignFile(path=path, fields=fields, stated=stated)
