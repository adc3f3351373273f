"""Shell of the steps: effects in their order before each wait, failures where the steps wait."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from printctl.machine.control.board.shell import POLL_S, drive, write_down
from printctl.machine.control.board.steps import Record, Steps, Urgent, Wait, carried_out
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.errors import PortLost, Refused
from printctl.machine.ports.clock import VirtualClock
from tests.printctl.machine.control.bench import PRINTER, MemoryJournal


@dataclass
class Port:
    """Writes down what is done, in its order."""

    clock: VirtualClock
    done: list[Any] = field(default_factory=list)
    says: bytes = b""
    lost: bool = False

    def write(self, data: bytes) -> None:
        if self.lost:
            raise PortLost("gone")
        self.done.append(data)

    def write_urgent(self, data: bytes) -> None:
        self.done.append(("urgent", data))

    def read(self, timeout: float) -> bytes:
        self.done.append(timeout)
        self.clock.sleep(timeout)
        said, self.says = self.says, b""
        return said


@dataclass
class Bench:
    port: Port
    wiring: Wiring

    def put(self, *effects: bytes | Urgent | Record | Callable[[], None]) -> None:
        self.wiring.exchange.effects.extend(effects)


@pytest.fixture
def bench() -> Bench:
    port = Port(VirtualClock(100.0))
    journal = MemoryJournal()
    add = journal.add

    def note(sort: str, **values: Any) -> None:
        add(sort, **values)
        port.done.append(sort)

    journal.add = note  # type: ignore[method-assign]
    wiring = Wiring(port, None, port.clock, journal, PRINTER)  # type: ignore[arg-type]
    return Bench(port, wiring)


def test_effects_are_carried_out_in_their_order_before_it_waits(bench):
    def steps() -> Steps[str]:
        bench.put(Record("control", {"n": 1}), b"N1\n", lambda: bench.port.done.append("told"))
        bench.put(Urgent(b"M410\n"))
        now, data = yield Wait(100.01)
        return f"{now:.2f} {data!r}"

    bench.port.says = b"ok\n"
    assert drive(steps(), bench.wiring) == "100.01 b'ok\\n'"
    *before, waited = bench.port.done
    assert before == ["control", b"N1\n", "told", ("urgent", b"M410\n")]
    assert waited == pytest.approx(0.01)


def test_long_waits_are_cut_so_that_requests_are_seen(bench):
    def steps() -> Steps[int]:
        count = 0
        while bench.wiring.exchange.now_s < 101.0:
            count += 1
            yield Wait(math.inf)
        return count

    assert drive(steps(), bench.wiring) == pytest.approx(1.0 / POLL_S, abs=1)


def test_time_that_has_passed_is_waited_for_without_waiting(bench):
    def steps() -> Steps[None]:
        yield Wait(3.0)

    drive(steps(), bench.wiring)
    assert bench.port.done == [0.0]


def test_nothing_is_read_where_effects_alone_are_waited_for(bench):
    def steps() -> Steps[None]:
        bench.put(b"G1\n")
        yield from carried_out()
        bench.port.done.append("then")

    drive(steps(), bench.wiring)
    assert bench.port.done == [b"G1\n", "then"]


def test_lost_port_is_raised_where_the_steps_wait_and_what_is_behind_stays(bench):
    def steps() -> Steps[str]:
        bench.put(b"G1\n", Record("alarm", {}))
        try:
            yield Wait(math.inf)
        except PortLost as exc:
            bench.put(Record("end", {}))
            return str(exc)
        return "nothing"

    bench.port.lost = True
    assert drive(steps(), bench.wiring) == "gone"
    assert bench.port.done == ["alarm", "end"]


@pytest.mark.parametrize("fails", [False, True])
def test_records_and_reports_left_at_the_end_are_carried_out_and_bytes_dropped(bench, fails):
    def steps() -> Steps[None]:
        yield Wait(0.0)
        bench.put(b"G1\n", Record("end", {}), lambda: bench.port.done.append("told"))
        if fails:
            raise Refused("no")

    if fails:
        with pytest.raises(Refused):
            drive(steps(), bench.wiring)
    else:
        drive(steps(), bench.wiring)
    assert bench.port.done == [0.0, "end", "told"]


@pytest.mark.parametrize("reserve", [0, 1])
def test_journal_that_fails_is_reported_to_the_steps_and_the_record_kept_if_there_is_room(
    bench, reserve
):
    journal = bench.wiring.journal
    journal.full_at, journal.reserve = 0, reserve

    def steps() -> Steps[None]:
        bench.put(Record("insert", {}))
        yield from carried_out()

    drive(steps(), bench.wiring)
    exchange = bench.wiring.exchange
    assert "disk full" in exchange.journal_fault
    assert [one.sort for one in exchange.backlog] == ["insert"] * (not reserve)
    assert len(journal.records) == reserve


def test_records_that_didnt_fit_are_added_in_their_order_once_there_is_room(bench):
    journal, exchange = bench.wiring.journal, bench.wiring.exchange
    journal.full_at, journal.reserve = 0, 1
    for sort in ("insert", "looked", "left"):
        write_down(Record(sort, {}), bench.wiring)
    assert [one["t"] for one in journal.records] == ["insert"]
    journal.room_at_s = 0.0
    write_down(Record("stood", {}), bench.wiring)
    assert [one["t"] for one in journal.records] == ["insert", "looked", "left", "stood"]
    assert (exchange.journal_fault, list(exchange.backlog)) == ("", [])


def test_bytes_that_havent_left_are_dropped_for_a_kill_and_records_kept(bench):
    told = Record("alarm", {})
    bench.put(b"G1\n", told, Urgent(b"M410\n"))
    bench.wiring.exchange.drop_bytes()
    assert list(bench.wiring.exchange.effects) == [told]
