"""The scoreboard prints a row for each outcome and ends with status 1 where a limit does not hold."""

import json
import re

import pytest
import scoreboard
from board.sections import Section
from board.table import Figure, Miss, Row, counted, fixed, same

AT_MOST_2 = fixed(2.0)


def stubbed(value, *, limit=AT_MOST_2, better="less", **about):
    """Return a section of one row whose measurement gives, or raises, a value."""

    def task():
        if isinstance(value, Exception):
            raise value
        return value

    return Section(
        name="stub",
        rows=(Row(name="stub: row", what="a figure that is given", better=better, limit=limit, **about),),
        tasks=lambda _: [task],
        figures=lambda found: {"stub: row": found[0]},
        alone=True,
    )


@pytest.fixture(autouse=True)
def baseline(tmp_path, monkeypatch):
    path = tmp_path / "baseline.json"
    monkeypatch.setattr(scoreboard, "BASELINE", path)
    return path


def printed(capsys, *arguments, **given):
    status = scoreboard.main(["--quick", *arguments], [stubbed(**given)])
    lines = capsys.readouterr().out.splitlines()
    return status, [cell.strip() for cell in lines[2].strip("|").split("|")]


def test_a_row_that_holds(capsys):
    status, cells = printed(capsys, value=Figure(value=1.5))
    assert (status, cells) == (0, ["stub: row", "a figure that is given", "1.5", "-", "at most 2", "yes"])


@pytest.mark.parametrize(("value", "better"), [(2.5, "less"), (1.5, "more")])
def test_a_broken_limit_ends_in_status_1(capsys, value, better):
    status, cells = printed(capsys, value=Figure(value=value), better=better)
    assert (status, cells[-1]) == (1, "**no**")


@pytest.mark.parametrize(("value", "status", "said"), [(3.0, 0, "**no**: as known"), (3.5, 1, "**no**")])
def test_a_known_miss_breaks_only_where_it_is_worse_than_known(capsys, value, status, said):
    given, cells = printed(capsys, value=Figure(value=value), missed=Miss(3.0, "as known"))
    assert (given, cells[-1]) == (status, said)


def test_times_are_judged_in_no_quick_run(capsys):
    status, cells = printed(capsys, value=Figure(value=2.5), timed=True)
    assert (status, cells[2:]) == (0, ["2.5", "-", "-", "-"])
    assert scoreboard.main([], [stubbed(Figure(value=2.5), timed=True)]) == 1


def test_a_measurement_that_fails_ends_in_status_1(capsys):
    status, cells = printed(capsys, value=ValueError("no such record"))
    assert (status, cells[2], cells[-1]) == (1, "failed: ValueError: no such record", "**no**")


def test_figures_that_are_saved_are_what_later_ones_are_held_against(capsys, baseline):
    assert printed(capsys, "--save", value=Figure(value=7, of=9), limit=same, better="more")[0] == 0
    assert "--quick" in json.loads(baseline.read_text())["sizes"]["quick"]["command"]
    status, cells = printed(capsys, value=Figure(value=6, of=9), limit=same, better="more")
    assert (status, cells[2:]) == (1, ["6 of 9", "7 of 9", "at least 7", "**no**"])


def test_the_limit_of_a_count_holds_for_other_records_of_the_same_tree():
    # 90 of 100 right: 1 % of a binomial of that share lie below 82 (R: qbinom(0.01, 100, 90.5 / 101))
    assert counted("more")(Figure(value=0, of=100), Figure(value=90, of=100)) == pytest.approx(82, abs=1)
    assert counted("less")(Figure(value=0, of=20), Figure(value=0, of=20)) >= 1


def test_rows_have_names_of_their_own_and_documented_figures():
    rows = [row for section in scoreboard.SECTIONS for row in section.rows]
    assert len({row.name for row in rows}) == len(rows)
    page = (scoreboard.Path(scoreboard.__file__).parents[1] / "docs" / "benchmarks" / "scoreboard.md").read_text()
    assert {row.name for row in rows} == set(re.findall(r"^\| ([^|]+?) \|", page, re.MULTILINE)) - {"row", "---"}
