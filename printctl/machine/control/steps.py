"""Steps: procedures that wait by yielding alone, and what they exchange with their shell.

A procedure of this room does no I/O and has no clock: it is a generator that yields `Wait` and is
given what `Happened`; what is to go out it leaves as effects. `printctl.machine.control.shell`
carries those out; a test may send events by itself, in no time.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import TypeAlias, TypeVar

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


Happened: TypeAlias = tuple[float, bytes]
"""Event: the time, s, and the bytes that came, empty for none. (A named tuple costs 1 % a line.)"""
Effect: TypeAlias = bytes | Urgent
Steps: TypeAlias = Generator[Wait, Happened, T]


@dataclass
class Exchange:
    """Time of the last event, and effects to be carried out, in their order, at the next wait.

    The shell sets the time before the steps begin and with each event. One whose effect or wait
    fails (a lost port) raises it where the steps wait.
    """

    now_s: float = 0.0
    effects: deque[Effect] = field(default_factory=deque)


def carried_out(exchange: Exchange) -> Steps[None]:
    """Return once the effects are carried out; nothing is heard meanwhile."""
    yield Wait(-math.inf)
