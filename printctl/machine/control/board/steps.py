"""Steps: procedures that wait by yielding alone, and what they exchange with their shell.

A procedure of this room does no I/O and has no clock: it is a generator that yields `Wait` and is
given what `Happened`; what is to go out it leaves as effects.
`printctl.machine.control.board.shell` carries those out; a test may send events by itself, in no
time.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final, TypeAlias, TypeVar

T = TypeVar("T")

MAX_BACKLOG: Final = 10_000
"""Records kept in memory while the journal can't be written."""


class Wait:
    """Nothing is to be done before a byte or a request comes, or it is ``until_s``.

    Minus infinity: no byte is to be read either.
    """

    __slots__ = ("until_s",)

    def __init__(self, until_s: float) -> None:
        self.until_s = until_s


@dataclass(frozen=True)
class Urgent:
    """Bytes that overtake all that hasn't left yet."""

    data: bytes


@dataclass(frozen=True)
class Record:
    """Journal record."""

    sort: str
    values: dict[str, Any]


Happened: TypeAlias = tuple[float, bytes]
"""Event: the time, s, and the bytes that came, empty for none. (A named tuple costs 1 % a line.)"""
Effect: TypeAlias = bytes | Urgent | Record | Callable[[], None]
"""Bytes to send, a record for the journal, or the report of something to a client."""
Steps: TypeAlias = Generator[Wait, Happened, T]


@dataclass
class Exchange:
    """Time of the last event, and effects to be carried out, in their order, at the next wait.

    So a record is on the disk before the bytes behind it leave. The shell sets the time before
    the steps begin and with each event. A lost port is raised where the steps wait; while the
    journal can't be written, ``journal_fault`` says why, and ``backlog`` keeps its records.
    """

    now_s: float = 0.0
    effects: deque[Effect] = field(default_factory=deque)
    journal_fault: str = ""  # of the last record that didn't fit; empty once there is room again
    backlog: deque[Record] = field(default_factory=lambda: deque(maxlen=MAX_BACKLOG))
    filing: threading.Lock = field(default_factory=threading.Lock)  # of one record after another

    def tell(self, report: Callable[..., None], *values: Any) -> None:
        """Have something reported to a client, once what it is about is in the journal."""
        self.effects.append(partial(report, *values))

    def drop_bytes(self) -> None:
        """Send none of the bytes that haven't left yet."""
        for _ in range(len(self.effects)):  # other threads may add to them meanwhile
            effect = self.effects.popleft()
            if not isinstance(effect, (bytes, Urgent)):
                self.effects.append(effect)


def carried_out() -> Steps[None]:
    """Return once the effects are carried out; nothing is heard meanwhile."""
    yield Wait(-math.inf)
