"""Every example runs, every public name has one, and a signature that a person can read."""

import doctest
import importlib
import inspect
import pkgutil
import pydoc
from typing import Any

import pytest
from attacks.call_cases import set_up

PACKAGES = (
    "signals",
    "signals.harmonics",
    "signals.indicators",
    "hums",
    "hums.plots",
    "data_synth",
    "data_synth.dynamics",
)
OURS = tuple(dict.fromkeys(package.split(".")[0] for package in PACKAGES))
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def _modules() -> list[str]:
    """Return every module of ours, but that which runs as a program."""
    paths = {top: importlib.import_module(top).__path__ for top in OURS}
    below = [module.name for top in OURS for module in pkgutil.walk_packages(paths[top], f"{top}.")]
    return [*OURS, *(name for name in below if not name.endswith("__main__"))]


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


@pytest.mark.parametrize("name", _modules())
def test_the_examples_of_a_module_run(name: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    module = importlib.import_module(name)
    monkeypatch.chdir(tmp_path)
    runner, said = doctest.DocTestRunner(optionflags=FLAGS), list[str]()
    for test in doctest.DocTestFinder().find(module, name, globs=set_up(name)):
        runner.run(test, out=said.append)
    assert not said, "".join(said)
    assert not list(tmp_path.iterdir()), "an example leaves files behind"


@pytest.mark.parametrize(("package", "name"), _exports())
def test_a_public_name_has_an_example_and_names_its_types(package: str, name: str) -> None:
    """An alias such as ArrayLike stands in the signature by its name, not by the union that it stands for."""
    thing = getattr(importlib.import_module(package), name)
    assert any(test.examples for test in doctest.DocTestFinder().find(thing, name)[:1]), "no example"
    text = pydoc.render_doc(thing, renderer=pydoc.plaintext)
    assert "numpy._typing" not in text
    assert "_NestedSequence" not in text
