"""Shell of the room's steps: drives them on a transport, a clock and a journal."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, TypeVar

from printctl.machine.control.steps import Record, Steps, Urgent
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import JournalError, PortLost

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
                    if isinstance(effect, bytes):
                        write(effect)
                    else:
                        _carry_out(effect, wiring)
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
        carry_out_rest(wiring)
        result: T = end.value
        return result
    except Exception:
        carry_out_rest(wiring)
        raise


def _carry_out(effect: Urgent | Record | Callable[[], None], wiring: Wiring) -> None:
    if isinstance(effect, Record):
        write_down(effect, wiring)
    elif isinstance(effect, Urgent):
        wiring.transport.write_urgent(effect.data)
    else:
        effect()


def carry_out_rest(wiring: Wiring) -> None:
    """Carry out what steps that have ended left: records and reports."""
    wiring.exchange.drop_bytes()
    while wiring.exchange.effects:
        effect = wiring.exchange.effects.popleft()
        if not isinstance(effect, bytes):
            _carry_out(effect, wiring)


def write_down(record: Record, wiring: Wiring) -> None:
    """Add a record to the journal, by any thread; report a failure to the steps.

    A full disk is a fault that ends a print by a controlled stop, for which room is kept back.
    """
    exchange, journal = wiring.exchange, wiring.journal
    if exchange.journal_lost:
        return
    try:
        journal.add(record.sort, **record.values)
    except JournalError as exc:
        text, exchange.disk_full = str(exc), True
        others = [one for one in exchange.journal_faults if one != text]
        exchange.journal_faults = [text, *others]
        exchange.journal_lost = not journal.use_reserve()
        write_down(record, wiring)
