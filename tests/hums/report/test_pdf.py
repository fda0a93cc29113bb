"""A page on paper, and the sentence where no browser prints it."""

import shutil

import pytest

from hums.pages.page import stand_alone_page
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


def test_a_page_is_printed(tmp_path):
    if not shutil.which("chromium"):
        pytest.skip("needs chromium (Debian: apt-get install chromium)")
    page = tmp_path / "report.html"
    page.write_text(stand_alone_page(title="P", body="<h1>on paper</h1>"), encoding="utf-8")
    from pypdf import PdfReader  # noqa: PLC0415

    assert "on paper" in PdfReader(pdf.write_pdf(page)).pages[0].extract_text()
