"""Function calls in a second process."""

from __future__ import annotations

import os

import pytest

from printctl.second_process import SecondProcess


def where() -> int:
    """The process that works."""
    return os.getpid()


def end_elsewhere(first: int) -> str:
    """End the process that works, unless it is the first."""
    if os.getpid() != first:
        os._exit(3)
    return "made here"


def test_a_call_is_made_in_another_process_and_raises_what_it_raises():
    with SecondProcess() as second:
        there, missing = second.call(__name__, "where"), second.call("json", "loads", "{")
        again = second.call(__name__, "where")
        assert there.result() == again.result() != os.getpid()
        with pytest.raises(ValueError, match="Expecting property name"):
            missing.result()


def test_what_a_process_that_ends_leaves_undone_is_done_here():
    with SecondProcess() as second:
        ended = second.call(__name__, "end_elsewhere", os.getpid())
        assert ended.result() == "made here"
        assert second.call(__name__, "where").result() == os.getpid()
