"""Kernels run where compiled code can be written nowhere, and after a change of what they call."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import signals

NOWHERE = "from numba.core import caching; caching.CompileResultCacheImpl._locator_classes = []; "
CALL = "from signals._outer_kernels import outer; print(outer(5.0))"


def test_a_kernel_is_compiled_anew_where_one_in_another_module_that_it_calls_changed(tmp_path):
    """Numba's own cache would run the former one: it looks at the file of the outer kernel alone."""
    hidden = shutil.ignore_patterns("__pycache__")
    package = shutil.copytree(Path(signals.__file__).parent, tmp_path / "signals", ignore=hidden)
    (package / "_outer_kernels.py").write_text(
        "from signals._compile import compiled\nfrom signals._inner_kernels import inner\n\n\n"
        "@compiled\ndef outer(x):\n    return inner(x)\n"
    )
    found = []
    for factor, code in ((2, CALL), (30, CALL), (4, NOWHERE + CALL)):  # sources of other sizes, or Python keeps them
        (package / "_inner_kernels.py").write_text(
            f"from signals._compile import compiled\n\n\n@compiled\ndef inner(x):\n    return {factor} * x\n"
        )
        run = subprocess.run(
            [sys.executable, "-c", code], env=os.environ | {"PYTHONPATH": str(tmp_path)}, cwd=tmp_path, check=True,
            capture_output=True, text=True,
        )  # fmt: skip
        found.append(float(run.stdout))
    assert found == [10.0, 150.0, 20.0]
