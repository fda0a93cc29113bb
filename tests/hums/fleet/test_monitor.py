import math
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from fleets import FIRST, HEALTHY, PINION, alarms, followed, items, observed, valued

from hums.fleet.monitor import Alarm
from hums.fleet.observation import FleetError, MonitorSettings, Observation, Work
from hums.fleet.series import Series, prior_of

JOINT = {"stage 1/pinion": "one of A, B"}


def with_verdict(number):
    return replace(observed(number), diagnosed=("stage 1/wheel",))


class TestAlarms:
    def test_a_component_that_rises_raises_one_alarm(self):
        state, found = followed([*HEALTHY, *(observed(number, **PINION | {"shift": 2.0}) for number in range(40, 50))])
        assert [one.why for one in found[:20]] == ["learning"] * 20
        (alarm,) = alarms(found)
        # beyond twice the limit at once
        assert (alarm["component"], alarm["record"], alarm["severity"]) == ("stage 1/pinion", "record 40", "severe")
        assert alarm["since"][:10] == "2026-04-10"  # the day of record 40
        assert alarm["baseline"] == state.epochs[""].identity
        assert len(alarm["baseline"]) == 12
        assert found[-1].index["stage 1/pinion"] > 1 > found[-1].index["stage 2/wheel"]

    @pytest.mark.parametrize("seed", range(6))
    def test_a_jump_of_eight_deviations_after_ten_records_alarms_by_its_second_record(self, seed):
        keys = [
            Series(channel=channel, component=f"part {part}", kind="gear", indicator=f"ratio {number}", unit="1")
            for channel in "ab"
            for part in range(20)
            for number in range(3)
        ]
        rng, seen = np.random.default_rng(seed), []
        for number in range(20):
            values = {key: 0.2 * rng.standard_normal() for key in keys}  # as machines usually scatter
            values |= {key: values[key] + 1.6 for key in keys if number >= 15 and key.component == "part 3"}
            when = (FIRST + timedelta(days=number)).isoformat()
            seen.append(Observation(machine="mill", record=str(number), recorded_at=when, values=valued(values)))
        (alarm,) = alarms(followed(seen, settings=MonitorSettings(baseline_records=10))[1])
        assert alarm["component"] == "part 3"
        assert int(alarm["record"]) <= 16

    def test_an_alarm_that_stands_keeps_its_time(self):
        rising = [observed(number, **(PINION if number in (40, 41, 240, 241) else {})) for number in range(40, 242)]
        state, found = followed([*HEALTHY, *rising])
        assert len(alarms(found)) == 1
        assert state.alarms["stage 1/pinion"].since[:10] == "2026-04-10"  # the day of record 40

    def test_what_is_diagnosed_raises_one_by_two_of_three_whatever_the_charts_say(self):
        _, found = followed([*HEALTHY, with_verdict(40), observed(41), with_verdict(42), observed(43)])
        (alarm,) = alarms(found)
        assert (alarm["component"], alarm["record"], alarm["since"][:10]) == (
            "stage 1/wheel",
            "record 42",
            "2026-04-10",
        )
        assert (alarm["severity"], alarm["value"]) == ("verdict", 1.0)
        assert alarm["indicator"].startswith("diagnosed; ")
        assert alarms(followed([*HEALTHY, with_verdict(40), observed(41), observed(42), with_verdict(43)])[1]) == []

    def test_a_baseline_that_holds_a_diagnosed_part_says_so(self):
        before = [with_verdict(n) if n in (5, 7) else one for n, one in enumerate(HEALTHY)]
        (alarm,) = alarms(followed(before)[1])
        assert (alarm["record"], alarm["severity"], alarm["baseline"]) == ("record 7", "verdict", "")
        last = [with_verdict(n) if n == 19 else one for n, one in enumerate(HEALTHY[:20])]
        (alarm,) = alarms(followed([*last, with_verdict(20)])[1])
        assert (alarm["record"], alarm["severity"]) == ("record 20", "verdict")
        assert alarm["indicator"].startswith("diagnosed, as in its baseline; ")

    def test_a_verdict_at_a_speed_that_was_not_learned_counts(self):
        fast = [replace(with_verdict(n), covariates={"speed_hz": 40.0}) for n in (40, 41)]
        _, found = followed([*HEALTHY, *fast])
        assert not found[-1].judged
        assert [alarm["severity"] for alarm in alarms(found)] == ["verdict"]

    def test_running_in_raises_none(self):
        course = [observed(number, component="stage 1/pinion", shift=-min(number, 60) / 60) for number in range(120)]
        assert alarms(followed(course)[1]) == []

    def test_a_gain_is_the_sensors(self):
        rises = [*HEALTHY, *(observed(number, gain=(number - 40) / 40) for number in range(40, 100))]
        assert {alarm["component"] for alarm in alarms(followed(rises)[1])} == {"sensor a", "sensor b"}
        falls = [*HEALTHY, *(observed(number, gain=-2.0) for number in range(40, 50))]
        found = alarms(followed(falls)[1])
        assert {alarm["component"] for alarm in found} == {"sensor a", "sensor b"}
        assert {(alarm["indicator"], alarm["severity"]) for alarm in found} == {("level falls suddenly", "sensor")}


class TestRegimes:
    """Two flight regimes by turns, 40 deviations apart; the baseline has 20 records of each."""

    @staticmethod
    def flown(number, *, regime="", **fault):
        regime = regime or ("hover", "cruise")[number % 2]
        seen = observed(number, **fault)
        level = 4.0 * (regime == "cruise")
        return replace(seen, regime=regime, values=valued({key: value + level for key, value in items(seen)}))

    def flights(self, stop):
        return [self.flown(number) for number in range(stop)]

    def test_each_has_its_own_normal(self):
        _, found = followed(self.flights(140))
        assert [one.judged for one in found] == [False] * 40 + [True] * 100
        assert alarms(found) == []

    @pytest.mark.parametrize("regime", ["hover", "cruise"])
    def test_a_fault_that_shows_in_one_of_them_raises_an_alarm(self, regime):
        faulty = [
            self.flown(n, **(PINION | {"shift": 2.0} if n % 2 == ("hover", "cruise").index(regime) else {}))
            for n in range(60, 64)
        ]
        _, found = followed([*self.flights(60), *faulty])
        (alarm,) = alarms(found)
        assert alarm["component"] == "stage 1/pinion"
        assert alarm["record"] == ("record 60" if regime == "hover" else "record 61")

    def test_one_that_the_baseline_lacks_is_refused_by_its_name(self):
        state, found = followed([*self.flights(60), *(self.flown(n, regime="autorotation") for n in range(60, 63))])
        assert {one.why for one in found[60:]} == {"regime 'autorotation' is not in the baseline"}
        assert state.unwatched_since[:10] == "2026-04-30"  # the day of record 60
        assert followed([self.flown(63)], state=state)[1][0].judged

    def test_a_verdict_counts_in_one_that_the_baseline_lacks(self):
        shown = [replace(with_verdict(n), regime="autorotation") for n in (60, 61)]
        (alarm,) = alarms(followed([*self.flights(60), *shown])[1])
        assert (alarm["component"], alarm["severity"]) == ("stage 1/wheel", "verdict")

    def test_a_replacement_begins_anew_in_all(self):
        work = [Work(date=(FIRST + timedelta(days=59.5)).isoformat(), machine="mill", component="stage 1/pinion")]
        later = [self.flown(n, **PINION | {"shift": 3.0}) for n in range(60, 120)]  # another level, the new part's
        state, found = followed([*self.flights(60), *later], work=work)
        assert alarms(found) == []
        assert "stage 1/pinion" in found[-1].index
        assert [len(epoch.records) for epoch in state.baselines] == [20] * 4


class TestCauses:
    """A second gear that rises less than the first; its shift is that of all its series, as impacts of a part give."""

    def both(self, numbers, *, wheel, diagnosed=()):
        for number in numbers:
            one, other = (
                observed(number, **PINION | {"shift": 2.0}),
                observed(number, component="stage 1/wheel", shift=wheel),
            )
            values = dict(items(one)) | {key: x for key, x in items(other) if key.component == "stage 1/wheel"}
            yield replace(one, values=valued(values), diagnosed=diagnosed)

    def test_what_rises_less_follows_from_the_standing_alarm(self):
        _, found = followed([*HEALTHY, *self.both(range(40, 46), wheel=1.0)])
        (alarm,) = alarms(found)
        assert (alarm["component"], alarm["consequences"]) == ("stage 1/pinion", "stage 1/wheel")
        assert found[-1].index["stage 1/wheel"] > 1

    def test_what_a_verdict_names_alarms_for_itself(self):
        _, found = followed([*HEALTHY, *self.both(range(40, 46), wheel=1.0, diagnosed=("stage 1/wheel",))])
        assert [alarm["component"] for alarm in alarms(found)] == ["stage 1/wheel", "stage 1/pinion"]

    def test_what_is_twice_as_large_alarms_for_itself(self):
        _, found = followed([*HEALTHY, *self.both(range(40, 44), wheel=0.0), *self.both(range(44, 48), wheel=8.0)])
        assert [alarm["component"] for alarm in alarms(found)] == ["stage 1/pinion", "stage 1/wheel"]

    def test_what_goes_on_after_the_cause_is_replaced_alarms_then(self):
        rising = list(self.both(range(40, 46), wheel=1.0))
        later = [observed(number, component="stage 1/wheel", shift=1.0) for number in range(47, 52)]
        work = (Work(machine="mill", component="stage 1/pinion", date=observed(46).recorded_at, action="replaced"),)
        state, found = followed([*HEALTHY, *rising, *later], work=work)
        assert [alarm["component"] for alarm in alarms(found)] == ["stage 1/pinion", "stage 1/wheel"]
        assert [row["component"] for row in state.standing.values()] == ["stage 1/wheel"]


def ranking(alarm):
    """The other explanations of an alarm, with their numbers."""
    return {
        what: float(value)
        for what, _, value in (one.rpartition(" ") for one in alarm["other_explanations"].split("; "))
    }


class TestExplanations:
    def test_all_kinds_stand_in_the_row_of_an_alarm(self):
        (alarm,) = alarms(followed([*HEALTHY, *(observed(number, **PINION) for number in range(40, 46))])[1])
        others = ranking(alarm)
        assert {"unknown", "regime", "sensor a", "sensor b"} <= set(others)
        assert list(others.values()) == sorted(others.values(), reverse=True)
        assert max(others.values()) < 0  # the part's whole change is what it predicts

    def test_a_change_that_maintenance_of_another_part_precedes_may_be_its(self):
        course = [*HEALTHY, *(observed(number, **PINION) for number in range(40, 46))]
        after = [
            ranking(alarms(followed(course, work=[Work(date=f"2026-{day}", component="stage 2/wheel")])[1])[0])
            for day in ("04-09T12:00", "04-01T12:00")  # before the first record of the change, and nine records earlier
        ]
        near, far = (next(value for what, value in one.items() if what.startswith("maintenance")) for one in after)
        assert near - far == pytest.approx(np.log(17), abs=1.0)  # of 21 records, within 0 or 8 on either side
        assert near > after[0]["unknown"] > far - 2

    def test_the_part_that_explains_the_change_is_named_where_another_reaches_its_limit(self):
        # impacts of the pinion show in the envelope at the rate of its shaft, of which it is the only gear
        joint = "one of input, stage 1/pinion"
        keys = [
            Series(channel=channel, component=name, kind=kind, indicator=f"{kind} {what}", unit="1")
            for channel in "ab"
            for name, kind in ((joint, "shaft"), ("stage 1/pinion", "gear"), ("input", "shaft"), ("output", "shaft"))
            for what in ("line_level", "line_over_background")
        ]
        seen = []
        for number in range(50):
            rng = np.random.default_rng(number)
            values = {key: 0.1 * rng.standard_normal() + (number >= 40 and key.component == joint) for key in keys}
            when = (FIRST + timedelta(days=number)).isoformat()
            seen.append(Observation(machine="mill", record=str(number), recorded_at=when, values=valued(values)))
        (alarm,) = alarms(followed(seen)[1])
        assert (alarm["component"], alarm["consequences"]) == ("stage 1/pinion", joint)
        assert alarm["indicator"].startswith("shaft line")

    def test_an_acknowledged_alarm_lasts_as_long_as_its_consequences(self):
        state, _ = followed([*HEALTHY, *(observed(number, **PINION) for number in range(40, 46))])
        state.alarms["stage 1/pinion"].follow("stage 1/wheel")
        later = [observed(number, component="stage 1/wheel", shift=0.7) for number in range(46, 130)]
        work = [Work(date="2026-04-15T18:00", action="acknowledged")]
        followed(later, state=state, work=work)
        assert state.alarms["stage 1/pinion"].state == "acknowledged"


def test_weak_evidence_of_one_part_of_a_bearing_adds_up_to_one_alarm():
    rng = np.random.default_rng(0)
    keys = [
        Series(channel=channel, component="bearing", kind=kind, indicator=indicator, unit="1")
        for channel in "ab"
        for kind in ("inner_race", "outer_race")
        for indicator in ("defect_energy_ratio", "envelope line_over_background", "modulation")
    ]
    usual = dict.fromkeys(keys, 0.3)
    seen = []
    for number in range(130):
        values = {key: std * rng.standard_normal() for key, std in usual.items()}
        for key in keys:
            if number >= 60 and key.kind == "outer_race" and key.indicator == "modulation":
                values[key] += 1.5 * usual[key]
        seen.append(Observation(machine="mill", record=str(number), values=valued(values)))
    state, found = followed(seen, settings=MonitorSettings(baseline_records=30))
    (alarm,) = alarms(found)
    assert (alarm["component"], alarm["severity"]) == ("bearing", "alarm")
    assert 60 < int(alarm["record"]) < 100
    assert alarm["indicator"].startswith("outer_race modulation")
    assert max(one.scores["bearing"] for one in found[30:]) < state.epochs[""].limits.limits[0, 0]  # no record


class TestGate:
    def test_other_speeds_are_refused(self):
        state, found = followed(
            [*HEALTHY, observed(40, speed_hz=40.0, **PINION), observed(41, speed_hz=40.0, **PINION)]
        )
        assert not found[-1].judged
        assert found[-1].why.startswith("speed_hz = ")
        assert (state.judged, state.refused, state.unwatched_since[:10]) == (20, 2, "2026-04-10")
        followed([observed(42)], state=state)
        assert state.unwatched_since == ""

    def test_a_sick_sensor_raises_its_own_alarm_and_no_other(self):
        faulty = [replace(observed(number, faulty=("a",)), values=valued({})) for number in range(40, 44)]
        _, found = followed([*HEALTHY, *faulty])
        (alarm,) = alarms(found)
        assert (alarm["component"], alarm["indicator"], alarm["record"]) == ("sensor a", "health: clipped", "record 41")

    def test_a_record_without_results_is_refused(self):
        _, found = followed([*HEALTHY, Observation(machine="mill", record="broken", unjudged="not analysed")])
        assert (found[-1].judged, found[-1].why) == (False, "not analysed")

    def test_a_speed_at_which_normal_cannot_be_foretold_is_refused(self):
        narrow = [
            replace(one, covariates={"speed_hz": 20.0 * (1 + 1e-4 * np.sin(n))}) for n, one in enumerate(HEALTHY[:30])
        ]
        steep = []
        for one in narrow:
            rise = 800 * np.log(one.covariates["speed_hz"] / 20)
            steep.append(replace(one, values=valued({key: value + rise for key, value in items(one)})))
        settings = MonitorSettings(baseline_records=30)
        near, far = (replace(observed(40), covariates={"speed_hz": 20.0 * (1 + away)}) for away in (1e-4, 5e-3))
        assert followed([*steep, near], settings=settings)[1][-1].judged
        assert followed([*steep, far], settings=settings)[1][-1].why.startswith("speed_hz too far")
        assert followed([*narrow, far], settings=settings)[1][-1].judged  # nothing depends on it


class TestBaseline:
    def test_a_few_bad_records_do_not_hide_a_fault(self):
        bad = [observed(n, component="stage 1/pinion", shift=5.0) if n in (3, 11) else observed(n) for n in range(40)]
        _, found = followed([*bad, *(observed(number, **PINION) for number in range(40, 50))])
        assert [alarm["component"] for alarm in alarms(found)] == ["stage 1/pinion"]

    def test_of_a_span_and_of_names(self):
        span = MonitorSettings(baseline_from="2026-03-05", baseline_until="2026-03-24T12:00:00Z")
        state, _ = followed(HEALTHY, settings=span)
        assert state.epochs[""].records == tuple(f"record {number}" for number in range(4, 24))
        named = MonitorSettings(healthy=tuple(f"record {number}" for number in range(3, 23)))
        state, found = followed(HEALTHY, settings=named)
        assert (len(state.epochs[""].records), found[22].judged, found[23].judged) == (20, False, True)

    def test_the_identity_follows_from_what_was_learned(self):
        same, other = followed(HEALTHY)[0], followed([observed(number, seed=1) for number in range(40)])[0]
        assert followed(HEALTHY)[0].epochs[""].identity == same.epochs[""].identity != other.epochs[""].identity

    def test_records_of_one_state_count_less(self):
        near = [
            replace(one, recorded_at=(FIRST + timedelta(seconds=10 * number)).isoformat())
            for number, one in enumerate(HEALTHY)
        ]
        apart, close = (followed(seen)[0].epochs[""] for seen in (HEALTHY, near))
        # 20 records a day apart weigh 18 (a mean and a slope are theirs), and the usual deviation 10
        usual = prior_of(apart.series, apart.normal.layout, apart.normal.raw.center).series[0]
        for epoch, weights in ((apart, (15, 18)), (close, (1, 9))):
            high, low = (np.sqrt((weight * 0.1**2 + 10 * usual**2) / (weight + 10)) for weight in weights)
            assert 0.95 * low < np.median(epoch.normal.series.scale) < 1.05 * high
        assert (close.limits.limits > apart.limits.limits).all()

    @pytest.mark.parametrize("seed", range(4))
    def test_a_short_run_whose_level_trebles_alarms(self, seed):
        course = [0.0] * 7 + list(np.linspace(0, np.log(3), 12)) + [np.log(3)] * 5  # every 100 s
        rng, seen = np.random.default_rng(seed), []
        key = {"channel": "a", "component": "record", "kind": "channel", "unit": "g"}
        for number, level in enumerate(course):
            bands = {f"rms {band}": level + 0.05 * rng.standard_normal() for band in range(4)}
            values = {Series(indicator=name, **key): value for name, value in bands.items()}
            when = (FIRST + timedelta(seconds=100 * number)).isoformat()
            seen.append(Observation(machine="mill", record=str(number), recorded_at=when, values=valued(values)))
        _, found = followed(seen, settings=MonitorSettings(baseline_records=7))
        assert [alarm["component"] for alarm in alarms(found)] == ["record"]

    @pytest.mark.parametrize(("ratio", "rise", "alarmed"), [(100.0, 2.2, True), (1.4, 2.2, False), (100.0, 1.2, False)])
    def test_a_strong_line_that_doubles_after_five_records_alarms(self, ratio, rise, alarmed):
        # of 26 components; noise scatters a line by 1 / (ratio sqrt(2)), the load by 5 %
        rng, seen = np.random.default_rng(3), []
        keys = {"channel": "a", "kind": "gear_mesh"}
        for number in range(14):
            values = {}
            for n in range(26):
                level = 0.05 * rng.standard_normal() + rng.standard_normal() / ratio / np.sqrt(2)
                level += np.log(rise) if n == 0 and number >= 8 else 0.0
                of = keys | {"component": f"stage {n}"}
                values[Series(indicator="order_spectrum line_level", unit="g", **of)] = level
                over = np.log(ratio) + level + 0.05 * rng.standard_normal()
                values[Series(indicator="order_spectrum line_over_background", unit="1", **of)] = over
            when = (FIRST + timedelta(days=number)).isoformat()
            seen.append(Observation(machine="mill", record=str(number), recorded_at=when, values=valued(values)))
        state, found = followed(seen, settings=MonitorSettings(baseline_records=5))
        assert [alarm["component"] for alarm in alarms(found)] == (["stage 0"] if alarmed else [])
        assert (state.epochs[""].alarm_from("stage 0") < rise) == alarmed

    def test_refusals(self):
        with pytest.raises(FleetError, match="a deviation needs at least 2 records"):
            MonitorSettings(baseline_records=1)
        with pytest.raises(FleetError, match="is not an ISO 8601 time, as 2026-03-01"):
            MonitorSettings(baseline_until="last spring")


class TestMaintenance:
    COURSE = (*HEALTHY, *(observed(number, **PINION) for number in range(40, 90)))

    def test_a_replaced_component_is_learned_anew_and_the_others_are_not(self):
        work = [Work(date="2026-04-20", component="stage 1/pinion")]
        state, found = followed(self.COURSE, work=work)
        assert [alarm["state"] for alarm in alarms(found)] == ["cleared"]
        assert state.alarms.get("stage 1/pinion", Alarm()).state != "raised"
        assert state.epochs["stage 1/pinion"].records[0] == "record 50"  # of 20 April
        assert "stage 1/pinion" not in found[60].index
        assert "stage 2/wheel" in found[60].index
        assert found[-1].index["stage 1/pinion"] < 1

    @pytest.mark.parametrize("component", ["A", "B", "one of A, B"])
    def test_of_one_of_two_that_cannot_be_told_apart_both_are_learned_anew(self, component):
        course = [
            replace(seen, values=valued({key._replace(component=JOINT.get(key.component, key.component)): x
                                          for key, x in items(seen)}))
            for seen in self.COURSE
        ]  # fmt: skip
        (alarm,) = alarms(followed(course)[1])
        assert alarm["component"] == "one of A, B"
        state, found = followed(course, work=[Work(date="2026-04-20", component=component)])
        assert [alarm["state"] for alarm in alarms(found)] == ["cleared"]
        assert "one of A, B" not in found[60].index
        assert found[-1].index["one of A, B"] < 1
        assert len(state.epochs) == 2

    def test_of_another_machine_does_nothing(self):
        state, _ = followed(self.COURSE, work=[Work(date="2026-04-20", machine="fan")])
        assert len(state.epochs[""].records) == 20
        assert state.alarms["stage 1/pinion"].state == "raised"

    def test_an_acknowledged_alarm_clears_when_it_is_quiet(self):
        healed = [*self.COURSE[:50], *(observed(number) for number in range(50, 140))]
        work = [Work(date="2026-04-19", action="acknowledged")]
        assert followed(healed)[0].alarms["stage 1/pinion"].row["state"] == "raised"
        assert followed(healed, work=work)[0].alarms["stage 1/pinion"].row["state"] == "cleared"


def stepped(indices, alarm=None, *, bursts=False):
    alarm, raised = alarm or Alarm(), []
    for number, index in enumerate(indices):
        if alarm.step(index, bursts=bursts):
            alarm.row = {"state": "raised", "value": index}
            raised.append(number)
    return alarm, raised


class TestRaising:
    def test_two_of_three(self):
        assert stepped([1, 0, 0, 1, 0, 1, 1])[1] == [5]
        assert stepped([1, 0, 0, 1, 0, 0, 1])[1] == []

    def test_records_that_are_not_judged_do_not_count(self):
        assert stepped([1, math.nan, math.nan, math.nan, 1])[1] == [4]

    def test_it_is_latched(self):
        alarm, raised = stepped([1, 1, *[0] * 100, 5, 5])
        assert (alarm.state, raised) == ("raised", [1])

    def test_twice_the_limit_raises_it_at_once_but_where_a_baseline_had_such_records(self):
        assert stepped([0.2, 1.9, 0.2, 0.2, 2.1])[1] == [4]
        assert stepped([0.2, 1.9, 0.2, 0.2, 2.1], bursts=True)[1] == []


class TestAcknowledging:
    def acknowledged(self):
        alarm, _ = stepped([1, 1.5])
        alarm.acknowledge()
        assert alarm.state == "acknowledged"
        return alarm

    def test_it_clears_after_a_quiet_time_and_is_raised_again(self):
        alarm, raised = stepped([0.4, 0.6, *[0.4] * 10], self.acknowledged())
        assert (alarm.state, raised) == ("cleared", [])
        assert stepped([1, 1], alarm)[1] == [1]

    def test_it_is_raised_anew_when_it_has_doubled(self):
        assert stepped([2.9, 2.9, 3.1, 3.1], self.acknowledged())[1] == [3]

    def test_what_is_clear_cannot_be_acknowledged(self):
        alarm = Alarm()
        alarm.acknowledge()
        assert alarm.state == "clear"
