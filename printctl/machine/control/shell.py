"""Shell of the room's steps: drives them on a transport and a clock."""

from __future__ import annotations

from typing import Final, TypeVar

from printctl.machine.control.steps import Happened, Steps, Urgent
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
    exchange, now, read = wiring.exchange, wiring.clock.now, wiring.transport.read
    effects = exchange.effects
    exchange.now_s = now()
    try:
        wait = next(steps)
        while True:
            try:
                if effects:
                    carry_out(wiring)
                left, data = wait.until_s - exchange.now_s, b""
                if wait.until_s >= 0.0:
                    data = read(POLL_S if left > POLL_S else max(left, 0.0))
            except PortLost as exc:
                exchange.now_s = now()
                wait = steps.throw(exc)
            else:
                exchange.now_s = now_s = now()
                wait = steps.send(Happened(now_s, data))
    except StopIteration as end:
        carry_out(wiring)
        result: T = end.value
        return result


def carry_out(wiring: Wiring) -> None:
    """Carry out the effects that wait, in their order."""
    transport, effects = wiring.transport, wiring.exchange.effects
    while effects:
        effect = effects.popleft()
        if isinstance(effect, Urgent):
            transport.write_urgent(effect.data)
        else:
            transport.write(effect)
