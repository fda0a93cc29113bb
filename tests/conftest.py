"""What all tests share: one thread each, one reproducible way to draw examples, and folders."""

import os
from pathlib import Path

import hypothesis
import pytest
from browser import start_browser

# Workers of pytest run side by side; threads of linear algebra beside them would wait for each other.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# The same examples in every run: a test that fails does so for everyone, and no database is left behind; more of them
# would say the same again each time. Nothing is judged by the clock, which on a busy machine says nothing of the test.
hypothesis.settings.register_profile(
    "house",
    derandomize=True,
    max_examples=40,
    database=None,
    deadline=None,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.load_profile("house")


@pytest.hookimpl(wrapper=True)
def pytest_xdist_auto_num_workers():
    """One more than processors: now and then a test waits for processes of its own, a browser or the disk."""
    return (yield) + 1


def pytest_collection_modifyitems(items):
    """Put the longest of the last tests first: workers would wait for the one that runs it."""
    items.sort(key=lambda item: item.path.name != "test_readme.py")


@pytest.fixture(scope="session")
def real_data(pytestconfig):
    """Folder of measured records: HUMS_REAL_DATA, else shared/data beside the project; without either, skip.

    Where the folder beside the project exists, nothing is ever skipped; with HUMS_STRICT=1 a HUMS_REAL_DATA
    that leads nowhere is then a failure rather than passed over.
    """
    beside = pytestconfig.rootpath.parent / "shared" / "data"
    named = Path(os.environ.get("HUMS_REAL_DATA") or beside)
    if named.is_dir():
        return named
    reason = f"no measured records: {named} is no folder; name theirs in HUMS_REAL_DATA"
    if not beside.is_dir():
        pytest.skip(reason)
    if os.environ.get("HUMS_STRICT") == "1":
        pytest.fail(reason)
    return beside


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """Headless Chromium, one for a worker; see tests/browser.py."""
    driver = start_browser(tmp_path_factory.mktemp("profile"))
    yield driver
    driver.quit()
