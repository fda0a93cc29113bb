"""A page on paper, and the sentence where no browser prints it."""

import shutil

import pytest

from hums.report import pdf


def test_without_a_browser_the_sentence_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(ValueError, match=r"none of chromium, .* is on the PATH; install .*, or open"):
        pdf.write_pdf(tmp_path / "report.html")


def test_a_browser_that_fails_leaves_nothing(monkeypatch, tmp_path):
    monkeypatch.setattr(shutil, "which", lambda _: "/bin/false")
    with pytest.raises(ValueError, match="did not print"):
        pdf.write_pdf(tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []
