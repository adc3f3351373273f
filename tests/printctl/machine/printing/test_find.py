"""Finding prints of a job: running, printed or interrupted."""

from __future__ import annotations

import io
import os
import signal
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from firmware_profiles import Printer, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.checks.kinds import Kind
from printctl.checks.preflight import Check, gcode_checks, refuse_failed, syringe_checks
from printctl.errors import PrintctlError, SafetyError
from printctl.machine.control.excursion import CHANGE
from printctl.machine.errors import LinkError, PortMissing, Refused
from printctl.machine.job.care import Care
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.job.syringes import capacity_mm, usable_mm, with_reloads
from printctl.machine.ports.locking import lock
from printctl.machine.prints.follow import follow
from printctl.machine.prints.recovery_file import planned, write_rest
from printctl.machine.prints.state import PrintTruth, read_print
from printctl.machine.process.clients.starting import find_or_start, resume_print, running
from printctl.machine.process.contact import alive, hold_folder
from printctl.machine.process.orders import Order
from printctl.machine.process.outcome import resumable
from printctl.machine.records.journal import Journal
from printctl.machine.records.record import JOURNAL, ContactRecord, load_record
from printctl.machine.records.states import LinkState, Status
from printctl.observe.continue_print import continue_print
from printctl.observe.observer_launch import ObserverError
from printctl.observe.records import OBSERVER_LOCK, ORDER_FILE, READY_FILE, LookRecord, save_look
from printctl.progress import StageBars
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import layered
from tests.printctl.machine.link.simulated import START
from tests.printctl.machine.link.test_halting import JOB
from tests.sim_process import printer_process

MOVES = 3000


@pytest.fixture
def port(tmp_path: Path) -> Iterator[str]:
    """A simulated printer that a host takes for a real one; slow enough to be caught printing."""
    with printer_process(tmp_path, speed=5) as name:
        yield name


def _order(folder: Path, port: str, moves: int = MOVES) -> Order:
    job = folder / "job.gcode"
    lines = ["G21", "G90", "M82", "G92 X0 Y0 Z0 E0"]
    lines += [f"G1 X{5 * (k % 2)} F3000" for k in range(1, moves + 1)]
    job.write_text("\n".join([*lines, "M400"]) + "\n")
    return Order(job, "generic_marlin", port, folder / "print", Retreat())


def test_print_that_goes_on_is_found_again(tmp_path: Path, port: str) -> None:
    order = _order(tmp_path, port)
    first = find_or_start(order, lambda: port)
    pid = first.record.pid
    first.detach()
    again = find_or_start(order, lambda: pytest.fail("a second print was started"))
    assert again.record.pid == pid
    again.kill()
    assert again.wait(300).state is LinkState.KILLED


def test_another_file_is_refused_while_one_prints(tmp_path: Path, port: str) -> None:
    order = _order(tmp_path, port)
    client = find_or_start(order, lambda: port)
    order.job.write_text(order.job.read_text() + "G1 X1\n")
    try:
        with pytest.raises(PrintctlError, match="another file"):
            running(order)
    finally:
        client.kill()
        client.wait(300)


def test_interrupted_print_is_neither_repeated_nor_resumed_unasked(
    tmp_path: Path, port: str
) -> None:
    order = _order(tmp_path, port)
    client = find_or_start(order, lambda: port)
    for status in client.events():
        if status.lines_done > 20:
            break
    os.kill(client.record.pid, signal.SIGKILL)
    client.wait(300)
    with pytest.raises(SafetyError, match="--resume"):
        find_or_start(order, lambda: port)
    text = order.job.read_text()
    order.job.write_text(text + "G1 X1\n")  # as of a recipe that was changed meanwhile
    way_out = rf"Restore that file at {order.job}, then `printctl resume .*give-up"
    with pytest.raises(SafetyError, match=rf"was interrupted.*{way_out}"):
        find_or_start(replace(order), lambda: port)
    with pytest.raises(SafetyError, match=way_out):
        find_or_start(replace(order, resume=True), lambda: port)
    with pytest.raises(LinkError, match=way_out):
        resume_print(order.folder)
    order.job.write_text(text)
    resumed = find_or_start(replace(order, resume=True), lambda: port)
    resumed.kill()
    resumed.wait(300)


# --- whether a lock's holder is alive
HELD = "some.lock"


def test_many_who_ask_at_once_dont_take_each_other_for_the_holder(tmp_path: Path) -> None:
    """Else a print whose station was killed was taken for one whose printer is in use again."""
    (tmp_path / HELD).touch()

    def ask(_: int) -> bool:
        return any(alive(tmp_path, HELD) for _ in range(500))

    with ThreadPoolExecutor(4) as pool:
        assert not any(pool.map(ask, range(4)))


def test_a_holder_is_seen(tmp_path: Path) -> None:
    with (tmp_path / HELD).open("a+b") as handle:
        lock(handle)
        assert alive(tmp_path, HELD)
    assert not alive(tmp_path, HELD)


# --- following a print from the command line
class Told:
    """A client of a print whose board disagrees twice with the profile."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def events(self) -> Iterator[Status]:
        journal = Journal(self.folder / JOURNAL)
        journal.add("job", sha256="a", started=0.0)
        for count, text in enumerate(("M204 R is 500", "M203 X is 90"), 1):
            journal.add("alarm", text=text)
            yield Status(LinkState.PRINTING, lines_total=5, alarms=count)
            yield Status(LinkState.PRINTING, lines_done=count, lines_total=5, alarms=count)
        journal.close()

    def wait(self) -> Status:
        return Status(LinkState.DONE, 5, 5, message="all 5 lines done")


def followed(client: Told) -> list[str]:
    """Lines on the screen while a print is followed."""
    screen = io.StringIO()
    bars = StageBars(Console(file=screen, width=2000))
    with bars.all(), bars.stage("print") as report:
        follow(client, report, bars)
    return screen.getvalue().splitlines()


def test_progress_is_plain_lines_where_no_bar_can_be_drawn(monkeypatch):
    """After 10 s with 5 % more done, or after 30 s: on a dumb terminal as in a file."""
    now_s = [0.0]
    monkeypatch.setattr("printctl.progress.monotonic", lambda: now_s[0])
    screen = io.StringIO()
    console = Console(file=screen, width=80, force_terminal=True, _environ={"TERM": "dumb"})
    bars = StageBars(console)
    with bars.all(), bars.stage("print") as report:
        for now_s[0], done in ((5, 0.3), (10, 0.4), (21, 0.44), (39, 0.44), (40, 0.44), (51, 0.6)):
            report(done, f"{done:.2f} of 1 lines")
    bars.say("print", "51.0 s")
    assert screen.getvalue().splitlines() == [
        "print          40% 0.40 of 1 lines",
        "print          44% 0.44 of 1 lines",
        "print          60% 0.60 of 1 lines",
        "print          51.0 s",
    ]


def test_each_alarm_is_said_in_words_while_a_print_is_followed(tmp_path):
    first, second = followed(Told(tmp_path))
    assert first.endswith("note: 1 alarm: M204 R is 500")
    assert second.endswith("note: 2 alarms, the last: M203 X is 90")


class Held(Told):
    """A client of a print that is held for a syringe, twice asked, then for a person's pause."""

    def events(self) -> Iterator[Status]:
        change = f"paused at line 7: {CHANGE}"
        yield Status(LinkState.PAUSING, message="the needle is lifted", lines_total=5)
        for _ in range(2):
            yield Status(LinkState.PAUSED, message=change, lines_total=5, waits_for="syringe")
        yield Status(LinkState.PRINTING, message="printing", lines_total=5)
        yield Status(LinkState.PAUSED, message="paused at line 9", lines_total=5)


def test_what_a_pause_waits_for_is_said_once_with_the_command_that_goes_on(tmp_path):
    syringe, pause = followed(Held(tmp_path))
    assert "change the syringe" in syringe
    assert f"printctl resume {tmp_path} --plunger-mm" in syringe
    assert "paused at line 9" in pause
    assert f"printctl resume {tmp_path}`" in pause


# --- job needing several syringes: refused with an offer, or planned with changes
PRINTER = load(Printer, "generic_marlin").model_copy(update={"plunger_travel_mm": 0.5})
SYRINGE = load(Syringe, "hamilton_1ml")
DATA = layered(6, 60)


def checks() -> list[Check]:
    run = dry_run(DATA, PRINTER, START)
    return [*gcode_checks(run, PRINTER), *syringe_checks(run, PRINTER, SYRINGE)]


def job() -> Job:
    return parse_job(DATA, "test.gcode")


def test_job_that_needs_more_is_refused_with_the_lines_of_a_change():
    found = with_reloads(checks(), job(), (0.5,), wanted=False, by="specify --reload")
    assert found.at == ()
    assert found.offered
    with pytest.raises(SafetyError, match=r"specify --reload: the syringe is then changed"):
        refuse_failed(found.checks)


def test_change_that_is_agreed_to_satisfies_the_checks_it_concerns_and_no_other():
    found = with_reloads(checks(), job(), (0.5,), wanted=True, by="specify --reload")
    refuse_failed(found.checks)
    points = [mark.index for mark in job().marks.all]
    assert len(found.at) >= 2
    assert set(found.at) <= set(points)
    wrong = Check(Kind.TRAVEL, "x, highest", 300.0, 200.0, "mm", False)
    with pytest.raises(SafetyError, match="x, highest"):
        refuse_failed(with_reloads([wrong, *checks()], job(), (0.5,), wanted=True, by="").checks)


# --- syringe change reported to a print whose link process died beforehand
module = sys.modules[continue_print.__module__]


def journalled(folder: Path, *records: dict[str, Any], care: Care | None = None) -> str:
    """Leave a print of the job whose process is gone, and its journal; return the job's hash."""
    file = folder / "a.gcode"
    file.write_text(JOB)
    job = parse_job(JOB.encode(), "a.gcode")
    record = ContactRecord(0, "", "", str(file), "generic_marlin", "/dev/nowhere", 0.0)
    replace(record, care=care.to_dict() if care else record.care).save(folder)
    journal = Journal(folder / JOURNAL)
    journal.add("job", sha256=job.sha256, lines=len(job))
    for one in records:
        journal.add(**one)
    journal.close()
    return job.sha256


PRINTING = {"sort": "state", "state": LinkState.PRINTING, "message": "printing"}
END = {"sort": "end", "done": 30, "position_known": True}


def broken_off(folder: Path, wanted: str, *records: dict[str, Any], **care: Any) -> str:
    """Leave a print whose process was killed while the needle was being lifted."""
    lifting = {"sort": "state", "state": LinkState.PAUSING, "message": "lifting the needle"}
    asked, done = {"sort": "wanted", "after": wanted}, {"sort": "ack", "done": 30}
    return journalled(folder, PRINTING, asked, lifting, done, *records, care=Care(**care))


@pytest.mark.parametrize(
    ("wanted", "then"),
    [("reload", "the change asked for is made first"), ("", "`printctl reload RUN` makes room")],
)
def test_it_is_refused_with_the_way_to_change(tmp_path, wanted, then):
    broken_off(tmp_path, wanted)
    with pytest.raises(PrintctlError, match=r"wasn't held for a change of syringe") as refused:
        continue_print(tmp_path, plunger_mm=0.0)
    assert then in str(refused.value)


def test_a_print_with_looks_does_not_go_on_without_an_observer_unless_told_so(tmp_path):
    broken_off(tmp_path, "", look_after=MarkKind.LAYER)
    (tmp_path / ORDER_FILE).write_text("{}")
    with pytest.raises(ObserverError, match=r"Nothing was moved.*--unobserved"):
        continue_print(tmp_path)
    assert not (tmp_path / READY_FILE).exists()
    with pytest.raises(PortMissing):  # so far it comes
        continue_print(tmp_path, unobserved=True)


@pytest.mark.parametrize(
    ("state", "started", "asked", "resumed"),
    [
        (LinkState.LOOKING, True, "", 0),  # else its picture is of a print that goes on
        (LinkState.LOOKING, False, "", 1),
        (LinkState.PAUSED, True, "", 1),
        (LinkState.PAUSED, True, "mend", 0),  # else the gap is lost with the observer that died
        (LinkState.PAUSED, False, "mend", 1),
    ],
)
def test_a_new_observer_makes_the_look_that_the_print_is_held_for(
    tmp_path, monkeypatch, state, started, asked, resumed
):
    said = []
    waits = "a decision" if state is LinkState.LOOKING else ""
    look = {"number": 4, "decision": "" if waits else "pause"}
    client = SimpleNamespace(
        status=SimpleNamespace(state=state, waits_for=waits, ended=False, look=look),
        resume=lambda *words: said.append(words),
    )
    save_look(tmp_path, LookRecord(4, 9, 9, "end of layer 1", 1.0, "pause", "1 gap", asked))
    monkeypatch.setattr(module, "attach", lambda _: nullcontext(client))
    monkeypatch.setattr(module, "refuse_remounted", lambda _: None)  # no print was started
    monkeypatch.setattr(module, "ensure_observer", lambda _: started)
    assert continue_print(tmp_path) is client.status
    assert len(said) == resumed


@pytest.mark.parametrize(("unobserved", "resumed"), [(False, 0), (True, 1)])
def test_a_look_that_is_being_judged_is_not_gone_on_with(
    tmp_path, monkeypatch, unobserved, resumed
):
    said = []
    look = {"number": 4, "decision": "", "limit_s": 120.0}
    client = SimpleNamespace(
        status=SimpleNamespace(
            state=LinkState.LOOKING, waits_for="a decision", ended=False, look=look
        ),
        resume=lambda *words: said.append(words),
    )
    monkeypatch.setattr(module, "attach", lambda _: nullcontext(client))
    monkeypatch.setattr(module, "refuse_remounted", lambda _: None)  # no print was started
    with hold_folder(tmp_path, OBSERVER_LOCK, "an observer is at work"):
        refused = pytest.raises(PrintctlError, match=r"look 4 is being judged.*120 s.*--unobserved")
        with nullcontext() if unobserved else refused:
            continue_print(tmp_path, unobserved=unobserved)
    assert len(said) == resumed


def test_of_a_print_that_failed_the_way_to_its_rest_is_told(tmp_path):
    sha256 = broken_off(tmp_path, "", {**END, "state": "failed", "message": "disk full"})
    with pytest.raises(Refused, match="`printctl recover` writes its rest"):
        resumable(tmp_path, sha256)


# --- true state of a stopped print: `stood`, if certain, says how much was printed
TAKEN, STOOD = 30, 17


def left_behind(folder: Path, state: LinkState, stood: dict[str, Any] | None) -> PrintTruth:
    """What is told of a print whose process ended before it could leave its last status."""
    records = [PRINTING, {"sort": "ack", "done": TAKEN}]
    if stood is not None:
        records.append({"sort": "stood", "done": TAKEN, "begin_at": None, "dropped": True, **stood})
    journalled(folder, *records, {**END, "state": state, "message": "", "error": ""})
    return read_print(folder)


@pytest.mark.parametrize(
    ("stood", "made"),
    [
        ({"line": STOOD, "certain": True}, STOOD),
        ({"line": 11, "certain": False}, 10),  # 20 moves may have been ahead
        (None, 10),
    ],
)
def test_moves_that_a_stop_dropped_count_as_not_made(tmp_path, stood, made):
    truth = left_behind(tmp_path, LinkState.STOPPED, stood)
    assert truth.status.lines_executed == made
    assert truth.share == pytest.approx(made / truth.status.lines_total)
    assert truth.words["made"] == f"at least {made} of {truth.status.lines_total} lines made"
    assert truth.to_dict()["lines_executed"] == made


def test_a_print_of_which_no_line_was_sent_has_nothing_to_recover(tmp_path):
    asking = "identifying the firmware"
    journalled(tmp_path, {"sort": "state", "state": LinkState.CHECKING, "message": asking})
    assert "print it anew" in read_print(tmp_path).status.message
    assert "Recover" not in read_print(tmp_path).status.message
    with pytest.raises(PrintctlError, match="no line of the job was sent"):
        planned(tmp_path, 3)


@pytest.mark.parametrize("care", [Care(), Care(look_after=MarkKind.LAYER)])
def test_of_an_observed_print_it_is_told_that_nobody_looks_at_the_rest(tmp_path, care):
    """Command line and page told the plan's steps, which left it out."""
    left_behind(tmp_path, LinkState.STOPPED, None)
    replace(load_record(tmp_path), care=care.to_dict()).save(tmp_path)
    plan = planned(tmp_path, 20)
    told = [step for step in plan.steps if "nobody looks at the rest" in step]
    assert len(told) == (1 if care.looks else 0)
    written = write_rest(tmp_path, plan)
    assert written["steps"] == list(plan.steps)


def test_drive_or_syringe_limits_whichever_is_shorter():
    assert capacity_mm(SYRINGE) == pytest.approx(58.71, abs=0.01)
    assert usable_mm(SYRINGE, PRINTER) == 0.5
    assert usable_mm(SYRINGE, load(Printer, "generic_marlin")) == capacity_mm(SYRINGE)


@pytest.mark.parametrize("changed", [False, True])
def test_resume_of_a_print_that_has_ended_says_how_it_ended_and_what_is_left(tmp_path, changed):
    """Not that its printer has forgotten it, nor that its process died."""
    folder = tmp_path / "print"
    folder.mkdir()
    (tmp_path / "job.gcode").write_text("G1 X1\n")
    job = str(tmp_path / "job.gcode")
    ended = Status(LinkState.STOPPED, message="cancelled by the user", position_known=True)
    ContactRecord(0, "", "", job, "generic_marlin", "simulated", 0.0, status=ended.to_dict()).save(
        folder
    )
    journal = Journal(folder / JOURNAL)
    journal.add("job", id="1", name="job.gcode", lines=1)
    journal.add("state", state="printing", message="")
    journal.add("end", state="stopped", message=ended.message, done=1, position_known=True)
    journal.close()
    words = r"has ended \(cancelled: cancelled by the user\).*`printctl recover` writes its rest"
    with pytest.raises(Refused, match=words):
        continue_print(folder, plunger_mm=0.0 if changed else None)
