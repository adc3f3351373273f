"""Shell of the room's steps: drives them on a transport and a clock."""

from __future__ import annotations

import math
from typing import Final, TypeVar

from printctl.machine.control.steps import Steps, Urgent
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import PortLost

POLL_S: Final = 0.04
"""Longest wait for the printer before requests are looked at."""

T = TypeVar("T")


def drive(steps: Steps[T], wiring: Wiring) -> T:
    """Carry out steps to their end, waiting where they wait; return what they return.

    Raises
    ------
    PrintEnded, LinkError
        As they do; `PortLost` where they don't catch it.
    """
    exchange, now, transport = wiring.exchange, wiring.clock.now, wiring.transport
    effects, write, read = exchange.effects, transport.write, transport.read
    exchange.now_s = now()
    try:
        wait = next(steps)
        while True:
            try:
                while effects:
                    effect = effects.popleft()
                    if isinstance(effect, Urgent):
                        transport.write_urgent(effect.data)
                    else:
                        write(effect)
                left = wait.until_s - exchange.now_s
                if left > POLL_S:
                    data = read(POLL_S)
                else:
                    data = b"" if left == -math.inf else read(max(left, 0.0))
            except PortLost as exc:
                exchange.now_s = now()
                wait = steps.throw(exc)
            else:
                exchange.now_s = now_s = now()
                wait = steps.send((now_s, data))
    except StopIteration as end:
        result: T = end.value
        return result
