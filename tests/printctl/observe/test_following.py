"""Observer's process: it looks once the needle is held, not while the motors still move."""

from __future__ import annotations

import pytest

from printctl.link.states import LinkState, Status
from printctl.observe.observer import Observer
from printctl.observe.process import follow
from printctl.observe.records import LookRecord

TOLD = {"number": 1, "mark": "end of layer 0", "done": 20, "decision": "", "insert_sha256": ""}


class Events:
    """Statuses in their order; ``now`` is the one that is being heard."""

    def __init__(self, *said: tuple[LinkState, str]) -> None:
        self.now: Status | None = None
        self.said = said

    def events(self):
        for state, decision in self.said:
            self.now = Status(state, look={**TOLD, "decision": decision})
            yield self.now
        yield Status(LinkState.DONE)


class Watching(Observer):
    """Notes in which state it looks."""

    events: Events

    def look(self, look):
        self.looked.append(self.events.now.state)
        return LookRecord(look.number, look.done, look.job_line, look.mark, 0.0, "go_on", "")


def watching(folder, events) -> Watching:
    (folder / "journal.log").touch()
    observer = Watching(folder, None, None, None, None, None, None)
    observer.events, observer.looked = events, []
    return observer


@pytest.mark.parametrize("held", [1, 3])
def test_a_picture_is_taken_once_the_needle_is_held(tmp_path, held):
    pausing, looking = (LinkState.PAUSING, ""), (LinkState.LOOKING, "")
    events = Events(pausing, pausing, *[looking] * held, (LinkState.RESUMING, "go_on"))
    observer = watching(tmp_path, events)
    follow(events, observer)
    assert observer.looked == [LinkState.LOOKING]


def test_a_look_that_was_decided_by_another_isnt_made(tmp_path):
    events = Events((LinkState.PAUSING, ""), (LinkState.PAUSED, "pause"))
    observer = watching(tmp_path, events)
    follow(events, observer)
    assert observer.looked == []
