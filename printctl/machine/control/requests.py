"""Requests of other threads to a print, queued for the thread that speaks to the printer."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, auto

from printctl.machine.control.look_book import LookRequest
from printctl.machine.job.care import NewSyringe


class Request(Enum):
    """Request to a print."""

    STOP = auto()
    PAUSE = auto()
    RELOAD = auto()
    LOOK = auto()  # see what is due: a pause after a mark was requested


class PauseUntil(Enum):
    """What a pause waits for that ends by itself."""

    ROOM = auto()  # the journal can be written again
    QUIET = auto()  # the line garbles few lines again


@dataclass(frozen=True)
class ResumeRequest:
    """Request to go on; in a pause for a change of syringe with what was put in, if anything."""

    change: NewSyringe | None = None
    unchanged: bool = False
    answer: Callable[[str], None] = lambda why: None  # given why not; empty once the print goes on


@dataclass(frozen=True)
class ManualCommand:
    """Command between two lines of the job; one of the product's own isn't judged."""

    text: str
    done: Callable[[tuple[bytes, ...]], None]  # given the printer's reply
    refused: Callable[[str], None] | None = None  # given the reason; None for the product's own


@dataclass
class RequestQueue:
    """Queue filled by any thread, emptied by the one that speaks to the printer."""

    requests: deque[Request | ResumeRequest] = field(default_factory=deque)
    commands: deque[ManualCommand] = field(default_factory=deque)
    looks: deque[LookRequest] = field(default_factory=deque)
    stopped_by: str = ""  # who requested the stop first
    pause_until: PauseUntil | None = None  # what ends it without a person's word
    pause_words: str = ""  # why the awaited pause was requested, for its message

    @property
    def waiting(self) -> bool:
        """Whether anything is requested."""
        return bool(self.requests or self.commands or self.looks)

    def add(
        self,
        request: Request | ResumeRequest,
        by: str = "the user",
        why: str = "",
        until: PauseUntil | None = None,
    ) -> None:
        """Add a request; ``why`` goes into a pause's message in place of who requested it.

        ``until``: what ends the pause, unless somebody requests it as well.
        """
        if request is Request.PAUSE:
            if request not in self.requests:
                self.pause_words, self.pause_until = why or f"paused by {by}", until
            elif until is None:
                self.pause_until = None
        if request is Request.STOP:
            self.stopped_by = self.stopped_by or by
        self.requests.append(request)

    def take(self) -> Request | ResumeRequest | None:
        """Return the oldest request; None where there is none."""
        return self.requests.popleft() if self.requests else None
