"""What tests of the command line share."""

import sys

import pytest

from hums.cli import main


@pytest.fixture
def run(monkeypatch, capsys):
    """Run `hums ...` and return exit code, standard output and standard error."""

    def command(*words):
        monkeypatch.setattr(sys, "argv", ["hums", *map(str, words)])
        code = main()
        out, err = capsys.readouterr()
        return code, out, err

    return command
