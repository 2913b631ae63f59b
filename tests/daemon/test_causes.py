"""Each cause of a stop has a fixed category or one that a file chooses, never both."""

from daemon.wire.causes import CHOSEN_CATEGORY, FIXED_CATEGORY


def test_no_cause_is_both_fixed_and_chosen():
    assert not set(FIXED_CATEGORY) & set(CHOSEN_CATEGORY)
