import numpy as np

from signals.monitoring.alarm_life import AlarmRule, Life


def follow(rule, indices, *, state=None):
    state, raised = state or rule.start(), []
    for number, index in enumerate(indices):
        state, now = rule.step(state, np.asarray(index, dtype=float))
        if now:
            raised.append(number)
    return state, raised


class TestRaising:
    def test_two_of_three(self):
        assert follow(AlarmRule(), [1, 0, 0, 1, 0, 1, 1])[1] == [5]
        assert follow(AlarmRule(), [1, 0, 0, 1, 0, 0, 1])[1] == []

    def test_records_that_are_not_judged_do_not_count(self):
        assert follow(AlarmRule(), [1, np.nan, np.nan, np.nan, 1])[1] == [4]

    def test_it_is_latched(self):
        state, raised = follow(AlarmRule(), [1, 1, *[0] * 100, 5, 5])
        assert (state.life, raised) == (Life.RAISED, [1])


def test_twice_the_limit_raises_it_at_once_but_where_a_baseline_had_such_records():
    rule = AlarmRule()
    assert follow(rule, [0.2, 1.9, 0.2, 0.2, 2.1])[1] == [4]
    _, raised = rule.step(rule.start((2,)), np.full(2, 2.1), bursts=np.array([True, False]))
    assert raised.tolist() == [False, True]


class TestAcknowledging:
    RULE = AlarmRule(quiet=3)

    def acknowledged(self):
        state, _ = follow(self.RULE, [1, 1.5])
        return self.RULE.acknowledge(state, np.asarray(True))

    def test_it_clears_after_a_quiet_time_and_is_raised_again(self):
        state, raised = follow(self.RULE, [0.4, 0.6, 0.4, 0.4, 0.4], state=self.acknowledged())
        assert (state.life, raised) == (Life.CLEAR, [])
        assert follow(self.RULE, [1, 1], state=state)[1] == [1]

    def test_it_is_raised_anew_when_it_has_doubled(self):
        assert follow(self.RULE, [2.9, 2.9, 3.1, 3.1], state=self.acknowledged())[1] == [3]

    def test_what_is_clear_cannot_be_acknowledged(self):
        assert self.RULE.acknowledge(self.RULE.start(), np.asarray(True)).life == Life.CLEAR
