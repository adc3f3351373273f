"""Shell of the room's steps: drives them on a transport, a clock and a journal."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, TypeVar

from printctl.machine.control.board.steps import Record, Steps, Urgent
from printctl.machine.control.board.wiring import Wiring
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

    A full disk pauses a print. Room for the records of the pause is kept back; those that don't fit
    stay in memory, and are added in their order once there is room, which each record tries anew.
    """
    exchange, journal = wiring.exchange, wiring.journal
    backlog = exchange.backlog
    with exchange.filing:
        backlog.append(record)
        while backlog:
            try:
                journal.add(backlog[0].sort, **backlog[0].values)
            except JournalError as exc:
                exchange.journal_fault = str(exc)
                if not journal.use_reserve():
                    return
            else:
                backlog.popleft()
        if exchange.journal_fault and journal.keep_reserve():
            exchange.journal_fault = ""


def write_end(values: dict[str, Any], wiring: Wiring) -> None:
    """Add the end of a print to the journal: the record that matters where not all fit."""
    exchange = wiring.exchange
    write_down(Record("end", values), wiring)
    if exchange.backlog:
        exchange.backlog.clear()
        write_down(Record("end", {**values, "lost": True}), wiring)
