"""Kernels run where compiled code can be written nowhere."""

import pytest
from numba.core import caching

from data_synth import _compile as of_data_synth
from signals import _compile as of_signals


def halved(x):
    return x / 2


@pytest.mark.parametrize(
    "compiled",
    [
        of_signals.compiled,
        of_signals.compiled_sums,
        of_signals.compiled_in_place,
        of_signals.compiled_sums_in_place,
        of_data_synth.compiled,
    ],
)
def test_without_a_folder_for_compiled_code(compiled, monkeypatch):
    monkeypatch.setattr(caching.CompileResultCacheImpl, "_locator_classes", [])
    with pytest.raises(RuntimeError, match="no locator"):
        caching.FunctionCache(halved)
    assert compiled(halved)(3.0) == 1.5
