"""Every public name has an example that runs, and a signature that a person can read."""

import doctest
import importlib
import inspect
import pydoc
from functools import cache
from typing import Any

import pytest

PACKAGES = (
    "signals",
    "signals.harmonics",
    "signals.indicators",
    "hums",
    "hums.plots",
    "data_synth",
    "data_synth.dynamics",
)
OURS = {package.split(".")[0] for package in PACKAGES}
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def _exports() -> list[Any]:
    """Return (package, name) of every function and class of ours that a package exports, each object once.

    An alias of another package's class (``hums.Analysis`` is ``xarray.DataTree``) has that package's docstring.
    """
    found, seen = [], set()
    for package in PACKAGES:
        module = importlib.import_module(package)
        for name in module.__all__:
            thing = getattr(module, name)
            ours = (inspect.isroutine(thing) or inspect.isclass(thing)) and thing.__module__.split(".")[0] in OURS
            if ours and thing not in seen:
                seen.add(thing)
                found.append(pytest.param(package, name, id=f"{package}.{name}"))
    return found


@cache
def _namespace(package: str) -> dict[str, Any]:
    """Return what the examples of a package's own docstring define: the set-up of those of its members."""
    names: dict[str, Any] = {}
    for example in doctest.DocTestParser().get_examples(importlib.import_module(package).__doc__):
        exec(example.source, names)  # noqa: S102
    return names


@pytest.mark.parametrize(("package", "name"), _exports())
def test_the_example_runs(package: str, name: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    thing = getattr(importlib.import_module(package), name)
    home = importlib.import_module(thing.__module__)
    given = _namespace(package)
    tests = doctest.DocTestFinder(exclude_empty=True).find(thing, name, module=home, globs=given)
    assert tests, "no docstring"
    assert tests[0].name == name
    assert tests[0].examples, "the docstring has no example"
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner(optionflags=FLAGS)
    for test in tests:
        said: list[str] = []
        assert runner.run(test, out=said.append).failed == 0, "".join(said)
    assert not list(tmp_path.iterdir()), "the example leaves files behind"


@pytest.mark.parametrize(("package", "name"), _exports())
def test_the_signature_names_its_types(package: str, name: str) -> None:
    """An alias such as ArrayLike stands there by its name, not by the union that it stands for."""
    thing = getattr(importlib.import_module(package), name)
    text = pydoc.render_doc(thing, renderer=pydoc.plaintext)
    assert "numpy._typing" not in text
    assert "_NestedSequence" not in text
