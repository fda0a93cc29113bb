"""Kernels run where compiled code can be written nowhere."""

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
