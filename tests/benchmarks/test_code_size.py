"""Code lines, modules and constants are counted as they are defined."""

from code_size import Size, count, lowered, size_of, total

SOURCE = '''\
"""A module."""

# a comment
LIMIT_DB, _STEP = 3.0, 1
_NAMES: tuple[str, ...] = (
    "a",

    "b",
)
lower = 1


class Thing:
    """A class."""

    size = 1
    """An attribute."""
    INNER = 2

    def test_it(self):
        """A function."""
        LOCAL = """not
a docstring"""
        return LOCAL  # a comment beside code
'''


def test_a_module():
    # assignments 1 + 4 + 1, the class 3, its function 4; LIMIT_DB, _STEP and _NAMES
    assert size_of(SOURCE) == Size(lines=13, modules=1, constants=3, test_functions=1)


def tree(folder):
    for name, lines in {"hums/a.py": 3, "hums/deep/b.py": 2, "hums/deep/c/d.py": 1, "signals/e.py": 5}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('"""Text."""\n' + "x = 1\n" * lines)
    return folder


def test_folders(tmp_path):
    root = tree(tmp_path)
    assert total(root, "hums", "signals") == Size(lines=11, modules=4)
    rows = {"hums (root)": 3, "hums/deep": 3, "hums/deep (root), signals": 7, "all code lines": 11, "all modules": 4}
    assert {row: count(row, root) for row in rows} == rows


def test_ceilings_are_lowered_and_never_raised(tmp_path):
    table = "    hums (root)         9    8    2\n    hums/deep, signals  9    4    2\n"
    table += "    all modules         9   10    3\n"
    expected = table.replace("9    8    2", "9    3    2").replace("9   10    3", "9    4    3")
    assert lowered(f"BEFORE = 12\n{table}", tree(tmp_path)) == f"BEFORE = 12\n{expected}"
