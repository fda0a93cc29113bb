import pytest

from hums.fleet.observation import FleetError, Work, read_maintenance


def written(tmp_path, text):
    path = tmp_path / "work.csv"
    path.write_text(text, encoding="utf-8")
    return read_maintenance(path)


def test_sorted_by_date(tmp_path):
    found = written(tmp_path, "date,component,machine,action\n2026-04-01,,mill,acknowledged\n2026-03-01,pinion,,\n")
    assert found == (
        Work(date="2026-03-01", component="pinion"),
        Work(date="2026-04-01", machine="mill", action="acknowledged"),
    )


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("component\npinion\n", "column 'date' is missing"),
        ("date,component\nspring,pinion\n", "line 2: date 'spring' is not an ISO 8601 time"),
        (
            "date,component,action\n2026-03-01,pinion,oiled\n",
            "action 'oiled' is unknown; write replaced or acknowledged",
        ),
    ],
)
def test_refusals(tmp_path, text, error):
    with pytest.raises(FleetError, match=error):
        written(tmp_path, text)
