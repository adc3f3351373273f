"""Steps: procedures that wait by yielding alone, and what they exchange with their shell.

A procedure of this room does no I/O and has no clock: it is a generator that yields `Wait` and is
given what `Happened`; what is to go out it leaves as effects. `printctl.machine.control.shell`
carries those out; a test may send events by itself, in no time.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias, TypeVar

T = TypeVar("T")


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
    the steps begin and with each event. A lost port is raised where the steps wait; a journal that
    can't be written is reported in ``journal_faults``.
    """

    now_s: float = 0.0
    effects: deque[Effect] = field(default_factory=deque)
    journal_faults: list[str] = field(default_factory=list)  # the newest first
    disk_full: bool = False  # a record couldn't be written at once
    journal_lost: bool = False  # no record can be written any more

    def tell(self, report: Callable[..., None], *values: Any) -> None:
        """Have something reported to a client, once what it is about is in the journal."""
        self.effects.append(partial(report, *values))

    def drop_bytes(self) -> None:
        """Send none of the bytes that haven't left yet."""
        kept = [one for one in self.effects if not isinstance(one, (bytes, Urgent))]
        self.effects.clear()
        self.effects.extend(kept)


def carried_out() -> Steps[None]:
    """Return once the effects are carried out; nothing is heard meanwhile."""
    yield Wait(-math.inf)
