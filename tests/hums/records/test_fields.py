"""What text of other people's may do in a file of ours: nothing."""

import pytest

from hums.records.fields import file_name, plain_cell


@pytest.mark.parametrize("cell", ["=1+1", "+A1", "-A1", "@SUM(A1)", '=HYPERLINK("x")'])
def test_a_spreadsheet_runs_no_cell(cell):
    assert plain_cell(cell) == f"'{cell}"


@pytest.mark.parametrize("cell", ["", "mill", "-1.5", "+1e-3", -2.0, None, "a=b"])
def test_other_cells_stay(cell):
    assert plain_cell(cell) == cell


@pytest.mark.parametrize("cell", ["\t=1", "a\r=1", "a\n=1", "\x1b[2J", "pr\udcfcf", "\ud800", "\u202egpj"])
def test_a_cell_is_one_line_of_text(cell):
    plain = plain_cell(cell)
    assert plain.isprintable()
    assert not plain.startswith(("=", "+", "-", "@"))


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "con", "aux.h5", "a" * 300, "pr\udcfcf", "..", "", "C:\\a", "ü" * 150]
)
def test_a_name_of_a_file_stays_in_its_folder(name, tmp_path):
    plain = file_name(name)
    (tmp_path / plain).write_text("kept")
    assert [path.name for path in tmp_path.iterdir()] == [plain]
    assert plain.split(".")[0].upper() not in {"CON", "AUX"}
    assert not plain.startswith(".")
