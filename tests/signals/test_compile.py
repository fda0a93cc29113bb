"""Kernels run where compiled code can be written nowhere, and after a change of what they call."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import caching

from signals import _compile


def halved(x):
    return x / 2


@pytest.mark.parametrize(
    "compiled",
    [
        _compile.compiled,
        _compile.compiled_sums,
        _compile.compiled_in_place,
        _compile.compiled_sums_in_place,
        _compile.compiled_exactly,
        _compile.compiled_inline,
    ],
)
def test_without_a_folder_for_compiled_code(compiled, monkeypatch):
    monkeypatch.setattr(caching.CompileResultCacheImpl, "_locator_classes", [])
    with pytest.raises(RuntimeError, match="no locator"):
        caching.FunctionCache(halved)
    assert compiled(halved)(3.0) == 1.5


def test_a_kernel_is_compiled_anew_where_one_in_another_module_that_it_calls_changed(tmp_path):
    """Numba's own cache would run the former one: it looks at the file of the outer kernel alone."""
    package = shutil.copytree(
        Path(_compile.__file__).parent, tmp_path / "signals", ignore=shutil.ignore_patterns("__pycache__")
    )
    (package / "_outer_kernels.py").write_text(
        "from signals._compile import compiled\nfrom signals._inner_kernels import inner\n\n\n"
        "@compiled\ndef outer(x):\n    return inner(x)\n"
    )
    found = []
    for factor in (2, 30):  # sources of equal size and time would be one to Python, too
        (package / "_inner_kernels.py").write_text(
            f"from signals._compile import compiled\n\n\n@compiled\ndef inner(x):\n    return {factor} * x\n"
        )
        code = "from signals._outer_kernels import outer; print(outer(5.0))"
        run = subprocess.run(
            [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": str(tmp_path)}, cwd=tmp_path, check=True,
            capture_output=True, text=True,
        )  # fmt: skip
        found.append(float(run.stdout))
    assert found == [10.0, 150.0]
