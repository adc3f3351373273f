"""Looks: held at marks, ended by a word; inserts are streamed once, as lines of the job."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from printctl.link.journal import Journal
from printctl.link.journalled_print import read_journal
from printctl.link.states import LinkState
from sim.dry_run.run import dry_run
from tests.printctl.link.jobs import parse_job
from tests.printctl.link.layered import PRINTER, START
from tests.printctl.link.looking import (
    EVERY_LAYER,
    Dying,
    Observer,
    fresh,
    grown_file,
    layered,
    observed,
    own_strokes,
    patch,
)
from tests.printctl.link.sim_transport import SimTransport
from tests.printctl.link.simulated_transport import HostDiedError


def test_print_is_held_after_each_layer_until_somebody_has_decided(tmp_path):
    data, transport, observer = layered(3, 20), fresh(), Observer()
    status = observed(data, tmp_path, transport, observer)
    assert status.state is LinkState.DONE, status
    looks = [one for one in observer.seen if one.state is LinkState.LOOKING]
    assert [one.look["number"] for one in looks] == [1, 2, 3]
    assert [one.look["layer"] for one in looks] == [0, 1, 2]
    assert looks[0].waits_for == "a decision on look 1"
    assert status.look is None
    foreseen = dry_run(data, PRINTER, START, cold_extrusion=True).executed
    assert own_strokes(transport.printer.executed()) == own_strokes(foreseen)


def test_inserts_are_streamed_as_lines_of_the_job(tmp_path):
    data, transport = layered(3, 20), fresh()
    observer = Observer({1: patch(data, 0), 3: patch(data, 2)})
    status = observed(data, tmp_path, transport, observer)
    assert status.state is LinkState.DONE, (status, observer.refusals)
    history = read_journal(tmp_path / "journal.log")
    assert [one.look for one in history.inserts] == [1, 3], observer.refusals
    assert status.lines_total == status.lines_done == len(parse_job(data, "a")) + 22
    assert status.inserted == history.positions
    grown = grown_file(data, history.inserts)
    foreseen = dry_run(grown, PRINTER, START, cold_extrusion=True).executed
    made = transport.printer.executed()
    assert own_strokes(made) == own_strokes(foreseen)
    assert np.array_equal(made.end[-1], foreseen.end[-1])
    assert made.plunger_end[-1] == pytest.approx(foreseen.plunger_end[-1])


@pytest.mark.parametrize("part", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("last", range(1, 60, 7))
def test_host_killed_about_a_look_streams_the_insert_once(tmp_path, last, part):
    data, transport = layered(2, 12), fresh()
    observer = Dying({1: patch(data, 0)}, transport=transport, last=last, part=part)
    with pytest.raises(HostDiedError):
        observed(data, tmp_path, transport, observer)
    goes_on_exactly(data, tmp_path, transport)


@pytest.mark.parametrize("sort", ["look", "left", "insert", "looked"])
@pytest.mark.parametrize("behind", [False, True])
def test_host_killed_about_a_record_streams_the_insert_once(tmp_path, monkeypatch, sort, behind):
    data, transport, add = layered(2, 12), fresh(), Journal.add

    def dies(journal, name, **values):
        if name != sort or behind:
            add(journal, name, **values)
        if name == sort:
            raise HostDiedError

    observer = Observer({1: patch(data, 0)})
    with monkeypatch.context() as patched:
        patched.setattr(Journal, "add", dies)
        with pytest.raises(HostDiedError):
            observed(data, tmp_path, transport, observer)
    goes_on_exactly(data, tmp_path, transport)


@pytest.mark.parametrize("park", [(20.0, 30.0, 40.0), (20.0, 30.0, 5.0)])
@pytest.mark.parametrize("last", [0, *range(1, 40, 6)])
def test_parked_needle_is_led_back_after_a_kill_as_well(tmp_path, last, park):
    data, transport = layered(2, 12), fresh()
    care = replace(EVERY_LAYER, look_park_mm=park)
    observer = Dying({1: patch(data, 0)}, transport=transport, last=last)
    if last:
        with pytest.raises(HostDiedError):
            observed(data, tmp_path, transport, observer, care)
    goes_on_exactly(data, tmp_path, transport, care, resume=last > 0)
    ends = transport.printer.executed().end
    assert (ends == np.array(park)).all(axis=1).any()
    aside = np.hypot(*(ends[:, :2] - park[:2]).T) > 0.1
    crossing = np.flatnonzero(aside[1:] != aside[:-1]) + 1
    assert (ends[crossing, 2] > 15).all()  # never across but high above the job


def goes_on_exactly(data, folder, transport, care=EVERY_LAYER, resume=True):
    """Go on with the same observer's words; compare with an uninterrupted print of the whole."""
    observer = Observer({1: patch(data, 0)})
    wire = SimTransport(transport.printer, transport.clock)
    status = observed(data, folder, wire, observer, care, resume=resume)
    assert status.state is LinkState.DONE, status
    history = read_journal(folder / "journal.log")
    assert [one.look for one in history.inserts] == [1]
    assert [one["look"] for one in history.looked] == [1, 2]
    foreseen = dry_run(
        grown_file(data, history.inserts), PRINTER, START, cold_extrusion=True
    ).executed
    made, park = transport.printer.executed(), care.look_park_mm
    assert written(made, park) == written(foreseen, park)
    assert np.array_equal(made.end[-1], foreseen.end[-1])
    assert made.plunger_end[-1] == pytest.approx(foreseen.plunger_end[-1])


def written(motion, park):
    """Strokes across, but for the way to the parking place and back."""
    return [one for one in own_strokes(motion) if park is None or one[3] or one[2] < 12]
