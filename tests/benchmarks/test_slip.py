"""The page on a slipping line is made, and shows it: the plain tracker loses the line, the slip tracker does not."""

import slip


def test_the_page_and_its_picture_are_written(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(slip, "REVOLUTIONS", 200)
    assert slip.main(tmp_path) == 0
    report = (tmp_path / "slip.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == report.strip()
    rows = [line.strip("| ").split(" | ") for line in report.splitlines() if line.startswith("| ")][1:]
    plain = [float(error) for tracker, _, error in rows if tracker == "plain"]
    assert len(plain) == len(slip.BANDWIDTHS)
    assert min(plain) > 2 * float(rows[-1][2])
    picture = (tmp_path / "slip.svg").read_text(encoding="utf-8")
    assert picture.count('id="axes_') == 2
