"""Station whose final record couldn't be written: last message."""

from __future__ import annotations

import errno
import json
import os
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_profiles import Printer, load
from printctl.machine.control.idle.known_state import Knowledge
from printctl.machine.control.idle.station_status import (
    NO_PRINTER,
    Place,
    StationState,
    StationStatus,
)
from printctl.machine.errors import (
    HandshakeError,
    JobError,
    LinkError,
    NoLink,
    PortMissing,
    Refused,
)
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.job import load_job
from printctl.machine.job.retreat import Retreat
from printctl.machine.job.syringes import plunger_travel
from printctl.machine.process import station as process
from printctl.machine.process.clients.client import PrintClient, Station, attach_station
from printctl.machine.process.clients.client import attach as attach_print
from printctl.machine.process.clients.starting import find_or_start
from printctl.machine.process.contact import (
    STATION_JOURNAL,
    STATION_RECORD,
    last_status,
    load_station,
)
from printctl.machine.process.machine import Machine, Request
from printctl.machine.process.orders import Order
from printctl.machine.process.plug import Plug
from printctl.machine.process.simulated import is_complete_record
from printctl.machine.process.station import serve_station
from printctl.machine.records.journal import Journal
from printctl.machine.records.mounting import (
    MountedParts,
    Mounting,
    load_mounting,
    save_mounting,
)
from printctl.machine.records.record import ContactRecord
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState, Status
from tests.waiting import wait_for


def _left_printing(folder: Path, *states: str) -> None:
    """Leave the record of a station that printed, as a full disk keeps it, and its journal."""
    status = StationStatus(StationState.PRINTING).to_dict()
    record = ContactRecord(
        0, "", "t", "", "generic_marlin", "simulated", time.time(), status=status
    )
    record.save(folder, STATION_RECORD)
    journal = Journal(folder / STATION_JOURNAL)
    for state in states:
        journal.add("state", state=state, message=f"{state} by the journal")
    journal.close()


def test_close_that_only_the_journal_holds_is_told(tmp_path: Path) -> None:
    _left_printing(tmp_path, "ready", "halted", "closed")
    status = attach_station(tmp_path).status
    assert (status.state, status.message) == (StationState.CLOSED, "closed by the journal")


@pytest.mark.parametrize(
    ("states", "while_"), [(("ready", "halted"), "halted"), (("ready",), "printing")]
)
def test_end_without_a_word_is_told_with_the_last_state(
    tmp_path: Path, states: tuple[str, ...], while_: str
) -> None:
    _left_printing(tmp_path, *states)
    status = attach_station(tmp_path).status
    assert status.state is StationState.LOST
    assert f"without a word while {while_}" in status.message


@pytest.mark.parametrize(
    ("state", "remedy"),
    [
        (StationState.PRINTING, "`printctl resume /runs/a` goes on with it"),
        (StationState.HALTING, "the halt may not have left"),
        (StationState.BUSY, "`printctl station emergency-stop` halts the printer"),
        (StationState.READY, "ready; connect again"),
    ],
)
def test_end_without_a_word_says_what_is_to_be_done(
    tmp_path: Path, state: StationState, remedy: str
) -> None:
    status = StationStatus(state, print_folder="/runs/a").to_dict()
    record = ContactRecord(0, "", "t", "", "generic_marlin", "/dev/x", time.time(), status=status)
    record.save(tmp_path, STATION_RECORD)
    assert remedy in attach_station(tmp_path).status.message


def test_place_of_a_station_that_was_killed_is_not_trusted(tmp_path: Path) -> None:
    status = StationStatus(
        StationState.READY,
        position_mm=(1, 2, 3),
        position_trusted=True,
        homed=(True, True, True),
        soft_low_mm=(0, 0, 0),
        soft_high_mm=(9, 9, 9),
    )
    kept = ContactRecord(1, "", "", "", "p", "q", 1.0, status=status.to_dict())
    kept.save(tmp_path, STATION_RECORD)
    found = attach_station(tmp_path).status
    assert (found.position_mm, found.position_trusted) == (None, False)
    assert (found.homed, found.soft_low_mm) == ((False, False, False), ())


def test_close_of_an_earlier_station_is_not_taken(tmp_path: Path) -> None:
    journal = Journal(tmp_path / STATION_JOURNAL)
    journal.add("state", state="closed", message="earlier")
    journal.close()
    time.sleep(0.01)
    _left_printing(tmp_path)
    assert attach_station(tmp_path).status.state is StationState.LOST


def test_whatever_is_asked_of_a_station_that_is_gone_is_answered_alike(tmp_path: Path) -> None:
    _left_printing(tmp_path, "ready")
    station = attach_station(tmp_path)
    for ask in (
        lambda: station.jog("x", 1),
        lambda: station.command("M105"),
        station.reconnect,
        station.close,
    ):
        with pytest.raises(NoLink, match=NO_PRINTER.partition(";")[0]):
            ask()


# --- full disk at a station's start or end
class Disk:
    """Full on demand: whatever is written to it then is refused, as the system does."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        write = Path.write_bytes

        def written(path: Path, data: bytes) -> int:
            if self.full:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
            return write(path, data)

        monkeypatch.setattr(Path, "write_bytes", written)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    return Disk(monkeypatch)


def opening(folder: Path) -> Plug:
    return Plug("generic_marlin", "simulated", folder)


def test_a_station_that_cant_write_its_last_record_ends_by_its_status(
    tmp_path: Path, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed = StationStatus(StationState.CLOSED, "closed")

    def served(_: Plug, record: ContactRecord) -> object:
        ready = StationStatus(StationState.READY, "ready").to_dict()
        good = ContactRecord(record.pid, "", "t", "", "p", "q", 1.0, status=ready, sim_speed=12.5)
        good.save(tmp_path, STATION_RECORD)
        disk.full = True
        return record, closed

    monkeypatch.setattr(process, "_open", served)
    assert serve_station(opening(tmp_path)) == closed
    kept = load_station(tmp_path)
    assert (kept.sim_speed, last_status(kept).state) == (12.5, StationState.READY)


def test_a_station_that_cant_write_its_first_record_says_so_and_leaves_the_older_one(
    tmp_path: Path, disk: Disk
) -> None:
    older = ContactRecord(1, "", "", "", "p", "q", 1.0, sim_speed=12.5)
    older.save(tmp_path, STATION_RECORD)
    disk.full = True
    with pytest.raises(LinkError, match=r"station\.json can't be written.*free space"):
        serve_station(opening(tmp_path))
    assert load_station(tmp_path).sim_speed == 12.5


def test_what_was_known_outlives_a_station_that_dies_before_it_is_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = Mounting("generic_marlin", MountedParts(needle="30g"), 12.5, part_in_dish=True)
    save_mounting(known, tmp_path)
    seen = []
    monkeypatch.setattr(
        process, "_open", lambda _, record: seen.append(load_station(tmp_path)) or 1 / 0
    )
    with pytest.raises(ZeroDivisionError):
        serve_station(opening(tmp_path))
    for kept in (seen[0], load_station(tmp_path)):
        assert last_status(kept).mounted.needle == "30g"
    assert load_mounting("generic_marlin", tmp_path) == known


def test_what_was_learnt_outlives_a_station_that_fails_and_its_place_doesnt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: Plug, record: ContactRecord) -> object:
        stands = StationStatus(StationState.READY, position_mm=(1, 2, 3), position_trusted=True)
        learnt = replace(record, status=stands.to_dict(), sim_speed=7.5)
        learnt.save(tmp_path, STATION_RECORD)
        raise HandshakeError("no firmware answers")

    monkeypatch.setattr(process, "_open", fails)
    status = serve_station(opening(tmp_path))
    assert (status.state, status.position_mm) == (StationState.LOST, None)
    assert not status.position_trusted
    assert load_station(tmp_path).sim_speed == 7.5


# --- modes
def unplugged(folder: Path) -> Machine:
    plug = Plug("generic_marlin", "/dev/nowhere", folder)
    return Machine(plug, Knowledge(plug.printer))


def test_printer_that_cant_be_stood_by_behind_a_print_is_lost_with_both_reasons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(machine: Machine, fresh: bool) -> None:
        raise HandshakeError("no firmware answers")

    monkeypatch.setattr(process, "stand_by", fail)
    machine = unplugged(tmp_path)
    machine.enter(StationState.PRINTING, "printing")
    process._after_print(machine, Status(LinkState.STOPPED, message="cancelled by the user"))
    assert (machine.state, machine.status.error) == (StationState.LOST, "HandshakeError")
    assert "print cancelled: cancelled by the user; no firmware answers" in machine.message


@pytest.mark.parametrize(
    ("now", "trusted"), [((0.0, 0.0, 0.0), False), ((100.0, 100.0, 20.0), True)]
)
def test_print_that_sent_nothing_keeps_the_trust_only_where_the_tip_stands_as_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, now: Place, trusted: bool
) -> None:
    standing = SimpleNamespace(
        position=now,
        trouble="",
        halt_asked=False,
        firmware=SimpleNamespace(name="Marlin", capabilities={}),
        temperatures=(),
        readings=(),
    )
    monkeypatch.setattr(
        process, "stand_by", lambda machine, fresh: setattr(machine, "standby", standing)
    )
    machine = unplugged(tmp_path)
    machine.known.homed = (True, True, True)
    machine.enter(StationState.PRINTING, "printing")
    failed = Status(LinkState.FAILED, message="the machine still moved")
    process._after_print(machine, failed, (100.0, 100.0, 20.0))
    assert machine.state is StationState.READY
    assert machine.status.position_trusted is trusted
    assert ("reset silently" in machine.message) is not trusted


def asked_to_print(machine: Machine, order: dict[str, object]) -> list[dict[str, object]]:
    answers: list[dict[str, object]] = []
    process._attend(machine, Request("print", {"order": order}, answers.append))
    return answers


def test_order_of_another_version_is_refused_and_ends_no_station(tmp_path: Path) -> None:
    order = Order(tmp_path / "a.gcode", "generic_marlin", "", tmp_path / "p").to_json()
    for one in ({}, {**order, "new": 1}, {**order, "retreat": None}):
        (answer,) = asked_to_print(unplugged(tmp_path), one)
        assert "can't be read" in str(answer["message"])


def test_print_whose_folder_cant_be_written_to_ends_no_station(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, disk: Disk
) -> None:
    monkeypatch.setattr(process, "stand_by", lambda machine, fresh: None)
    job = write_job(tmp_path / "part.gcode", 3, (0, 0, 5))
    (tmp_path / "file").write_text("")
    for folder, log in (("full", ""), ("file", ""), ("run", tmp_path / "nowhere" / "wire.log")):
        machine, disk.full = unplugged(tmp_path), folder == "full"
        care = Care(wire_log=str(log))
        order = Order(job, "generic_marlin", "", tmp_path / folder, care=care).to_json()
        (answer,) = asked_to_print(machine, order)
        assert "can't be written to" in str(answer["message"])
        assert machine.state is StationState.READY


def test_halt_of_the_last_connection_isnt_awaited_in_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    def opened(plug: Plug) -> None:
        seen.append(machine.status.state)
        raise PortMissing("no such port")

    monkeypatch.setattr(Plug, "open", opened)
    machine = unplugged(tmp_path)
    machine.standby = SimpleNamespace(halt_asked=True, position=None)  # type: ignore[assignment]
    with pytest.raises(PortMissing):
        process.connect(machine)
    assert seen == [StationState.CONNECTING]


# --- print on a station's open port, and return to standby
def write_job(path: Path, moves: int, start: tuple[float, float, float]) -> Path:
    x, y, z = start
    lines = ["G21", "G90", "M82", "M302 P1", f"G92 X{x} Y{y} Z{z} E0", f"G1 Z{z - 1} F300"]
    for number in range(1, moves + 1):
        lines.append(
            f"G1 X{x + number % 7 * 0.5} Y{y + number % 5 * 0.5} E{number * 0.01:.3f} F600"
        )
    path.write_text("\n".join([*lines, f"G1 Z{z} F300", "M400"]) + "\n")
    return path


def order(folder: Path, profile: str, moves: int, start=(100, 100, 50)) -> Order:
    folder.mkdir(exist_ok=True)
    job = write_job(folder / "part.gcode", moves, start)
    return Order(job, profile, "simulated", folder / "print", Retreat(lift_mm=5.0))


def back(station: Station) -> list[StationState]:
    """States until the station stands by again, or can't."""
    states = []
    for status in station.events():
        states.append(status.state)
        if status.state in (StationState.READY, StationState.HALTED, StationState.LOST):
            return states
    return states


def test_prints_and_stands_by_where_the_print_ended(at_rest, tmp_path, profile):
    at_rest.mount(syringe="bd_1ml", needle="25g", dish="petri_60mm", dish_centre_mm=(100, 100))
    at_rest.mount(floor_mm=45.0)
    job = order(tmp_path / "run", profile, 40)
    client = at_rest.print(job)
    assert client.wait(300).state is LinkState.DONE
    assert client.status.lines_executed == client.status.lines_done
    assert back(at_rest)[-1] is StationState.READY
    status = at_rest.status
    assert status.print_folder == str(job.folder)
    assert status.message.startswith("print done")
    assert status.position_mm == (102.5, 100, 50)
    assert status.plunger_mm == pytest.approx(0.4)
    assert status.position_trusted
    with pytest.raises(Refused, match="holds a print"):
        at_rest.jog("x", 1)
    at_rest.mount(dish="")
    assert at_rest.jog("x", -2.5).position_mm == (100, 100, 50)
    assert attach_print(job.folder).status.state is LinkState.DONE


def test_a_run_takes_over_what_was_printed_here(at_rest, tmp_path, profile):
    job = order(tmp_path / "run", profile, 10)
    at_rest.print(job).wait(300)
    back(at_rest)
    record = tmp_path / "run" / "executed.npz"
    with np.load(record) as data:
        assert set(range(5, 16)) <= set(data["line"].tolist())
    once = Order(**{**vars(job), "once": True})

    def never() -> str:
        raise AssertionError("it was printed again")

    assert find_or_start(once, never).status.state is LinkState.DONE
    note = record.with_suffix(".json")
    facts = json.loads(note.read_text())
    note.write_text(json.dumps({**facts, "code": "of another version"}))
    with pytest.raises(AssertionError, match="printed again"):
        find_or_start(once, never)


def test_half_a_print_is_no_whole_one(at_rest, tmp_path, profile):
    job = order(tmp_path / "run", profile, 20_000)
    client = at_rest.print(job)
    for status in client.events():
        if status.lines_done > 100:
            break
    client.stop()
    assert client.wait(300).state is LinkState.STOPPED
    assert back(at_rest)[-1] is StationState.READY
    status = at_rest.status
    assert status.position_mm is not None
    assert status.position_mm[2] == pytest.approx(54, abs=0.02), "lifted by 5 mm from Z 49"
    assert not is_complete_record(
        tmp_path / "run" / "executed.npz", job.sha256, load(Printer, profile)
    )


def test_syringe_put_in_during_a_print_is_mounted_after_it_and_what_was_made_is_counted(
    at_rest, tmp_path, profile
):
    at_rest.mount(syringe="bd_1ml")
    client = at_rest.print(order(tmp_path / "run", profile, 20_000))
    wait_for(lambda: client.status.lines_done > 100)
    client.pause()
    until(client, LinkState.PAUSED)
    client.reload()
    wait_for(lambda: client.status.waits_for == "syringe")
    client.resume(NewSyringe(5.0, "bd_3ml", 400.0))
    until(client, LinkState.PRINTING)
    client.stop()
    client.wait(300)
    back(at_rest)
    journal = read_journal(tmp_path / "run" / "print" / "journal.log")
    travel = plunger_travel(load_job(tmp_path / "run" / "part.gcode", load(Printer, profile)).lines)
    changed, made = journal.filled[None].done, client.status.lines_executed
    status = at_rest.status
    assert status.mounted.syringe == "bd_3ml"
    assert status.plunger_mm == pytest.approx(5.0 + travel[made] - travel[changed])


def until(client: PrintClient, state: LinkState) -> None:
    for status in client.events():
        if status.state is state:
            return
        assert not status.ended, status


def test_job_for_another_place_printer_or_nonsense_is_refused(at_rest, tmp_path, profile):
    elsewhere = order(tmp_path / "run", profile, 3, start=(100, 100, 20))
    with pytest.raises(Refused, match=r"starts with the tip at X100.00 Y100.00 Z20.00.*30.00 mm"):
        at_rest.print(elsewhere)
    with pytest.raises(Refused, match="connected is"):
        at_rest.print(Order(elsewhere.job, "marlin_avr", "simulated", tmp_path, Retreat()))
    at_rest.mount(needle="25g")
    (tmp_path / "homes.gcode").write_text("G90\nG28 X\nG1 X5 F600\n")
    with pytest.raises(Refused, match="line 2, homes the printer with the needle 25g"):
        at_rest.print(Order(tmp_path / "homes.gcode", profile, "", tmp_path / "p", Retreat()))
    (tmp_path / "bad.gcode").write_text("M83\n")
    with pytest.raises(JobError, match="relative extrusion"):
        at_rest.print(Order(tmp_path / "bad.gcode", profile, "", tmp_path / "p", Retreat()))
    assert at_rest.status.state is StationState.READY
    assert at_rest.jog("z", 1).position_mm == (100, 100, 51)
