"""Manual commands during a print: judged by the gate, never ending the print."""

from __future__ import annotations

import pytest

from printctl.machine.link.clock import VirtualClock
from printctl.machine.link.errors import Refused
from printctl.machine.link.states import LinkState
from tests.printctl.machine.link.fake_marlin import FakeTransport
from tests.printctl.machine.link.jobs import parse_job
from tests.printctl.machine.link.layered import Following, Script, layered, played


class Person:
    """Types once, and hears what came of it."""

    def __init__(self, *lines: str) -> None:
        self.lines = lines
        self.heard: list[tuple[bytes, ...]] = []
        self.refused: list[str] = []

    def __call__(self, streamer) -> None:
        self.type(self.lines, streamer)

    def type(self, lines: tuple[str, ...], streamer) -> None:
        for line in lines:
            try:
                streamer.typed(line, self.heard.append, self.refused.append)
            except Refused as exc:
                self.refused.append(str(exc))

    def in_pause(self, streamer) -> None:
        lines, self.lines = self.lines, ()
        if not lines:  # the needle was brought elsewhere, so that the print isn't gone on with
            streamer.stop()
            return
        self.type(lines, streamer)
        streamer.command(b"M105", lambda said: streamer.resume())


def printed_with(tmp_path, person: Person, paused: bool = False):
    data = layered(2, 20)
    request = (lambda streamer: streamer.pause()) if paused else person
    script = Script(at_line={12: request}, on_paused=person.in_pause)
    printer = Following(parse_job(data, "test.gcode"), script)
    transport = FakeTransport(printer, VirtualClock())
    before = len(printer.numbered)
    status = played(data, tmp_path, transport, script)
    return status, printer.numbered[before:]


@pytest.mark.parametrize(
    "line",
    ["G0 Z15 F60", "G 1 Z-50", "g1z2", "G1 F60", "G1 E5 F60", "G28", "G92 Z0", "G91", "M28", "M84"]
    + ["M104 S250", "M92 X1", "M221 S50", "M206 X1", "M211 S0", "M502", "M500", "M111 S8", "T1"]
    + ["M400", "M118 ok", "M112", "M999", "M410", "M108", "M85 S0", "M204 P1", "M302 P0"],
)
def test_what_moves_or_sets_is_refused_in_a_print_which_goes_on(tmp_path, line):
    person = Person(line)
    status, sent = printed_with(tmp_path, person)
    assert status.state is LinkState.DONE, status
    assert len(person.refused) == 1
    assert "printctl station" not in person.refused[0]  # it has no print to act on
    assert ("`printctl kill`" in person.refused[0]) == (line == "M112")
    plain = line.replace(" ", "").upper()
    assert plain not in {text.replace(" ", "") for text in sent if text not in ("M400",)}


def test_questions_fans_and_warmth_within_limits_go_out_in_a_print(tmp_path):
    person = Person("m 105", "M114", "M106 P0 S128", "M104 S37", "M140 S30")
    status, sent = printed_with(tmp_path, person)
    assert status.state is LinkState.DONE, status
    assert person.refused == []
    assert len(person.heard) == 5
    at = sent.index("M106 P0 S128")
    assert sent[at - 2 : at + 3] == ["M105", "M114", "M106 P0 S128", "M104 S37", "M140 S30"]


def test_a_question_that_the_firmware_doesnt_know_ends_no_print(tmp_path):
    person = Person("M119")
    data, script = layered(2, 20), Script(at_line={12: person})
    printer = Following(parse_job(data, "test.gcode"), script)
    said = printer._reply
    printer._reply = lambda word, text: (  # type: ignore[method-assign]
        'echo:Unknown command: "M119"\nok\n' if word == "M119" else said(word, text)
    )
    status = played(data, tmp_path, FakeTransport(printer, VirtualClock()), script)
    assert status.state is LinkState.DONE, status
    assert b"unknown command" in b" ".join(person.heard[0])


def test_in_a_pause_moves_go_by_limits_and_a_feed_of_their_own(tmp_path):
    person = Person("G1 X60", "G1 Z1", "G1 X900", "G1 Z500", "G0 F60000 X61", "G28")
    status, sent = printed_with(tmp_path, person, paused=True)
    assert status.state is LinkState.STOPPED, status
    moved = [text for text in sent if text.startswith("G1 X60")]
    assert moved == ["G1 X60 F300"]
    assert len(person.refused) == 5
    assert "where the pause left it" in person.refused[0]
    assert not any("X900" in text or "Z500" in text or text == "G28" for text in sent)


def test_in_a_pause_the_plunger_goes_no_faster_than_it_may(tmp_path):
    person = Person("G1 E-5 F60", "G1 E0 F60000", "G1 E900 F60", "G1 X51 E0 F60")
    status, sent = printed_with(tmp_path, person, paused=True)
    assert status.state is LinkState.DONE, status
    assert "G1 E-5 F60" in sent
    assert len(person.refused) == 3
