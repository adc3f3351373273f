"""Recovery without a checkpoint, from a held print's, and from one whose motors stood."""

from __future__ import annotations

import pytest

from firmware_profiles import Printer, load
from printctl.machine.link.completed_moves import moves_ahead, surely_moved
from printctl.machine.link.journalled_print import JournalledPrint, read_journal
from printctl.machine.link.recovering import plan_recovery
from printctl.machine.link.recovery_begin import NoCheckpoint
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState, Status
from printctl.machine.link.streamer import Streamer
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import PRINTER, layered
from tests.printctl.machine.link.simulated import gcode, printed, wire

DATA = layered(5, 20)
JOB = parse_job(DATA, "test.gcode")
RETREAT = Retreat(relief_mm=0.3)


def test_without_a_checkpoint_the_first_line_that_may_not_be_made_is_named():
    """Command 60 was taken, 20 moves may be ahead: begin with the line of command 41."""
    with pytest.raises(NoCheckpoint) as refused:
        plan_recovery(JOB, DATA, JournalledPrint(done=60), PRINTER, RETREAT)
    made = surely_moved(JOB.lines, 60, moves_ahead(PRINTER))
    assert refused.value.line == JOB.file_lines[made] > 0
    assert f"line {refused.value.line} is the first" in str(refused.value)
    assert plan_recovery(JOB, DATA, JournalledPrint(done=60), PRINTER, RETREAT, refused.value.line)


def test_where_no_move_was_surely_made_it_is_told_what_to_look_up():
    klipper = PRINTER.model_copy(update={"firmware": "klipper"})
    for printer, done in ((PRINTER, 12), (klipper, 60)):
        with pytest.raises(NoCheckpoint, match="the first line that isn't on the part") as refused:
            plan_recovery(JOB, DATA, JournalledPrint(done=done), printer, RETREAT)
        assert refused.value.line == 0


def test_rest_after_a_power_cut_in_a_pause_begins_where_it_was_held(tmp_path):
    """A job without marks; the motors stood, so that nobody has to say with which line."""
    data = gcode(80)
    transport = wire()
    asked: list[LinkState] = []

    def on_status(status: Status) -> None:
        if status.lines_done > 40 and not asked:
            asked.append(status.state)
            streamers[0].pause()
        if status.state is LinkState.PAUSED and len(asked) == 1:
            asked.append(status.state)
            transport.printer.reset()

    streamers: list[Streamer] = []
    status, _ = printed(data, tmp_path, transport, on_status=on_status, keep=streamers)
    assert status.state is LinkState.POSITION_UNKNOWN
    plan = plan_recovery(
        parse_job(data, "test.gcode"),
        data,
        read_journal(tmp_path / "journal.log"),
        PRINTER,
        RETREAT,
    )
    assert plan.begin == status.lines_done == status.lines_executed > 40


def checkpoint(done: int, **more: bool) -> dict[str, object]:
    return {"t": "checkpoint", "done": done, "mark": "end of layer 1", "agrees": True, **more}


def test_checkpoint_of_a_firmware_that_plans_by_time_counts_where_its_motors_stood():
    """Hundreds of short moves may be ahead: 308 lines were left out on a real Klipper."""
    klipper = load(Printer, "klipper_bioprinter")
    history = JournalledPrint(done=100, checkpoints=[checkpoint(60)])
    with pytest.raises(NoCheckpoint):
        plan_recovery(JOB, DATA, history, klipper, RETREAT)
    stood = JournalledPrint(done=100, made=60, checkpoints=[checkpoint(60, stands=True)])
    assert plan_recovery(JOB, DATA, stood, klipper, RETREAT).begin == 60
