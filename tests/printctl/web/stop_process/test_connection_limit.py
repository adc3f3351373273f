"""Connection limit of the stop process, without real sockets."""

from __future__ import annotations

from typing import Any

from printctl.web.stop_process.connection_limit import IDLE_S, KNOWN, TO_SHOW_S, Connection, Places


def came(address: str = "10.0.0.1", since: float = 0.0) -> Connection:
    none: Any = None
    return Connection(none, address, since)


def test_the_oldest_unknown_of_an_address_makes_room_and_others_keep_theirs() -> None:
    places = Places(8)
    other = came("10.0.0.2")
    assert places.take(other) is None
    crowd = [came() for _ in range(4)]
    assert [places.take(one) for one in crowd] == [None] * 4
    assert places.take(came()) is crowd[0]
    assert other in places


def test_of_many_addresses_the_one_with_most_makes_room() -> None:
    places = Places(8)
    greedy = [came() for _ in range(3)]
    for one in [*greedy, *(came(f"10.0.1.{n}") for n in range(5))]:
        assert places.take(one) is None
    assert places.take(came("10.0.2.1")) is greedy[0]


def test_unknown_ones_never_take_a_known_ones_place() -> None:
    places = Places(4)
    mine = came()
    places.take(mine)
    assert places.know(mine) is None
    left = [places.take(came()) for _ in range(20)]
    assert mine not in left
    assert mine in places
    assert places.late(TO_SHOW_S + 1)[:1] != [mine]


def test_of_known_ones_the_longest_silent_makes_room_but_never_one_that_stops() -> None:
    places = Places()
    known = [came(since=float(n)) for n in range(KNOWN)]
    for one in known:
        places.take(one)
        assert places.know(one) is None
    known[0].stopping = True
    late = came(since=1000.0)
    places.take(late)
    assert places.know(late) is known[1]


def test_who_shows_nothing_is_late_soon_and_who_may_stop_much_later() -> None:
    places = Places()
    mine, nobody = came(), came()
    for one in (mine, nobody):
        places.take(one)
    places.know(mine)
    assert places.late(TO_SHOW_S) == []
    assert places.late(TO_SHOW_S + 0.1) == [nobody]
    assert places.leave(nobody)
    assert not places.leave(nobody)
    assert places.late(IDLE_S + 0.1) == [mine]


def test_where_no_file_handle_is_left_the_oldest_unknown_leaves_and_never_a_known_one() -> None:
    places = Places()
    mine, first, second = came(), came(), came()
    for one in (mine, first, second):
        places.take(one)
    places.know(mine)
    assert places.oldest_unknown() is first
    places.leave(first)
    places.leave(second)
    assert places.oldest_unknown() is None
