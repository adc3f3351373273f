"""Finding prints of a job: running, printed or interrupted."""

from __future__ import annotations

import io
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from firmware_profiles import Printer, Syringe, load
from printctl.checks.preflight import Check, gcode_checks, refuse_failed, syringe_checks
from printctl.errors import PrintctlError, SafetyError
from printctl.machine.link.find_link import alive
from printctl.machine.link.job import Job
from printctl.machine.link.journal import Journal
from printctl.machine.link.locking import lock
from printctl.machine.link.record import JOURNAL
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState, PrintOutcome, Status
from printctl.machine.link.syringe_change import CHANGE
from printctl.machine.printing import Order, find_or_start, running, with_reloads
from printctl.machine.printing.watch import follow
from printctl.progress import StageBars
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import START, layered
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
    assert again.wait(30).state is LinkState.KILLED


def test_another_file_is_refused_while_one_prints(tmp_path: Path, port: str) -> None:
    order = _order(tmp_path, port)
    client = find_or_start(order, lambda: port)
    order.job.write_text(order.job.read_text() + "G1 X1\n")
    try:
        with pytest.raises(PrintctlError, match="another file"):
            running(order)
    finally:
        client.kill()
        client.wait(30)


def test_interrupted_print_is_neither_repeated_nor_resumed_unasked(
    tmp_path: Path, port: str
) -> None:
    order = _order(tmp_path, port)
    client = find_or_start(order, lambda: port)
    for status in client.events():
        if status.lines_done > 20:
            break
    os.kill(client.record.pid, signal.SIGKILL)
    client.wait(30)
    with pytest.raises(SafetyError, match="--resume"):
        find_or_start(order, lambda: port)
    text = order.job.read_text()
    order.job.write_text(text + "G1 X1\n")  # as of a recipe that was changed meanwhile
    with pytest.raises(SafetyError, match=r"another file was interrupted.*give-up"):
        find_or_start(replace(order), lambda: port)
    order.job.write_text(text)
    resumed = find_or_start(replace(order, resume=True), lambda: port)
    resumed.kill()
    resumed.wait(30)


# --- test_who_is_alive
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

    def wait(self) -> PrintOutcome:
        return PrintOutcome(LinkState.DONE, 5, 5, "all 5 lines done")


def test_each_alarm_is_said_in_words_while_a_print_is_followed(tmp_path):
    screen = io.StringIO()
    bars = StageBars(Console(file=screen, width=200))
    with bars.all(), bars.stage("print") as report:
        follow(Told(tmp_path), report, bars)
    assert screen.getvalue().splitlines() == [
        "print          note: 1 alarm: M204 R is 500",
        "print          note: 2 alarms, the last: M203 X is 90",
    ]


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
    screen = io.StringIO()
    bars = StageBars(Console(file=screen, width=2000))
    with bars.all(), bars.stage("print") as report:
        follow(Held(tmp_path), report, bars)
    syringe, pause = screen.getvalue().splitlines()
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
    told, reload_at = with_reloads(checks(), job(), 0.5, wanted=False)
    assert reload_at == ()
    with pytest.raises(SafetyError, match=r"give --reload: the syringe is then changed before l"):
        refuse_failed(told)


def test_change_that_is_agreed_to_satisfies_the_checks_it_concerns_and_no_other():
    told, reload_at = with_reloads(checks(), job(), 0.5, wanted=True)
    refuse_failed(told)
    points = [mark.index for mark in job().marks.all]
    assert len(reload_at) >= 2
    assert set(reload_at) <= set(points)
    wrong = Check("x, highest", 300.0, 200.0, "mm", False)
    with pytest.raises(SafetyError, match="x, highest"):
        refuse_failed(with_reloads([wrong, *checks()], job(), 0.5, wanted=True)[0])


# --- lines of inserts for the live view: where they write, and whether they are executed
