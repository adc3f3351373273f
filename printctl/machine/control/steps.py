"""Steps: procedures that wait by yielding alone, and what they exchange with their shell.

A procedure of this room does no I/O and has no clock: it is a generator that yields `Wait` and is
given what `Happened`; what is to go out it leaves as effects. `printctl.machine.control.shell`
carries those out; a test may send events by itself, in no time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias, TypeVar

T = TypeVar("T")


class Wait:
    """Nothing is to be done before a byte or a request comes, or it is ``until_s``."""

    __slots__ = ("until_s",)

    def __init__(self, until_s: float) -> None:
        self.until_s = until_s


class Happened(NamedTuple):
    """Event: it is ``now_s``, and ``data`` came from the printer, empty for nothing."""

    now_s: float
    data: bytes


@dataclass(frozen=True)
class Urgent:
    """Bytes that overtake all that hasn't left yet."""

    data: bytes


Effect: TypeAlias = bytes | Urgent
Steps: TypeAlias = Generator[Wait, Happened, T]


@dataclass
class Exchange:
    """Time of the last event, and effects to be carried out, in their order, at the next wait.

    Effects go out before anything is waited for. One that fails (a lost port) raises where the
    steps wait.
    """

    now_s: float = 0.0
    effects: deque[Effect] = field(default_factory=deque)


def carried_out(exchange: Exchange) -> Steps[None]:
    """Return once the effects are carried out; nothing is heard meanwhile."""
    exchange.now_s = (yield Wait(-1.0)).now_s
