"""What text of other people's may do in a file of ours: nothing."""

import pytest

from hums.records.fields import plain_cell


@pytest.mark.parametrize("cell", ["=1+1", "+A1", "-A1", "@SUM(A1)", "\t=1", '=HYPERLINK("x")'])
def test_a_spreadsheet_runs_no_cell(cell):
    assert plain_cell(cell) == f"'{cell}"


@pytest.mark.parametrize("cell", ["", "mill", "-1.5", "+1e-3", -2.0, None, "a=b"])
def test_other_cells_stay(cell):
    assert plain_cell(cell) == cell
