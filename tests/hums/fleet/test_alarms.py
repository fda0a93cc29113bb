import math

from hums.fleet.alarms import Alarm


def follow(indices, alarm=None, *, bursts=False):
    alarm, raised = alarm or Alarm(), []
    for number, index in enumerate(indices):
        if alarm.step(index, bursts=bursts):
            alarm.row = {"state": "raised", "value": index}
            raised.append(number)
    return alarm, raised


class TestRaising:
    def test_two_of_three(self):
        assert follow([1, 0, 0, 1, 0, 1, 1])[1] == [5]
        assert follow([1, 0, 0, 1, 0, 0, 1])[1] == []

    def test_records_that_are_not_judged_do_not_count(self):
        assert follow([1, math.nan, math.nan, math.nan, 1])[1] == [4]

    def test_it_is_latched(self):
        alarm, raised = follow([1, 1, *[0] * 100, 5, 5])
        assert (alarm.state, raised) == ("raised", [1])

    def test_twice_the_limit_raises_it_at_once_but_where_a_baseline_had_such_records(self):
        assert follow([0.2, 1.9, 0.2, 0.2, 2.1])[1] == [4]
        assert follow([0.2, 1.9, 0.2, 0.2, 2.1], bursts=True)[1] == []


class TestAcknowledging:
    def acknowledged(self):
        alarm, _ = follow([1, 1.5])
        assert alarm.acknowledge()
        return alarm

    def test_it_clears_after_a_quiet_time_and_is_raised_again(self):
        alarm, raised = follow([0.4, 0.6, *[0.4] * 10], self.acknowledged())
        assert (alarm.state, raised) == ("cleared", [])
        assert follow([1, 1], alarm)[1] == [1]

    def test_it_is_raised_anew_when_it_has_doubled(self):
        assert follow([2.9, 2.9, 3.1, 3.1], self.acknowledged())[1] == [3]

    def test_what_is_clear_cannot_be_acknowledged(self):
        alarm = Alarm()
        assert not alarm.acknowledge()
        assert alarm.state == "clear"
