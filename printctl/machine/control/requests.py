"""Queue of other threads' requests to a print, served between two job lines."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from printctl.machine.control.gating import Manual
from printctl.machine.control.look_book import LookWord
from printctl.machine.job.care import NewSyringe


class Request(Enum):
    """What is asked of a print."""

    STOP = auto()
    PAUSE = auto()
    RELOAD = auto()
    LOOK = auto()
    """See what is due: a pause after a mark was asked for."""


@dataclass(frozen=True)
class ResumeRequest:
    """A request to go on; the thread that speaks to the printer answers it.

    Attributes
    ----------
    change : NewSyringe or None
        What was put in, in a pause for a change of syringe.
    unchanged : bool
        The syringe wasn't changed after all.
    answer : callable
        Given why the print doesn't go on; an empty text once it does.
    """

    change: NewSyringe | None = None
    unchanged: bool = False
    answer: Callable[[str], None] = lambda why: None


class RequestQueue:
    """Filled by any thread, emptied by the one that speaks to the printer.

    Attributes
    ----------
    requests : deque of Request or ResumeRequest
    commands : deque of Manual
        Commands between two lines.
    looks : deque of LookWord
        What clients said of the look that the print is held for.
    stopped_by : str
        Who has asked for the stop: the first who did.
    pause_words : str
        Why the pause that is waited for was asked for, for its message.
    """

    def __init__(self) -> None:
        self.requests: Final[deque[Request | ResumeRequest]] = deque()
        self.commands: Final[deque[Manual]] = deque()
        self.looks: Final[deque[LookWord]] = deque()
        self.stopped_by = self.pause_words = ""

    @property
    def waiting(self) -> bool:
        """Whether anything is asked for."""
        return bool(self.requests or self.commands or self.looks)

    def add(self, request: Request | ResumeRequest, by: str = "the user", why: str = "") -> None:
        """Ask for something; ``why`` in place of who has asked for it."""
        if request is Request.PAUSE and request not in self.requests:
            self.pause_words = why or f"paused by {by}"
        if request is Request.STOP:
            self.stopped_by = self.stopped_by or by
        self.requests.append(request)

    def add_command(self, manual: Manual) -> None:
        """Ask for a command."""
        self.commands.append(manual)

    def take(self) -> Request | ResumeRequest | None:
        """Return the oldest request; None where there is none."""
        return self.requests.popleft() if self.requests else None

    def take_command(self) -> Manual | None:
        """Return the oldest command; None where there is none."""
        return self.commands.popleft() if self.commands else None

    def add_look(self, word: LookWord) -> None:
        """Say something of a look."""
        self.looks.append(word)

    def take_look(self) -> LookWord | None:
        """Return the oldest word about a look; None where there is none."""
        return self.looks.popleft() if self.looks else None
