"""Take back what other programs changed: modes, settings, heater targets, feed rate, speed.

M114 tells where a printer is, not how it reads the next line: relative places, a flow factor or
other steps per mm would spoil the rest of the print.

Klipper answers each client alone: a G91, M221 or SET_GCODE_OFFSET of another one is reported to no
other. So it is asked at intervals; what it doesn't tell at all (the speed factor) is set anew.
"""

from __future__ import annotations

from typing import Final

from printctl.checks.gate.firmware import blind_resets
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.printing.context import Print
from printctl.machine.errors import HandshakeError
from printctl.machine.families import link_facts

EVERY_S: Final = 1.0
"""Interval of comparisons: three lines and their answers, for which nothing stands still."""
_SPEED: Final = "M220"


def take_back(run: Print) -> Steps[None]:
    """Set anew what others may have set, where lines weren't ours; end where that can't be."""
    if not run.progress.meddled:
        return
    run.progress.meddled = False
    try:
        yield from set_anew(run)
    except HandshakeError as exc:
        yield from run.position.end_astray(str(exc))


def own_modes(run: Print) -> Steps[None]:
    """Set modes before moves of the link's own, where another client's leave no trace."""
    if link_facts(run.printer).place_question:
        yield from run.firmware.set_modes(journalled=True)


def set_anew(run: Print) -> Steps[None]:
    """Set modes, factors, limits, heaters and feed rate as the job has them; none in flight.

    Raise `HandshakeError` for what no command takes back.
    """
    yield from run.firmware.set_modes(journalled=True)
    if link_facts(run.printer).tells_steps:
        yield from run.firmware.check_steps(journalled=True)
    yield from run.firmware.agree_settings(journalled=True)
    yield from run.heat.take_back()
    feed = run.progress.modal().f
    if feed is not None:
        yield from run.channel.command(b"G1 F%b" % f"{feed:g}".encode())


def begin_polling(run: Print, now: float) -> None:
    """Have other clients' changes compared from ``now`` on, where they must be asked for."""
    if link_facts(run.printer).place_question:
        run.clients_due = now + EVERY_S


def poll_clients(run: Print, now: float) -> Steps[None]:
    """Compare other clients' changes where that is due."""
    if now >= run.clients_due:
        yield from run.channel.settle()
        yield from compare_clients(run)
        run.clients_due = run.channel.now + EVERY_S


def compare_clients(run: Print) -> Steps[None]:
    """Compare now, with nothing in flight.

    End the print where the next lines would lead elsewhere, or push otherwise, than the job says.
    """
    if not link_facts(run.printer).place_question:
        return
    yield from run.position.refuse_astray()
    yield from run.heat.take_back()
    resets = blind_resets(run.printer)
    yield from run.channel.commands([one.encode() for one in resets if one.startswith(_SPEED)])
