"""LabVIEW measurement files, laid out as NI's specification has them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import hums
from hums.records.fields import RecordError, RecordWarning

COUNT, STEP_S = 500, 1 / 1024
WAVES = {"DE": np.round(np.sin(0.3 * np.arange(COUNT)), 6), "tacho": np.arange(COUNT) % 50 / 10}
NONE = {"no_tachometer": True, "time_zone": "UTC"}


HEADER = (
    "LabVIEW Measurement|\nWriter_Version|2\nReader_Version|2\nSeparator|{name}\nDecimal_Separator|{decimal}\n"
    "Multi_Headings|Yes\nX_Columns|{x_columns}\nTime_Pref|Relative\nDate|2024/04/10\nTime|13:06:46.25\n"
    "***End_of_Header***|\n|\n***Start_Special***|\nChannels|99\n***End_Special***|"
)


def segment(separator="\t", decimal=".", x_columns="One", *, time="13:06:46.25", waves=WAVES, x0=0.0):
    """Return the lines of a segment; the entries of its header stand in the columns of the samples."""
    gap = [""] if x_columns == "Multi" else []

    def line(first, *cells):
        spread = [cell for number, cell in enumerate(cells) for cell in [*(gap if number else []), cell]]
        return separator.join([first, *spread, ""]).replace("\0", decimal)

    def number(value):
        return f"{value:.9E}".replace(".", decimal)

    size = len(waves)
    count = max(map(len, waves.values()))
    lines = [
        separator.join(["Channels", str(size)]),
        line("Samples", *(str(len(values)) for values in waves.values())),
        line("Date", *["2024/04/10"] * size),
        line("Time", *[time] * size),
        line("Y_Unit_Label", *["g", "Volts"][:size]),
        line("X_Dimension", *["Time"] * size),
        line("X0", *[number(x0)] * size),
        line("Delta_X", *[number(STEP_S)] * size),
        "***End_of_Header***",
    ]
    if x_columns == "Multi":
        lines.append(separator.join([*(cell for name in waves for cell in ("X_Value", name)), "Comment"]))
    else:
        lines.append(separator.join(["X_Value", *waves, "Comment"]))
    for k in range(count):
        x = "" if x_columns == "No" else number(x0 + k * STEP_S)
        cells = [number(values[k]) if k < len(values) else "" for values in waves.values()]
        several = [cell for value in cells for cell in (x, value)] if x_columns == "Multi" else [x, *cells]
        lines.append(separator.join([*several, "first row" if k == 0 else ""]))
    return [*lines, ""]


def write(path, *segments, form=("\t", ".", "One")):
    separator, decimal, x_columns = form
    header = HEADER.format(name="Tab" if separator == "\t" else "Comma", decimal=decimal, x_columns=x_columns)
    header = header.replace("|", separator)
    path.write_text(
        "\r\n".join([*header.splitlines(), *(line for lines in segments for line in lines)]), encoding="cp1252"
    )
    return path


@pytest.mark.parametrize("form", [("\t", ".", "No"), ("\t", ",", "One"), (",", ".", "One"), ("\t", ",", "Multi")])
def test_channels_units_rate_and_start(tmp_path, form):
    path = write(tmp_path / "a.lvm", segment(*form, x0=0.5), form=form)
    record = hums.convert(
        path, channels=["DE"], tach_waveform="tacho", pulses_per_rev=1, shaft="input", time_zone="UTC"
    )
    assert_allclose(record.DE, WAVES["DE"], atol=1e-9)
    assert (record.DE.attrs["units"], record.attrs["rate_hz"], record.attrs["start_s"]) == ("g", 1024, 0.5)
    assert record.attrs["recorded_at"] == "2024-04-10T13:06:46.250000Z"
    assert record.tachometer.size == COUNT / 50
    with pytest.warns(RecordWarning, match=r"local time 2024-04-10T13:06:46\.250000, which is ignored without time_z"):
        assert hums.convert(path, channels=["DE"], **NONE | {"time_zone": None}).attrs["recorded_at"] == ""
    with pytest.raises(RecordError, match=r"rate_hz=1000 contradicts a\.lvm, which states 1024 Hz"):
        hums.convert(path, channels=["DE"], rate_hz=1000, **NONE)


@pytest.mark.parametrize(("time", "missing"), [("13:06:46.73828125", 0), ("13:06:46.7578125", 20)])
def test_segments_follow_each_other_or_leave_a_gap(tmp_path, time, missing):
    path = write(tmp_path / "a.lvm", segment(), segment(time=time))  # 500 samples at 1024 Hz are 0.48828125 s
    if not missing:
        assert_array_equal(hums.convert(path, channels=["DE"], **NONE).DE, np.tile(WAVES["DE"], 2))
        return
    with pytest.warns(RecordWarning, match="skip 20 samples"):
        record = hums.convert(path, channels=["DE"], **NONE)
    assert_array_equal(record.DE, np.r_[WAVES["DE"], np.full(20, np.nan), WAVES["DE"]])


def test_packets_of_which_only_the_first_has_a_header(tmp_path):
    later = [f"{(COUNT + k) * STEP_S:.9f}\t{value}\t0\t" for k, value in enumerate(WAVES["DE"])]
    path = write(tmp_path / "a.lvm", [*segment(), *later])
    assert_array_equal(hums.convert(path, channels=["DE"], **NONE).DE, np.tile(WAVES["DE"], 2))
