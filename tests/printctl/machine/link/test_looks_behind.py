"""Looks behind what was inserted: made where its lines end, by another host as well."""

from __future__ import annotations

import pytest

from printctl.machine.link.journal import Journal
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.look_book import LookDecision
from printctl.machine.link.states import LinkState
from sim.gcode.dry_run.run import dry_run
from tests.printctl.machine.link.layered import PRINTER, START
from tests.printctl.machine.link.looking import (
    Observer,
    fresh,
    grown_file,
    layered,
    observed,
    own_strokes,
    patch,
)
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated_transport import HostDiedError


def made(folder) -> list[tuple[int, str]]:
    """Lines taken and what ended, at each look that an observer was told of."""
    history = read_journal(folder / "journal.log")
    return [int(one["done"]) for one in history.looked]


@pytest.mark.parametrize("again", [True, False])
def test_a_look_is_made_where_an_insert_ends_if_asked_for(tmp_path, again):
    data, transport = layered(2, 12), fresh()
    observer = Observer({1: patch(data, 0)}, looks_behind=(1,) * again)
    status = observed(data, tmp_path, transport, observer)
    assert status.state is LinkState.DONE, (status, observer.refusals)
    (insert,) = read_journal(tmp_path / "journal.log").inserts
    places = made(tmp_path)
    behind = insert.after + len(insert.lines)
    assert (behind in places) is again
    assert len(places) == 2 + again
    told = [one.look["mark"] for one in observer.seen if one.look and one.look["done"] == behind]
    assert set(told) == ({"end of what was inserted"} if again else set())
    foreseen = dry_run(grown_file(data, [insert]), PRINTER, START, cold_extrusion=True)
    assert own_strokes(transport.printer.executed()) == own_strokes(foreseen.executed)


def test_one_that_failed_there_keeps_its_name_when_it_is_made_again(tmp_path):
    observer = Observer(
        {1: patch(data := layered(2, 12), 0)},
        looks_behind=(1,),
        decides=lambda number: LookDecision.PAUSE if number == 2 else LookDecision.GO_ON,
        fails=(2,),
    )
    assert observed(data, tmp_path, fresh(), observer).state is LinkState.DONE
    told = {one.look["number"]: one.look["mark"] for one in observer.seen if one.look}
    assert told[2] == told[3] == "end of what was inserted"
    assert told[4] != told[3]


@pytest.mark.parametrize("dies_at", ["insert", "looked"])
def test_it_is_made_by_another_host_as_well(tmp_path, monkeypatch, dies_at):
    data, transport, add = layered(2, 12), fresh(), Journal.add
    observer = Observer({1: patch(data, 0)}, looks_behind=(1,))

    def dies(journal, name, **values):
        add(journal, name, **values)
        if name == dies_at:
            raise HostDiedError

    with monkeypatch.context() as patched:
        patched.setattr(Journal, "add", dies)
        with pytest.raises(HostDiedError):
            observed(data, tmp_path, transport, observer)
    wire, later = SimTransport(transport.printer, transport.clock), Observer()
    status = observed(data, tmp_path, wire, later, resume=True)
    assert status.state is LinkState.DONE, status
    (insert,) = read_journal(tmp_path / "journal.log").inserts
    assert made(tmp_path).count(insert.after + len(insert.lines)) == 1
