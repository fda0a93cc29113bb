"""What work costs, counted: the same on every machine, busy or not."""

import sys


def calls(action):
    """Return how many functions are called while `action()` runs, in Python and in C, in this thread.

    A loop over samples or over pairs shows as calls by the thousand; what compiled code and one call of numpy do
    within counts as one.
    """
    count = 0

    def profile(_frame, event, _argument):
        nonlocal count
        count += event in {"call", "c_call"}

    before = sys.getprofile()
    sys.setprofile(profile)
    try:
        action()
    finally:
        sys.setprofile(before)
    return count


def recorded(monkeypatch, owner, name):
    """Return a list to which every call of `owner.name` from now on adds its arguments (positional, by name)."""
    found, original = [], getattr(owner, name)

    def passed_on(*positional, **named):
        found.append((positional, named))
        return original(*positional, **named)

    monkeypatch.setattr(owner, name, passed_on)
    return found
