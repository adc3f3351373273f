"""Jobs that have grown by inserts: rest after a power cut, true state, counts of the file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from printctl.cli.status import waiting_lines
from printctl.machine.link.find_link import read_outcome
from printctl.machine.link.inserts import Insert
from printctl.machine.link.journal import Journal
from printctl.machine.link.journalled_print import JournalledPrint
from printctl.machine.link.marks import MarkKind
from printctl.machine.link.record import JOURNAL, LinkRecord
from printctl.machine.link.recovering import plan_recovery
from printctl.machine.link.reloading import plunger_travel
from printctl.machine.link.retreat import Retreat
from printctl.machine.link.states import LinkState, Status
from printctl.machine.print_state.actions import possible_actions
from printctl.machine.printing.inserted_ink import filling_in_file, inserted_ink
from printctl.machine.printing.map_of_rest import OF_LINES, write_map
from printctl.machine.printing.progress import Filling
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import PRINTER
from tests.printctl.machine.link.looking import layered, patch

DATA = layered(3, 6)
OWN = parse_job(DATA, "test.gcode")
ENDS = [mark.index for mark in OWN.marks.of(MarkKind.LAYER)]


def mend(layer: int, look: int, before: int) -> Insert:
    lines = parse_job("\n".join(patch(DATA, layer)).encode(), "a").lines
    return Insert(look, ENDS[layer] + before, tuple(lines), "a gap")


FIRST, SECOND = mend(0, 1, 0), mend(1, 2, 11)
GROWN = OWN.grown(FIRST).grown(SECOND)


@pytest.mark.parametrize("begin", range(8, len(GROWN) - 1))
def test_rest_from_any_line_of_a_grown_job_is_the_grown_jobs(begin):
    stood = {"line": begin, "begin_at": None, "certain": True, "dropped": False, "done": begin}
    plan = plan_recovery(GROWN, DATA, JournalledPrint(stood=stood), PRINTER, Retreat())
    rest = parse_job(plan.gcode, "rest").lines
    assert rest[len(rest) - (len(GROWN) - begin) :] == GROWN.lines[begin:]


@pytest.mark.parametrize("begin", range(12, len(GROWN) - 13, 4))
def test_rest_of_a_job_whose_flow_was_corrected_has_its_doses(begin):
    data = DATA.replace(b"F1800\n", b"F1800 ; here\n")
    job = parse_job(data, "test.gcode")
    grown = job.grown(replace(FIRST, flow=1.3)).grown(Insert(2, SECOND.after, (), "", 0.9))
    stood = {"line": begin, "begin_at": None, "certain": True, "dropped": False, "done": begin}
    plan = plan_recovery(grown, data, JournalledPrint(stood=stood), PRINTER, Retreat())
    rest = parse_job(plan.gcode, "rest").lines
    assert rest[len(rest) - (len(grown) - begin) :] == grown.lines[begin:]
    travel = plunger_travel(grown.lines)
    own = plunger_travel(job.lines)
    third = ENDS[1] + 11, ENDS[2] + 11
    writes = [k for k in range(*third) if b" X" in grown.lines[k] and b" E" in grown.lines[k]]
    ratios = [(travel[k + 1] - travel[k]) / (own[k - 10] - own[k - 11]) for k in writes]
    assert ratios == pytest.approx([0.9] * len(writes), abs=5e-3)


def test_the_rests_map_has_nothing_of_what_was_put_in(tmp_path):
    count = DATA.count(b"\n")
    job = tmp_path / "a.gcode"
    job.write_bytes(DATA)
    np.savez(tmp_path / "a.map.npz", **{name: np.arange(count) for name in OF_LINES})
    begin = FIRST.after + 4
    stood = {"line": begin, "begin_at": None, "certain": True, "dropped": False, "done": begin}
    plan = plan_recovery(GROWN, DATA, JournalledPrint(stood=stood), PRINTER, Retreat())
    rest = tmp_path / "rest.gcode"
    rest.write_bytes(plan.gcode)
    write_map(job, plan, rest)
    source = np.load(tmp_path / "rest.map.npz")["source"].tolist()
    rows = plan.gcode.splitlines()
    assert len(source) == len(rows)
    own = DATA.splitlines()
    told = [(own[at], row) for at, row in zip(source, rows, strict=True) if at >= 0]
    assert all(one == other for one, other in told)
    assert len(told) == count - (OWN.file_lines[FIRST.after] - 1)


def test_an_interrupted_print_counts_what_was_put_in(tmp_path):
    file = tmp_path / "a.gcode"
    file.write_bytes(DATA)
    LinkRecord(0, "", "", str(file), "generic_marlin", "", 0.0).save(tmp_path)
    journal = Journal(tmp_path / JOURNAL)
    journal.add("job", sha256=OWN.sha256, lines=len(OWN))
    journal.add("state", state=LinkState.PRINTING, message="printing")
    journal.add("insert", **FIRST.to_record(), reload_at=[], reload_heads=[])
    done = FIRST.after + 13
    journal.add("ack", done=done)
    journal.add("state", state=LinkState.LOOKING, message="held")
    journal.close()
    status = read_outcome(tmp_path)
    assert status.lines_total == len(OWN) + 11
    assert status.inserted == ((FIRST.after, 11),)
    assert status.file_line == OWN.file_line(done - 11)
    assert "it was held for a look, so its motors stood" in status.message


def test_ink_of_an_insert_is_taken_from_the_syringe():
    told = inserted_ink(FIRST.to_record())
    assert told.pushed_mm == pytest.approx(0.01)
    filling = Filling(FIRST.after - 3, 5.0, 2.0)
    assert filling_in_file(filling, (told,), FIRST.after).left_mm == 5.0
    assert filling_in_file(filling, (told,), FIRST.after + 1).left_mm == pytest.approx(4.99)
    later = Filling(FIRST.after + 20, 5.0, 2.0)
    assert filling_in_file(later, (told,), FIRST.after + 30) == Filling(FIRST.after + 9, 5.0, 2.0)


def test_a_print_that_is_held_for_a_look_may_be_gone_on_with_by_the_operator(tmp_path):
    status = Status(LinkState.LOOKING, waits_for="a decision on look 3")
    can = {one.action: one.possible for one in possible_actions(tmp_path, status)}
    assert [can[one] for one in ("resume", "pause", "stop", "kill")] == [True] * 4
    assert not can["go_on"]
    assert waiting_lines(status) == ["waits for: a decision on look 3"]
