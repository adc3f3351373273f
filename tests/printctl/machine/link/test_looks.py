"""Looks: held at marks, ended by a word; inserts are streamed once, as lines of the job."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from printctl.machine.control.look_book import LookDecision
from printctl.machine.errors import Refused
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.ports.clock import VirtualClock
from printctl.machine.records.journal import Journal
from printctl.machine.records.replay import read_journal
from printctl.machine.records.states import LinkState
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.looking import (
    EVERY_LAYER,
    Dying,
    Observer,
    grown_file,
    layered,
    observed,
    own_strokes,
    patch,
    patch_at,
    written,
)
from tests.printctl.machine.link.scripted_transport import ScriptedTransport
from tests.printctl.machine.link.sim_transport import SimTransport
from tests.printctl.machine.link.simulated import HEADER, foreseen, wire
from tests.printctl.machine.link.simulated_transport import HostDiedError
from tests.printctl.machine.link.test_families import FAKES, facts
from tests.slower import first_of


def test_print_is_held_after_each_layer_until_somebody_has_decided(tmp_path):
    data, transport, observer = layered(3, 20), wire(), Observer()
    status = observed(data, tmp_path, transport, observer)
    assert status.state is LinkState.DONE, status
    looks = [one for one in observer.seen if one.state is LinkState.LOOKING]
    assert [one.look["number"] for one in looks] == [1, 2, 3]
    assert [one.look["layer"] for one in looks] == [0, 1, 2]
    assert looks[0].waits_for == "a decision on look 1"
    assert status.look is None
    assert own_strokes(transport.printer.executed()) == own_strokes(foreseen(data))


WRITES = [1, 13, 25, 37, 49, *range(7, 60, 12), *range(2, 60, 6)]


@pytest.mark.parametrize("part", first_of([0.5, 0.0, 1.0], 1))
@pytest.mark.parametrize("last", first_of(WRITES, 5))
def test_host_killed_about_a_look_streams_the_insert_once(tmp_path, last, part):
    data, transport = layered(2, 12), wire()
    observer = Dying({1: patch(data, 0)}, transport=transport, last=last, part=part)
    with pytest.raises(HostDiedError):
        observed(data, tmp_path, transport, observer)
    goes_on_exactly(data, tmp_path, transport)


@pytest.mark.parametrize("sort", ["look", "left", "insert", "looked"])
@pytest.mark.parametrize("behind", [False, True])
def test_host_killed_about_a_record_streams_the_insert_once(tmp_path, monkeypatch, sort, behind):
    data, transport, add = layered(2, 12), wire(), Journal.add

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
@pytest.mark.parametrize("last", first_of([0, 11, 29, 2, 20, 38, *range(1, 40, 3)], 3))
def test_parked_needle_is_led_back_after_a_kill_as_well(tmp_path, last, park):
    data, transport = layered(2, 12), wire()
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
    second = SimTransport(transport.printer, transport.clock)
    status = observed(data, folder, second, observer, care, resume=resume)
    assert status.state is LinkState.DONE, status
    history = read_journal(folder / "journal.log")
    assert [one.look for one in history.inserts] == [1]
    assert [one["look"] for one in history.looked] == [1, 2]
    expected = foreseen(grown_file(data, history.inserts))
    made, park = transport.printer.executed(), care.look_park_mm
    assert written(made, park) == written(expected, park)
    assert np.array_equal(made.end[-1], expected.end[-1])
    assert made.plunger_end[-1] == pytest.approx(expected.plunger_end[-1])


def spaced(layers, lines, relieves):
    """Layers of lines of 3.5 mm, 30 mm/s, each left by a travel."""
    text, e = [HEADER.decode().rstrip()], 0.0
    for layer in range(layers):
        for k in range(lines):
            text += [f"G0 X50 Y{50 + k:g} F6000", f"G0 Z{10 + 0.25 * layer:g} F300"]
            text += [f"G1 E{e:.5f} F60"] * relieves
            e += 0.0035
            text.append(f"G1 X53.5 E{e:.5f} F1800")
            text += [f"G1 E{e - 0.25:.5f} F60", f"G0 Z{11 + 0.25 * layer:g} F300"] * relieves
        text.append(f";LAYER_END:{layer}")
    return ("\n".join(text) + "\nG0 Z20 F300\nM400\n").encode()


@pytest.mark.parametrize("relieves", [True, False])
@pytest.mark.parametrize("last", first_of([0, 12, 31, *range(1, 60, 4)], 3))
def test_looks_within_a_layer_come_between_lines_and_survive_a_kill(tmp_path, last, relieves):
    data, transport = spaced(2, 5, relieves), wire()
    care = Care(None, look_after=MarkKind.LAYER, look_every_written_s=0.2)
    places = [k for k, line in enumerate(parse_job(data, "a").lines) if line.startswith(b"G0 X")]
    lines = [line.replace("Z9.900", "Z10.000") for line in patch_at(data, places[2])]
    observer = Dying({1: lines}, transport=transport, last=last)
    if last:
        with pytest.raises(HostDiedError):
            observed(data, tmp_path, transport, observer, care)
    again = Observer(observer.says)
    second = SimTransport(transport.printer, transport.clock)
    status = observed(data, tmp_path, second, again, care, resume=last > 0)
    assert status.state is LinkState.DONE, (status, again.refusals)
    history = read_journal(tmp_path / "journal.log")
    (insert,) = history.inserts
    ends = [places[2], places[4], places[5], places[7], places[9], len(parse_job(data, "a")) - 2]
    more = len(insert.lines)
    assert [one["done"] for one in history.looked] == [ends[0], *(end + more for end in ends[1:])]
    assert own_strokes(transport.printer.executed()) == own_strokes(
        foreseen(grown_file(data, [insert]))
    )


def test_a_look_that_nobody_decides_becomes_a_pause_with_an_alarm(tmp_path):
    data, transport = layered(1, 12), wire()
    observer = Observer(decides=lambda number: None)
    care = replace(EVERY_LAYER, look_limit_s=33.0)
    status = observed(data, tmp_path, transport, observer, care)
    assert status.state is LinkState.DONE, status
    paused = next(one for one in observer.seen if one.state is LinkState.PAUSED)
    assert "nobody decided within 33 s (look_limit_s)" in paused.message
    assert paused.alarms == 1
    history = read_journal(tmp_path / "journal.log")
    assert history.looked[0]["decision"] == "pause"
    assert transport.clock.now() > 33


@pytest.mark.parametrize("decides", [LookDecision.STOP, None])
def test_a_look_is_stopped_by_observer_or_operator(tmp_path, decides):
    data, transport = layered(2, 12), wire()
    observer = Observer(decides=lambda number: decides)

    def says(status):
        if status.state is LinkState.LOOKING and decides is None:
            observer.streamer.stop()

    observer.seen_by = says
    status = observed(data, tmp_path, transport, observer)
    assert status.state is LinkState.STOPPED, status
    assert status.position_known
    who = "the observer" if decides else "the user"
    assert status.message.startswith(f"stopped by {who} while paused")
    assert transport.printer.executed().end[-1][2] > 20  # out of the bath


def test_the_operators_word_ends_a_look(tmp_path):
    data, transport = layered(2, 12), wire()
    observer = Observer(decides=lambda number: None)

    def says(status):
        if status.state is LinkState.LOOKING:
            observer.streamer.resume()

    observer.seen_by = says
    status = observed(data, tmp_path, transport, observer)
    assert status.state is LinkState.DONE, status
    assert status.alarms == 0
    told = read_journal(tmp_path / "journal.log").looked
    assert [(one["decision"], one["by"]) for one in told] == [("go_on", "the user")] * 2


@pytest.mark.parametrize(
    ("care", "layers"),
    [
        (Care(None, look_every_mm=0.01), [0, 1, 2, 3]),
        (Care(None, look_every_mm=75.0), [1, 3]),
        (Care(None, look_every_s=1e-3), [1, 2, 3]),  # the time is looked at each 0.25 s
        (Care(None, look_every_s=1e6), []),
        (Care(None), []),
    ],
)
def test_looks_by_way_or_time_wait_for_the_next_mark(tmp_path, care, layers):
    data, transport, observer = layered(4, 12), wire(), Observer()
    status = observed(data, tmp_path, transport, observer, care)
    assert status.state is LinkState.DONE, status
    looks = [one.look["layer"] for one in observer.seen if one.state is LinkState.LOOKING]
    assert looks == layers


def test_a_syringe_that_the_insert_empties_is_changed_earlier_or_the_insert_refused(tmp_path):
    data = layered(4, 12)
    thirsty = [line.replace("E", "E") for line in patch(data, 0)]
    e = 0.042 - 0.25
    thirsty[3:6] = [f"G1 E{e + 3.0:.5f} F60", f"G1 X52.5 E{e + 3.01:.5f} F600", "G4 P1"]
    job = parse_job(data, "a")
    late = job.marks.of(MarkKind.RELOAD)[2].index
    short = replace(EVERY_LAYER, capacity_mm=2.0)
    observer = Observer({1: thirsty})
    status = observed(data, tmp_path, wire(), observer, short)
    assert status.state is LinkState.DONE, status
    assert "needs more ink than is left" in observer.refusals[0]
    planned = replace(EVERY_LAYER, capacity_mm=3.1, reload_at=(late,))
    observer = Observer({1: thirsty})
    (tmp_path / "journal.log").unlink()

    def says(status):
        if status.waits_for == "syringe" and status.state is LinkState.PAUSED:
            observer.streamer.resume(NewSyringe())

    observer.seen_by, observer.resumes = says, False
    status = observed(data, tmp_path, wire(), observer, planned)
    assert status.state is LinkState.DONE, (status, observer.refusals)
    paused = [one.lines_done for one in observer.seen if one.state is LinkState.PAUSED]
    assert paused == [job.marks.of(MarkKind.RELOAD)[1].index + len(thirsty)]


@pytest.mark.parametrize("firmware", FAKES)
def test_other_families_look_and_insert_as_well(tmp_path, firmware):
    data = layered(2, 8).replace(b"M302 P1\n", b"").replace(b"M85 S600\n", b"")
    fake, observer = FAKES[firmware](), Observer({1: patch(data, 0)})
    status = observed(
        data,
        tmp_path,
        ScriptedTransport(fake.receive, VirtualClock()),
        observer,
        firmware=firmware,
        printer=facts(firmware),
    )
    assert status.state is LinkState.DONE, (status, observer.refusals)
    job = parse_job(data, "test.gcode", facts(firmware)).grown_by(
        read_journal(tmp_path / "journal.log").inserts
    )
    across = [line.decode() for line in job.lines if b" X" in line or b" Y" in line]
    assert [line for line in fake.executed if " X" in line or " Y" in line] == across


@pytest.mark.parametrize("last", [0, 30])
def test_a_flow_corrected_in_a_look_changes_what_writes_behind_it(tmp_path, last):
    data, transport = layered(4, 12), wire()
    observer = Dying({1: patch(data, 0)}, transport=transport, last=last)
    observer.flows = {1: 1.25, 2: 0.8}
    if last:
        with pytest.raises(HostDiedError):
            observed(data, tmp_path, transport, observer)
    again = Observer(observer.says, flows=observer.flows)
    second = SimTransport(transport.printer, transport.clock)
    status = observed(data, tmp_path, second, again, resume=last > 0)
    assert status.state is LinkState.DONE, (status, again.refusals)
    made = transport.printer.executed()
    of_layers = np.array_split(pushes_of(made), 4)
    assert [round(float(np.mean(one)) / 0.0035, 2) for one in of_layers] == [1, 1.25, 0.8, 0.8]


def own_moves(motion):
    return (motion.start[:, :2] != motion.end[:, :2]).any(axis=1)


def pushes_of(motion):
    """Pushes of the layers' own strokes: the insert's is another, of 0.01 mm."""
    pushed = (motion.plunger_end - motion.plunger_start)[own_moves(motion)]
    return pushed[(pushed > 1e-6) & (pushed < 0.006)]


# --- looks behind what was inserted: made where its lines end, by another host as well
def made(folder) -> list[tuple[int, str]]:
    """Lines taken and what ended, at each look that an observer was told of."""
    history = read_journal(folder / "journal.log")
    return [int(one["done"]) for one in history.looked]


@pytest.mark.parametrize("again", [True, False])
def test_a_look_is_made_where_an_insert_ends_if_asked_for(tmp_path, again):
    data, transport = layered(2, 12), wire()
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
    assert own_strokes(transport.printer.executed()) == own_strokes(
        foreseen(grown_file(data, [insert]))
    )


@pytest.mark.parametrize("dies_at", ["insert", "looked"])
def test_it_is_made_by_another_host_as_well(tmp_path, monkeypatch, dies_at):
    data, transport, add = layered(2, 12), wire(), Journal.add
    observer = Observer({1: patch(data, 0)}, looks_behind=(1,))

    def dies(journal, name, **values):
        add(journal, name, **values)
        if name == dies_at:
            raise HostDiedError

    with monkeypatch.context() as patched:
        patched.setattr(Journal, "add", dies)
        with pytest.raises(HostDiedError):
            observed(data, tmp_path, transport, observer)
    second, later = SimTransport(transport.printer, transport.clock), Observer()
    status = observed(data, tmp_path, second, later, resume=True)
    assert status.state is LinkState.DONE, status
    (insert,) = read_journal(tmp_path / "journal.log").inserts
    assert made(tmp_path).count(insert.after + len(insert.lines)) == 1


# --- looks that fail (device, judge, disk, nobody decides): made once more when the print goes on
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
