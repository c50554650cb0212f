"""Lists of messages under way, against sorted lists of Python."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.inference.replay_arrays import clear_inbox, empty_inbox, put_message, take_first

ACTIONS = st.lists(st.tuples(st.integers(0, 2), st.one_of(st.none(), st.integers(1, 9))), max_size=60)


@settings(max_examples=100, deadline=None)
@given(ACTIONS, st.integers(1, 12))
def test_messages_are_read_by_arrival_and_order_of_sending(
    actions: list[tuple[int, int | None]], capacity: int
) -> None:
    """An action puts a message with an arrival tick, or reads the first one."""
    inbox = empty_inbox(3, capacity)
    put_message(inbox, 0, 5, 5)
    clear_inbox(inbox)
    expected: list[list[tuple[int, int]]] = [[], [], []]
    for message, (robot, tick) in enumerate(actions):
        if tick is not None:
            has_room = put_message(inbox, robot, message, tick)
            assert has_room == (sum(map(len, expected)) < capacity)
            if has_room:
                expected[robot] = sorted([*expected[robot], (tick, message)])
        elif expected[robot]:
            first = inbox.first[robot]
            assert (inbox.arrival_tick[first], inbox.message[first]) == expected[robot].pop(0)
            take_first(inbox, robot)
        assert (inbox.first[robot] < 0) == (not expected[robot])
