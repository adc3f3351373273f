"""Standing printer by events: moves by hand and what ends them, in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

from printctl.machine.control.board import halting
from printctl.machine.control.board.connecting import protocol_for
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.idle.idle_commands import IdleCommands
from printctl.machine.control.idle.known_state import Knowledge
from printctl.machine.control.idle.manual_motion import push, travel
from printctl.machine.control.idle.standby import Standby
from printctl.machine.errors import LinkError
from printctl.machine.ports.clock import RealClock, VirtualClock
from printctl.machine.ports.detection import PortPrograms
from printctl.machine.process.clients.kill_unlinked import _halt
from printctl.machine.records.states import LinkState, PrintEnded
from tests.printctl.machine.control.bench import PRINTER, QUIET_S, MemoryJournal
from tests.printctl.machine.control.scripted_printer import ScriptedPrinter

HANGS_S = 300.0


@dataclass
class Port:
    """A scripted printer's port; at a time something happens to it."""

    clock: VirtualClock = field(default_factory=lambda: VirtualClock(0.0))
    printer: ScriptedPrinter = field(default_factory=ScriptedPrinter)
    sent: list[bytes] = field(default_factory=list)
    plan: list[tuple[float, Callable[[], None]]] = field(default_factory=list)
    name: str = "scripted"
    stolen: int = 0
    quiet_s: float = QUIET_S

    def programs(self) -> PortPrograms:
        return PortPrograms()

    def write(self, data: bytes) -> None:
        self.sent.append(data)
        self.printer.take(data, self.clock.now())

    write_urgent = write_halt = write

    def read(self, timeout: float) -> bytes:
        assert self.clock.now() < HANGS_S, "it hangs"
        until = self.clock.now() + timeout
        self.clock.sleep(max(0.0, min(self.printer.due_s, until) - self.clock.now()))
        if self.plan and self.plan[0][0] <= self.clock.now():
            self.plan.pop(0)[1]()
        return self.printer.said(self.clock.now())


@pytest.fixture
def standing() -> tuple[Standby, Port]:
    port = Port()
    protocol = protocol_for(PRINTER, QUIET_S)
    wiring = Wiring(port, protocol, port.clock, MemoryJournal(), PRINTER, fresh=False)  # type: ignore[arg-type]
    standby = Standby(wiring, 1.0, lambda: None)
    standby.drive(standby.begin())
    return standby, port


def moved(standby: Standby) -> Steps[Any]:
    return travel(standby, (90.0, 50.0, 10.0), 5.0)


def pushed(standby: Standby) -> Steps[Any]:
    return push(standby, 5.0, 0.5)


@pytest.mark.parametrize("begun", [moved, pushed])
def test_a_move_by_hand_ends_at_once_where_the_printer_has_halted(standing, begun):
    standby, port = standing

    def kill() -> None:
        standby._kill.asked.set()
        standby._kill._sent = True
        port.write_halt(b"M112\n")

    port.plan.append((at := port.clock.now() + 2.0, kill))
    with pytest.raises(PrintEnded, match="confirmed the halt") as ended:
        standby.drive(begun(standby))
    assert "halted itself before" not in ended.value.message
    assert port.clock.now() - at < 1.0
    assert b"M112" in port.sent[-1]


@pytest.mark.parametrize("begun", [moved, pushed])
def test_what_a_printer_took_before_it_complained_is_made_before_the_answer(standing, begun):
    standby, port = standing
    port.plan.append((port.clock.now() + 2.0, lambda: port.printer.say(b"Error:it jams\n")))
    with pytest.raises(LinkError, match="it jams"):
        standby.drive(begun(standby))
    assert any(b"M0400" in data for data in port.sent[-6:])


@pytest.mark.parametrize("begun", [moved, pushed])
@pytest.mark.parametrize(("silently", "why"), [(False, "was reset"), (True, "reset silently")])
@pytest.mark.parametrize("after_s", [0.3, 2.0, 2.4])
def test_a_reset_in_a_move_by_hand_ends_it_at_once(standing, begun, silently, why, after_s):
    standby, port = standing
    port.plan.append((at := port.clock.now() + after_s, lambda: port.printer.reset_now(silently)))
    with pytest.raises(PrintEnded, match=why) as ended:
        standby.drive(begun(standby))
    assert (ended.value.state, ended.value.known) == (LinkState.POSITION_UNKNOWN, False)
    assert port.clock.now() - at < 2.0
    assert port.printer.place == dict.fromkeys("XYZE", 0.0)  # nothing moved in the wrong frame


def test_a_silent_reset_of_a_printer_that_stands_is_noticed(standing):
    standby, port = standing
    port.printer.reset_now(silently=True)
    with pytest.raises(PrintEnded, match="reset silently"):
        for _ in range(60):
            standby.drive(standby.rest(0.05))


@pytest.mark.parametrize("begun", [moved, pushed])
def test_unreadable_answers_in_a_move_by_hand_end_it(standing, begun):
    standby, port = standing

    def garble() -> None:
        said = port.printer.said
        port.printer.said = lambda now: bytes(one ^ 0x9B for one in said(now))  # type: ignore[method-assign]

    port.plan.append((at := port.clock.now() + 2.0, garble))
    with pytest.raises(PrintEnded, match="no valid reply"):
        standby.drive(begun(standby))
    assert port.clock.now() - at < 20.0


def test_a_move_that_ends_elsewhere_costs_the_trust_in_the_place(standing):
    standby, port = standing
    idle = IdleCommands(standby, Knowledge(PRINTER, homed=(True, True, True)))
    port.plan.append((port.clock.now() + 1.0, lambda: port.printer.at.update(Y=52.0)))
    with pytest.raises(LinkError, match=r"is at X60\.00 Y52\.00"):
        idle.grant("jog", {"by": {"x": 10.0}, "speed_mm_s": 5.0})
    assert not idle.known.trusted


@pytest.mark.parametrize(("by_reset", "why"), [(False, "port was opened"), (True, "reset line")])
def test_an_unlinked_kill_says_what_started_the_board_anew(monkeypatch, by_reset, why):
    monkeypatch.setattr(halting, "KILL_ATTEMPTS", 0)
    said = [] if by_reset else [b"start\n"]
    port = SimpleNamespace(
        write=lambda data: None,
        write_halt=lambda data: None,
        reset=lambda: said.append(b"start\n"),
        read=lambda timeout: said.pop() if said else b"",
    )
    protocol = protocol_for(PRINTER, QUIET_S)
    wiring = Wiring(port, protocol, RealClock(), MemoryJournal(), PRINTER)  # type: ignore[arg-type]
    assert why in _halt(wiring, {})
