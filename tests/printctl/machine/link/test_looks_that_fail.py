"""Looks that fail (device, judge, disk, nobody decides): made once more when the print goes on."""

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
from tests.printctl.machine.link.looking import (
    EVERY_LAYER,
    Observer,
    grown_file,
    layered,
    observed,
    own_strokes,
    patch,
    written,
)
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import foreseen, wire
from tests.printctl.machine.link.simulated_transport import HostDiedError


def failing(*numbers: int, **more: object) -> Observer:
    """An observer whose looks of these numbers fail."""
    decision = dict.fromkeys(numbers, LookDecision.PAUSE)
    return Observer(
        decides=lambda number: decision.get(number, LookDecision.GO_ON), fails=numbers, **more
    )


def looks_at(folder) -> list[tuple[int, str]]:
    """Lines taken at each look, and what was decided."""
    looked = read_journal(folder / "journal.log").looked
    return [(one["done"], one["decision"]) for one in looked]


def paused(observer: Observer) -> list[str]:
    said = [one.message for one in observer.seen if one.state is LinkState.PAUSED]
    return list(dict.fromkeys(said))


def test_a_look_that_failed_is_made_again_when_the_print_goes_on(tmp_path):
    data, transport, observer = layered(2, 12), wire(), failing(1)
    status = observed(data, tmp_path, transport, observer)
    assert status.state is LinkState.DONE, status
    (first, _), (again, decided), (second, _) = looks_at(tmp_path)
    assert (again, decided) == (first, "go_on")
    assert second > first
    assert "makes this look again" in paused(observer)[0]
    assert own_strokes(transport.printer.executed()) == own_strokes(foreseen(data))


def test_a_look_that_failed_twice_is_gone_on_without(tmp_path):
    observer = failing(1, 2)
    status = observed(layered(2, 12), tmp_path, wire(), observer)
    assert status.state is LinkState.DONE, status
    places = [done for done, _ in looks_at(tmp_path)]
    assert places[0] == places[1] < places[2]
    assert "goes on without this look" in paused(observer)[1]


@pytest.mark.parametrize(("unobserved", "times"), [(False, 2), (True, 1)])
def test_a_look_that_nobody_decided_is_made_again_unless_none_observes(tmp_path, unobserved, times):
    observer = Observer(
        decides=lambda number: None if number == 1 else LookDecision.GO_ON, unobserved=unobserved
    )
    care = replace(EVERY_LAYER, look_limit_s=33.0)
    status = observed(layered(1, 12), tmp_path, wire(), observer, care)
    assert status.state is LinkState.DONE, status
    assert len(looks_at(tmp_path)) == times


def test_a_link_that_dies_in_the_pause_makes_the_look_again_once(tmp_path):
    data, transport, observer = layered(2, 12), wire(), failing(1, resumes=False)

    def dies(status):
        if status.state is LinkState.PAUSED:
            raise HostDiedError

    observer.seen_by = dies
    with pytest.raises(HostDiedError):
        observed(data, tmp_path, transport, observer)
    second, later = SimTransport(transport.printer, transport.clock), Observer()
    status = observed(data, tmp_path, second, later, resume=True)
    assert status.state is LinkState.DONE, status
    assert [decision for _, decision in looks_at(tmp_path)] == ["pause", "go_on", "go_on"]


@pytest.mark.parametrize("mended", [False, True])
def test_a_look_in_which_a_pause_is_asked_for_is_made_again(tmp_path, mended):
    """It was gone on without: what was missing there stayed so. A mend made by then counts once."""
    data, transport = layered(2, 12), wire()
    observer = Observer(
        decides=lambda number: None if number == 1 else LookDecision.GO_ON,
        says={1: patch(data, 0)} if mended else {},
    )

    def says(status):
        if status.state is LinkState.LOOKING and status.look["number"] == 1:
            observer.streamer.pause()

    observer.seen_by = says
    status = observed(data, tmp_path, transport, observer)
    assert status.state is LinkState.DONE, status
    (first, decision), (again, _), *_ = looks_at(tmp_path)
    assert (again, decision) == (first, "pause")
    assert (
        "a pause was asked for; `printctl resume RUN` makes this look again" in paused(observer)[0]
    )
    inserts = read_journal(tmp_path / "journal.log").inserts
    assert len(inserts) == mended
    told = [one.look for one in observer.seen if one.state is LinkState.LOOKING]
    assert all(bool(one["insert_sha256"]) is mended for one in told if one["number"] == 2)
    assert own_strokes(transport.printer.executed()) == own_strokes(
        foreseen(grown_file(data, inserts))
    )


# --- looks that pause: what is put in then is written once, parked needles and dead links included
@pytest.mark.parametrize("park", [None, (20.0, 30.0, 40.0)])
def test_pause_decided_in_a_look_takes_inserts_until_the_operator_goes_on(tmp_path, park):
    data, transport = layered(2, 12), wire()
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
    expected = foreseen(grown_file(data, history.inserts))
    assert len(history.inserts) == 1
    made = transport.printer.executed()
    assert written(made, park) == written(expected, park)


@pytest.mark.parametrize(("park", "goes"), [((51.0, 51.0, 10.1), 0), ((51.0, 51.0, 40.0), 2)])
def test_a_needle_isnt_parked_in_the_part(tmp_path, park, goes):
    transport, care = wire(), replace(EVERY_LAYER, look_park_mm=park)
    status = observed(layered(2, 12), tmp_path, transport, Observer(), care)
    assert status.state is LinkState.DONE, status
    there = np.isclose(transport.printer.executed().end, park).all(axis=1)
    assert there.sum() == goes
    alarms = read_journal(tmp_path / "journal.log").alarms
    assert bool(alarms) is not bool(goes)


def test_what_was_inserted_in_a_pause_is_told_where_it_is_looked_again(tmp_path, monkeypatch):
    data, transport, add = layered(2, 12), wire(), Journal.add
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
    assert own_strokes(transport.printer.executed()) == own_strokes(
        foreseen(grown_file(data, history.inserts))
    )


@pytest.mark.parametrize("mended", [False, True])
@pytest.mark.parametrize("unchanged", [False, True])
def test_a_question_that_waits_while_the_syringe_is_changed_is_asked_again(
    tmp_path, unchanged, mended
):
    """To say which syringe is in, `resume` went on without the mend, and nobody was told."""
    data, transport = layered(2, 12), wire()
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
    expected = foreseen(grown)
    assert written(transport.printer.executed(), None) == written(expected, None)
