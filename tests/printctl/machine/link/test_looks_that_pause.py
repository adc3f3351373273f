"""Looks that pause: what is put in then is written once, parked needles and dead links included."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from printctl.machine.link.care import NewSyringe
from printctl.machine.link.errors import Refused
from printctl.machine.link.journal import Journal
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.look_book import LookDecision
from printctl.machine.link.states import LinkState
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.layered import PRINTER, START
from tests.printctl.machine.link.looking import (
    EVERY_LAYER,
    Observer,
    fresh,
    grown_file,
    layered,
    observed,
    own_strokes,
    patch,
    written,
)
from tests.printctl.machine.link.simulated_transport import HostDiedError


@pytest.mark.parametrize("park", [None, (20.0, 30.0, 40.0)])
def test_pause_decided_in_a_look_takes_inserts_until_the_operator_goes_on(tmp_path, park):
    data, transport = layered(2, 12), fresh()
    observer = Observer(decides=lambda number: LookDecision.PAUSE)

    def says(status):
        if status.state is LinkState.PAUSED and status.look["number"] == 1:
            observer.insert(1, patch(data, 0))

    observer.seen_by = says
    care = replace(EVERY_LAYER, look_park_mm=park)
    status = observed(data, tmp_path, transport, observer, care)
    assert status.state is LinkState.DONE, (status, observer.refusals)
    goes = [LinkState.PAUSING, LinkState.LOOKING]
    between = [LinkState.PAUSING] if park else []
    way = [*goes, *between, LinkState.PAUSED, LinkState.RESUMING, LinkState.PRINTING]
    assert observer.states[3 : 3 + len(way)] == way
    history = read_journal(tmp_path / "journal.log")
    foreseen = dry_run(
        grown_file(data, history.inserts), PRINTER, START, cold_extrusion=True
    ).executed
    assert len(history.inserts) == 1
    made = transport.printer.executed()
    assert written(made, park) == written(foreseen, park)


@pytest.mark.parametrize(("park", "goes"), [((51.0, 51.0, 10.1), 0), ((51.0, 51.0, 40.0), 2)])
def test_a_needle_isnt_parked_in_the_part(tmp_path, park, goes):
    transport, care = fresh(), replace(EVERY_LAYER, look_park_mm=park)
    status = observed(layered(2, 12), tmp_path, transport, Observer(), care)
    assert status.state is LinkState.DONE, status
    there = np.isclose(transport.printer.executed().end, park).all(axis=1)
    assert there.sum() == goes
    alarms = read_journal(tmp_path / "journal.log").alarms
    assert bool(alarms) is not bool(goes)


def test_what_was_inserted_in_a_pause_is_told_where_it_is_looked_again(tmp_path, monkeypatch):
    data, transport, add = layered(2, 12), fresh(), Journal.add
    observer = Observer(decides=lambda number: LookDecision.PAUSE)

    def says(status):
        if status.state is LinkState.PAUSED and status.look["number"] == 1:
            observer.insert(1, patch(data, 0))

    def dies(journal, name, **values):
        add(journal, name, **values)
        if name == "insert":
            raise HostDiedError

    observer.seen_by = says
    with monkeypatch.context() as patched:
        patched.setattr(Journal, "add", dies)
        with pytest.raises(HostDiedError):
            observed(data, tmp_path, transport, observer)
    (insert,) = read_journal(tmp_path / "journal.log").inserts
    again = Observer()

    def tries(status):
        if status.state is LinkState.LOOKING and status.look["number"] == 2:
            with pytest.raises(Refused, match="has an insert of"):
                again.insert(2, [*patch(data, 0), "G4 P0"])
            again.insert(2, patch(data, 0))

    again.seen_by = tries
    status = observed(data, tmp_path, transport, again, resume=True)
    assert status.state is LinkState.DONE, status
    assert (again.answers[0]["event"], again.answers[0]["look"]) == ("inserted", 2)
    told = [one.look for one in again.seen if one.state is LinkState.LOOKING]
    assert [one["number"] for one in told] == [2, 3]
    assert [one["insert_sha256"] for one in told] == [insert.sha256, ""]
    history = read_journal(tmp_path / "journal.log")
    assert len(history.inserts) == 1
    foreseen = dry_run(grown_file(data, history.inserts), PRINTER, START, cold_extrusion=True)
    assert own_strokes(transport.printer.executed()) == own_strokes(foreseen.executed)


@pytest.mark.parametrize("mended", [False, True])
@pytest.mark.parametrize("unchanged", [False, True])
def test_a_question_that_waits_while_the_syringe_is_changed_is_asked_again(
    tmp_path, unchanged, mended
):
    """To say which syringe is in, `resume` went on without the mend, and nobody was told."""
    data, transport = layered(2, 12), fresh()
    asks = {1: LookDecision.PAUSE}
    observer = Observer(decides=lambda number: asks.get(number, LookDecision.GO_ON), resumes=False)

    def says(status):
        if status.state is not LinkState.PAUSED:
            return
        if status.waits_for != "syringe":
            observer.streamer.reload()
            return
        if mended:
            observer.insert(1, patch(data, 0))
        observer.streamer.resume(None if unchanged else NewSyringe(1.0), unchanged)

    observer.seen_by = says
    status = observed(data, tmp_path, transport, observer)
    assert status.state is LinkState.DONE, status
    history = read_journal(tmp_path / "journal.log")
    assert len(history.inserts) == mended
    looked = [(one["done"], one["decision"]) for one in history.looked]
    assert [done for done, _ in looked].count(looked[0][0]) == (1 if mended else 2)
    grown = grown_file(data, history.inserts)
    foreseen = dry_run(grown, PRINTER, START, cold_extrusion=True).executed
    assert written(transport.printer.executed(), None) == written(foreseen, None)
