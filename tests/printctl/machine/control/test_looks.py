"""Looks: the print is held at marks until somebody decides; inserts are made once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from printctl.machine.control.look_book import LookDecision, LookRequest
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import Refused
from printctl.machine.job.care import Care, NewSyringe
from printctl.machine.records.states import LinkState
from tests.printctl.machine.control.bench import (
    CALM,
    ENDS,
    JOB,
    LOOKS,
    Bench,
    HostDiedError,
    Instant,
    MemoryJournal,
    assert_exact,
    assert_stood,
    assert_true,
    die,
    insert,
    layers,
    lines_apart,
    made_of,
    mend,
    observe,
    reload,
    resume,
    stop,
)
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.test_families import FAKES, facts

MEND = {1: {"lines": mend(ENDS[0])}}
COUNT = len(MEND[1]["lines"])
FOUR = parse_job(layers(4, 12), "bench.gcode")
GO_ON, PAUSE = LookDecision.GO_ON, LookDecision.PAUSE


def undecided(number: int) -> LookDecision | None:
    """Decide all looks but the first."""
    return None if number == 1 else GO_ON


def looked(bench: Bench) -> list[tuple[int, str]]:
    """Lines taken at each look, and what was decided."""
    return [(one["done"], one["decision"]) for one in bench.recorded("looked")]


def looks(bench: Bench) -> list[dict]:
    """Each look as it was first reported."""
    found = {one.look["number"]: one.look for one in bench.statuses[::-1] if one.look}
    return [found[number] for number in sorted(found)]


def test_print_is_held_after_each_layer_and_an_insert_is_journalled_before_its_answer():
    bench = Bench(JOB, care=LOOKS)
    observe(bench, MEND)
    assert_exact(bench)
    assert [(one["number"], one["layer"]) for one in looks(bench)] == [(1, 0), (2, 1)]
    waits = [one.waits_for for one in bench.statuses if one.state is LinkState.LOOKING]
    assert waits[0] == "a decision on look 1"
    [one] = bench.recorded("insert")
    assert one["after"] == ENDS[0]
    assert (bench.answers[0]["event"], bench.answers[0]["count"]) == (
        "inserted",
        COUNT,
    )
    assert bench.statuses[-1].look is None


@pytest.mark.parametrize(
    ("care", "expected"),
    [
        (Care(None, look_every_mm=0.01), [0, 1, 2, 3]),
        (Care(None, look_every_mm=75.0), [1, 3]),
        (Care(None, look_every_s=1e-3), [0, 1, 2, 3]),
        (Care(None, look_every_s=1e6), []),
        (CALM, []),
    ],
)
def test_looks_by_way_or_time_wait_for_the_next_mark(care, expected):
    bench = Bench(FOUR, care=care)
    observe(bench)
    assert_exact(bench)
    assert [one["layer"] for one in looks(bench)] == expected


@pytest.mark.parametrize("relieves", [True, False])
def test_looks_within_a_layer_come_between_lines(relieves):
    job = lines_apart(2, 5, relieves)
    travels = [k for k, line in enumerate(job.lines) if line.startswith(b"G0 X")]
    bench = Bench(job, care=replace(LOOKS, look_every_written_s=0.2))
    lines = [line.replace("Z9.900", "Z10.000") for line in mend(travels[2], job)]
    observe(bench, {1: {"lines": lines}})
    assert_exact(bench)
    behind = [*(travels[k] for k in (4, 5, 7, 9)), len(job) - 2]
    assert [done for done, _ in looked(bench)] == [travels[2], *(k + COUNT for k in behind)]


@pytest.mark.parametrize("by", ["observer", "user"])
def test_stop_in_a_look_leaves_the_needle_up(by):
    bench = Bench(JOB, care=LOOKS)
    if by == "user":
        bench.when(LinkState.LOOKING, stop)
    else:
        observe(bench, decide=lambda number: LookDecision.STOP)
    status = bench.run()
    assert (status.state, status.position_known) == (LinkState.STOPPED, True)
    assert status.message.startswith(f"cancelled by the {by} while paused")
    assert bench.printer.place["Z"] >= 14.0
    assert_true(bench, status)
    assert_stood(bench)


def test_the_operators_word_ends_a_look():
    bench = Bench(JOB, care=LOOKS)
    bench.when(LinkState.LOOKING, resume, resume)
    assert_exact(bench)
    assert bench.alarms == []
    assert [(one["decision"], one["by"]) for one in bench.recorded("looked")] == [
        ("go_on", "the user")
    ] * 2


@pytest.mark.parametrize("unobserved", [False, True])
def test_look_that_nobody_decides_becomes_a_pause_and_is_made_again_where_somebody_observes(
    unobserved,
):
    bench = Bench(JOB, care=replace(LOOKS, look_limit_s=33.0))
    observe(bench, decide=undecided)
    bench.when(LinkState.PAUSED, lambda streamer: streamer.resume(unobserved=unobserved))
    assert_exact(bench)
    assert bench.recorded("looked")[0]["by"] == "the link"
    assert "no decision within 33 s (look_limit_s)" in bench.pauses[0].message
    assert bench.pauses[0].alarms == 1
    assert len(looked(bench)) == (2 if unobserved else 3)


# --- what is inserted -------------------------------------------------------------------------


def test_only_the_look_that_goes_on_takes_one_insert():
    bench, good = Bench(JOB, care=LOOKS), MEND[1]["lines"]

    def act(streamer: Streamer) -> None:
        number = streamer.status.look["number"]
        with pytest.raises(Refused, match=f"held for look {number}, not for look 7"):
            insert(bench, 7, good)
        if number == 1:
            wrong = (
                ["G28"],
                good,
                [line.partition(" ;")[0] for line in good],
                [*good[:-1], "G4 P10"],
            )
            for lines in wrong:
                insert(bench, 1, lines)
        streamer.look(LookRequest(number, bench.answers.append, print, "", GO_ON))

    def while_printing(streamer: Streamer) -> None:
        with pytest.raises(Refused, match="held for look"):
            insert(bench, 9, good)

    bench.when(LinkState.LOOKING, act, act)
    bench.on_line(3, while_printing)
    assert_exact(bench)
    assert [
        "G28" in bench.refusals[0],
        "has injected G-code of 11 lines already" in bench.refusals[1],
    ] == [True, True]
    first, again = (one for one in bench.answers if one["event"] == "inserted")
    assert first == again
    with pytest.raises(Refused, match="has ended"):
        insert(bench, 1, good)


@pytest.mark.parametrize("again", [True, False])
def test_a_look_is_made_where_an_insert_ends_if_requested(again):
    bench = Bench(JOB, care=LOOKS)
    observe(bench, {1: {**MEND[1], "again": again}})
    assert_exact(bench)
    behind = ENDS[0] + COUNT
    assert ((behind, "go_on") in looked(bench)) is again
    marks = {one["mark"] for one in looks(bench) if one["done"] == behind}
    assert marks == ({"end of the injected G-code"} if again else set())


def test_a_flow_corrected_in_a_look_changes_what_is_written_behind_it():
    bench = Bench(FOUR, care=LOOKS)
    observe(
        bench, {1: {"lines": mend(FOUR.marks.all[0].index, FOUR), "flow": 1.25}, 2: {"flow": 0.8}}
    )
    assert_exact(bench)
    made = made_of(bench.printer, bench.streamer.job.lines)
    pushes = np.array([end["E"] - start["E"] for _, start, end in made if start["X"] != end["X"]])
    own = np.array_split(pushes[(pushes > 1e-6) & (pushes < 0.006)], 4)
    assert [round(float(np.mean(one)) / 0.0035, 2) for one in own] == [1, 1.25, 0.8, 0.8]


def test_a_syringe_that_the_insert_empties_is_changed_earlier_or_the_insert_refused():
    index = FOUR.marks.all[0].index
    thirsty, e = list(mend(index, FOUR)), 0.042 - 0.25
    thirsty[3:6] = [f"G1 E{e + 3.0:.5f} F60", f"G1 X52.5 E{e + 3.01:.5f} F600", "G4 P1"]
    refused = Bench(FOUR, care=replace(LOOKS, capacity_mm=2.0))
    observe(refused, {1: {"lines": thirsty}})
    assert_exact(refused)
    assert "needs more ink than is left" in refused.refusals[0]
    reloads = [one.index for one in FOUR.marks.all if str(one) == "reload point"]
    taken = Bench(FOUR, care=replace(LOOKS, capacity_mm=3.32, reload_at=(reloads[2],)))
    observe(taken, {1: {"lines": thirsty}})
    taken.when(LinkState.PAUSED, lambda streamer: streamer.resume(NewSyringe()))
    assert_exact(taken)
    assert not taken.refusals
    assert [one.lines_done for one in taken.pauses] == [reloads[1] + len(thirsty)]


@pytest.mark.parametrize("firmware", FAKES)
def test_other_families_look_and_insert_as_well(firmware):
    fake = FAKES[firmware]()
    bench = Bench(layers(2, 8), Instant(fake), LOOKS, profile=facts(firmware))
    observe(bench, MEND)
    assert bench.run().state is LinkState.DONE, bench.refusals
    across = [line.decode() for line in bench.streamer.job.lines if b" X" in line or b" Y" in line]
    assert len(bench.streamer.job) == len(bench.job) + COUNT
    assert [line for line in fake.executed if " X" in line or " Y" in line] == across


def test_insert_that_the_disk_has_no_room_for_isnt_taken():
    journal = MemoryJournal()
    bench = Bench(JOB, care=LOOKS, journal=journal)

    def on_a_full_disk(streamer: Streamer) -> None:
        journal.full_at, journal.reserve = len(journal.records), 0
        insert(bench, 1, **MEND[1])
        bench.after(5.0, stop)

    bench.when(LinkState.LOOKING, on_a_full_disk)
    status = bench.run()
    assert status.state is LinkState.STOPPED
    assert bench.journal.history().inserts == []
    assert MEND[1]["lines"][0] not in bench.printer.taken
    assert "isn't accepted" in bench.refusals[0]
    assert_true(bench, status)


# --- looks that fail, or in which a pause is requested ----------------------------------------


@pytest.mark.parametrize("fails", [(1,), (1, 2)])
def test_a_look_that_failed_is_made_again_once_when_the_print_goes_on(fails):
    bench = Bench(JOB, care=LOOKS)
    observe(bench, decide=lambda number: PAUSE if number in fails else GO_ON, again=fails)
    bench.when(LinkState.PAUSED, resume, resume)
    assert_exact(bench)
    decided = ["pause"] * len(fails) + ["go_on"] * (3 - len(fails))
    assert looked(bench) == list(zip([ENDS[0], ENDS[0], ENDS[1]], decided, strict=True))
    said = ["repeats this look", "continues without this look"][: len(fails)]
    assert all(words in one.message for words, one in zip(said, bench.pauses, strict=True))


def test_a_look_whose_host_dies_in_the_pause_is_made_again_once():
    first = Bench(JOB, care=LOOKS)
    observe(first, decide=lambda number: PAUSE, again=(1,))
    first.when(LinkState.PAUSED, die)
    with pytest.raises(HostDiedError):
        first.run()
    bench = Bench(JOB, first.printer, LOOKS, first.journal, resume=True)
    observe(bench)
    assert_exact(bench)
    assert [decision for _, decision in looked(bench)] == ["pause", "go_on", "go_on"]


@pytest.mark.parametrize("mended", [False, True])
def test_a_look_in_which_a_pause_is_requested_is_made_again(mended):
    bench = Bench(JOB, care=LOOKS)

    def act(streamer: Streamer) -> None:
        if mended:
            insert(bench, 1, **MEND[1])
        streamer.pause()

    observe(bench)
    bench._when[LinkState.LOOKING].insert(0, act)
    bench.when(LinkState.PAUSED, resume)
    assert_exact(bench)
    assert looked(bench)[:2] == [(ENDS[0], "pause"), (ENDS[0], "go_on")]
    words = "a pause was requested; `printctl resume RUN` repeats this look"
    assert words in bench.pauses[0].message
    assert len(bench.recorded("insert")) == mended
    assert bool(looks(bench)[1]["insert_sha256"]) is mended


@pytest.mark.parametrize("park", [None, (20.0, 30.0, 40.0)])
def test_pause_decided_in_a_look_takes_inserts_until_the_operator_goes_on(park):
    bench = Bench(JOB, care=replace(LOOKS, look_park_mm=park))
    observe(bench, decide=lambda number: PAUSE)

    def mend_and_resume(streamer: Streamer) -> None:
        insert(bench, 1, **MEND[1])
        streamer.resume()

    bench.when(LinkState.PAUSED, mend_and_resume, resume)
    assert_exact(bench)
    between = [LinkState.PAUSING] if park else []
    way = [LinkState.PAUSING, LinkState.LOOKING, *between, LinkState.PAUSED]
    way += [LinkState.RESUMING, LinkState.PRINTING]
    assert bench.states[3 : 3 + len(way)] == way
    assert len(bench.recorded("insert")) == 1


def test_what_was_inserted_in_a_pause_is_told_where_it_is_looked_again():
    first, lines = Bench(JOB, care=LOOKS), MEND[1]["lines"]
    observe(first, decide=lambda number: PAUSE)
    first.when(LinkState.PAUSED, lambda _: insert(first, 1, lines))
    add = first.journal.add

    def dies(sort: str, **values: object) -> None:
        add(sort, **values)
        if sort == "insert":
            raise HostDiedError

    first.journal.add = dies
    with pytest.raises(HostDiedError):
        first.run()
    first.journal.add = add
    bench = Bench(JOB, first.printer, LOOKS, first.journal, resume=True)

    def tries(streamer: Streamer) -> None:
        with pytest.raises(Refused, match="has injected G-code of"):
            insert(bench, 2, [*lines, "G4 P0"])
        insert(bench, 2, lines)
        bench.streamer.look(LookRequest(2, print, print, "seen", GO_ON))

    observe(bench)
    bench._when[LinkState.LOOKING].insert(0, tries)
    assert_exact(bench)
    assert (bench.answers[0]["event"], bench.answers[0]["look"]) == ("inserted", 2)
    [one] = bench.recorded("insert")
    assert [(each["number"], each["insert_sha256"]) for each in looks(bench)] == [
        (2, one["sha256"]),
        (3, ""),
    ]


@pytest.mark.parametrize("mended", [False, True])
@pytest.mark.parametrize("unchanged", [False, True])
def test_a_question_that_waits_while_the_syringe_is_changed_is_asked_again(unchanged, mended):
    bench = Bench(JOB, care=LOOKS)
    observe(bench, decide=lambda number: PAUSE if number == 1 else GO_ON)

    def changed(streamer: Streamer) -> None:
        if mended:
            insert(bench, 1, **MEND[1])
        streamer.resume(None if unchanged else NewSyringe(1.0), unchanged)

    bench.when(LinkState.PAUSED, reload, changed)
    assert_exact(bench)
    assert len(bench.recorded("insert")) == mended
    places = [done for done, _ in looked(bench)]
    assert places.count(places[0]) == (1 if mended else 2)


@pytest.mark.parametrize(
    ("park", "goes"), [((51.0, 51.0, 10.1), False), ((51.0, 51.0, 40.0), True)]
)
def test_a_needle_isnt_parked_in_the_part(park, goes):
    bench = Bench(JOB, care=replace(LOOKS, look_park_mm=park))
    observe(bench)
    assert_exact(bench)
    there = [one for one in bench.printer.made if tuple(one.end[axis] for axis in "XYZ") == park]
    assert bool(there) is goes
    assert bool(bench.alarms) is not goes
