import numpy as np
import pytest

import hums
from hums.fleet.monitor_settings import MonitorError, MonitorSettings
from hums.fleet.watch import watch


@pytest.fixture(scope="module")
def analysis():
    noise = np.random.default_rng(0).normal(size=8000)
    angle = hums.NominalSpeed(rpm=1200, shaft="input")
    record = hums.make_record({"a": noise}, rate_hz=4000, units="g", angle=angle, machine="mill")
    return hums.analyze(record, hums.load_gearbox("two-stage"), settings=hums.AnalysisSettings(envelope_band_hz=None))


def test_the_state_is_kept_between_calls(analysis, tmp_path):
    settings = MonitorSettings(baseline_records=2)
    found = [watch(analysis, tmp_path / "state", settings=settings) for _ in range(3)]
    assert [one.why for one in found] == ["learning", "learning", ""]
    assert found[2].index["record"] < 1


def test_another_machine_is_refused(analysis, tmp_path):
    watch(analysis, tmp_path / "state")
    other = analysis.copy()
    other.attrs["machine"] = "fan"
    with pytest.raises(MonitorError, match="of machine 'fan' and the state of 'mill'; keep a state for each"):
        watch(other, tmp_path / "state")
