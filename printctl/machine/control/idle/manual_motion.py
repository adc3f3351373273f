"""Move tip or plunger of an idle printer by hand, in short pieces that can be interrupted."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from printctl.machine.control.board.steps import Steps
from printctl.machine.control.idle.standby import Standby
from printctl.machine.control.idle.station_status import Place
from printctl.machine.errors import LinkError, PortLost

PIECE_S: Final = 0.15
"""Length of a piece."""
AHEAD_S: Final = 0.5
"""So much of a move the printer is given ahead; it is what still runs after it was ended."""


def travel(standby: Standby, target: Place, speed_mm_s: float) -> Steps[bool]:
    """Move the tip in a straight line and wait; return whether it went all the way.

    Else it was ended (`Standby.halt_motion`). LinkError when the printer complains or went
    elsewhere.
    """
    start = standby.position
    if start is None:
        raise LinkError("the printer doesn't report its position (M114); reconnect")
    seconds = math.dist(start, target) / speed_mm_s
    by_mm = {axis: b - a for axis, a, b in zip("xyz", start, target, strict=True)}

    def piece(part: float) -> str:
        there = zip("XYZ", _between(start, target, part), start, target, strict=True)
        words = [f"{letter}{value:.4f}" for letter, value, a, b in there if a != b]
        return " ".join(["G1", *words, f"F{speed_mm_s * 60:.3f}"])

    done = yield from _piecewise(standby, piece, _pieces(standby, seconds, by_mm), seconds)
    yield from standby.expect(_between(start, target, done))
    return done == 1.0


def push(standby: Standby, mm: float, speed_mm_s: float) -> Steps[float]:
    """Move the plunger by ``mm`` and wait; return how far it was sent.

    LinkError when the printer complains, or doesn't say where the plunger is.
    """
    begin = standby.plunger
    if begin is None:
        raise LinkError("the printer doesn't report the plunger position (M114); reconnect")
    if standby.dialect.cold_extrusion:
        yield from standby.do(standby.dialect.cold_extrusion)
    seconds = abs(mm) / speed_mm_s

    def piece(part: float) -> str:
        return f"G1 E{begin + mm * part:.5f} F{speed_mm_s * 60:.3f}"

    try:
        count = _pieces(standby, seconds, {"e": mm})
        done = yield from _piecewise(standby, piece, count, seconds, watched=mm > 0)
        standby.plunger = begin + mm * done
    except PortLost:
        raise
    except LinkError:
        yield from standby.look()
        raise
    yield from standby.look()
    return mm * done


def _piecewise(
    standby: Standby,
    piece: Callable[[float], str],
    count: int,
    seconds: float,
    watched: bool = False,
) -> Steps[float]:
    """Send a move in pieces, a little ahead of the printer; return how much of it was sent.

    One that is ``watched`` ends where a force or pressure is above its limit. A printer that
    complains makes what it took first; one that has halted or is gone isn't asked any more.
    """
    begun, sent = standby.channel.now, 0
    try:
        while sent < count and not (standby.halt.is_set() or (watched and standby.trouble)):
            sent += 1
            yield from standby.do(piece(sent / count))
            yield from _keep_pace(standby, begun, seconds * sent / count)
    except PortLost:
        raise
    except LinkError:  # one that was halted is asked nothing more
        yield from standby.channel.command(b"M400")
        raise
    yield from standby.channel.command(b"M400")
    standby.raise_fault("the move")
    return sent / count


def _pieces(standby: Standby, seconds: float, by_mm: dict[str, float]) -> int:
    """Return the pieces of a move; a firmware drops one of few steps (Marlin: 6)."""
    printer = standby.channel.wiring.printer
    steps = max(abs(mm) * getattr(printer.steps_per_mm, axis) for axis, mm in by_mm.items())
    fewest = 2 * printer.min_steps_per_segment
    return max(1, min(math.ceil(seconds / PIECE_S), int(steps // fewest)))


def _keep_pace(standby: Standby, begun: float, seconds: float) -> Steps[None]:
    """Wait until only `AHEAD_S` of what was sent are ahead; ask meanwhile what is due."""
    channel = standby.channel
    due = begun + (seconds / standby.pace if standby.pace else 0.0) - AHEAD_S
    yield from standby.attend()
    while channel.now < due and not standby.halt.is_set():
        yield from channel.pump(min(due, channel.now + 0.05))
        yield from standby.attend()


def _between(start: Sequence[float], end: Sequence[float], part: float) -> Place:
    x, y, z = (a + (b - a) * part for a, b in zip(start, end, strict=True))
    return x, y, z
