"""One start, true states, stop from every state: a print on a host over real sockets."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from printctl.machine.errors import HostRefused, HostSilent, Refused
from printctl.machine.network import file_print, http_client
from printctl.machine.network.host import (
    HostEnd,
    HostReport,
    HostRequest,
    HostState,
    parse_address,
)
from printctl.machine.network.hosts import make_host
from printctl.machine.records.journal import read_records
from printctl.machine.records.states import LinkState
from tests.printctl.machine.network import boards
from tests.printctl.machine.network.boards import JOB, BoardServer, Print

STROKES = [line for line in JOB.splitlines() if " E" in line and line.startswith("G1")]
START = r"M32|/machine/code"


def wait(condition: Callable[[], bool], within_s: float = 10.0) -> None:
    limit = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < limit
        time.sleep(0.005)


def printing(one: Print) -> Print:
    wait(lambda: one.film.status.state is LinkState.PRINTING)
    return one


def starts(server: BoardServer) -> int:
    """How often the file was begun: its first line runs at each."""
    lines = server.lines + server.board.run_lines
    return lines.count("G92 X10 Y10 Z5")


def test_prints_every_line_once_and_says_the_hosts_word(server: BoardServer, tmp_path: Path):
    one = Print(tmp_path / "p", server).start()
    status = one.end()
    assert status.state is LinkState.DONE
    assert status.proved
    assert status.lines_done == status.lines_total
    assert "X14.00 Y13.00 Z5.00" in status.message
    assert server.strokes() == STROKES
    assert one.steps() == ["selected", "start", "begun"]
    said = [seen.message for seen in one.seen if seen.state is LinkState.PRINTING]
    assert said
    assert all("says printing" in words and "s ago" in words for words in said)


def test_intention_is_on_the_disk_before_the_start_leaves(server: BoardServer, tmp_path: Path):
    found: list[bool] = []
    one = Print(tmp_path / "p", server)

    def look(path: str) -> None:
        if "M32" in path or (server.sbc and "code" in path and server.board.selected):
            records = [record for record in read_records(one.journal_path) if record]
            found.append(any(record.get("do") == "start" for record in records))

    server.faults.meanwhile = look
    one.start().end()
    assert found
    assert all(found)


def test_lost_answer_starts_nothing_twice(server: BoardServer, tmp_path: Path):
    one = Print(tmp_path / "p", server)
    server.faults.meanwhile = lambda path: (
        setattr(server.faults, "lose_answer", START) if server.board.selected else None
    )
    wait_for = one.start()
    wait(lambda: server.board.status == "processing")
    server.faults.meanwhile, server.faults.lose_answer = (lambda path: None), ""
    assert wait_for.end().state is LinkState.DONE
    assert (starts(server), server.strokes()) == (1, STROKES)
    assert one.steps() == ["selected", "start", "begun, unanswered", "deleted"]


def test_lost_start_is_sent_again_once_the_host_proves_it(server: BoardServer, tmp_path: Path):
    lost: list[str] = []

    def lose(path: str) -> None:
        begins = "M32" in path or ("machine/code" in path and bool(server.board.selected))
        if begins and not lost:
            lost.append(path)
            server.faults.drop = START

    server.faults.meanwhile = lose
    one = Print(tmp_path / "p", server).start()
    assert one.end().state is LinkState.DONE
    assert (starts(server), server.strokes()) == (1, STROKES)
    again = ["selected", "start", "begun"]
    assert one.steps() == ["selected", "start", "not begun", *again]
    late = 'M32 "0:/gcodes/printctl-1-aa-job.gcode"'
    assert server.board.code(late).startswith("Error")
    assert starts(server) == 1


def held_start(server: BoardServer) -> list[str]:
    """Lose the next start; return it, to come late."""
    held: list[str] = []

    def lose(path: str) -> None:
        if server.board.selected and re.search(START, path) and not held:
            held.append(f'M32 "0:/gcodes/{server.board.selected}"')
            server.faults.drop = START

    server.faults.meanwhile = lose
    return held


def test_a_start_that_comes_late_is_void(server: BoardServer, tmp_path: Path):
    held = held_start(server)
    one = printing(Print(tmp_path / "p", server).start())
    one.film.pause()
    wait(lambda: one.film.status.state is LinkState.PAUSED)
    assert server.board.code(held[0]).startswith("Error")
    assert server.board.status == "paused"
    one.film.resume(lambda why: None)
    assert one.end().state is LinkState.DONE
    assert server.board.code(held[0]).startswith("Error")
    assert (starts(server), server.strokes()) == (1, STROKES)


def test_a_start_that_comes_late_after_a_stop_is_void(server: BoardServer, tmp_path: Path):
    held = held_start(server)
    one = Print(tmp_path / "p", server).start()
    wait(lambda: bool(held))
    one.film.stop()
    ended = one.end()
    assert ended.state is LinkState.STOPPED
    assert "nothing moved" in ended.message
    assert server.board.code(held[0]).startswith("Error")
    assert starts(server) == 0


def test_an_end_as_unknown_voids_a_start_that_may_come(server: BoardServer, tmp_path: Path):
    held = held_start(server)
    one = Print(tmp_path / "p", server).start()
    wait(lambda: bool(held))
    server.reset()
    ended = one.end()
    assert ended.state is LinkState.POSITION_UNKNOWN
    assert "may still come" not in ended.message
    assert server.board.code(held[0]).startswith("Error")
    assert starts(server) == 0
    assert one.steps() == ["selected", "start", "deleted"]


@pytest.mark.parametrize("end", ["kill", "silence", "halt"])
def test_an_end_that_cannot_void_a_start_says_so(server: BoardServer, tmp_path: Path, end: str):
    held = held_start(server)
    one = Print(tmp_path / "p", server, silent_limit_s=0.5).start()
    wait(lambda: bool(held))
    if end == "kill":
        one.film.kill()
    elif end == "halt":
        server.board.code("M112")
    else:
        server.down()
    ended = one.end()
    late = "a start of printctl-1-aa-job.gcode may still come; delete it on the host"
    assert late in ended.message
    if end == "silence":
        server.up()
    else:  # the board has the file selected, and deletes no such one
        assert ended.state is LinkState.KILLED


def test_a_refused_start_has_moved_nothing(server: BoardServer, tmp_path: Path):
    (server.folder / "other.gcode").write_text("G1 X1 F1\n")
    one = Print(tmp_path / "p", server)

    def refuse(name: str) -> None:
        server.board.selected = "other.gcode"
        server.board.code("M24")
        raise HostRefused("409: busy", 409)

    one.film._host.start = refuse  # type: ignore[method-assign]
    ended = one.start().end()
    assert (ended.state, ended.position_known) == (LinkState.FAILED, True)
    assert ended.message == "not started, nothing moved: 409: busy"


def test_a_refused_start_whose_file_runs_is_followed(server: BoardServer, tmp_path: Path):
    one = Print(tmp_path / "p", server)
    own = one.film._host.start

    def refuse(name: str) -> None:
        own(name)
        raise HostRefused("400: a macro failed", 400)

    one.film._host.start = refuse  # type: ignore[method-assign]
    assert one.start().end().state is LinkState.DONE
    assert starts(server) == 1


def test_another_file_is_not_said_to_be_begun_by_the_start(server: BoardServer, tmp_path: Path):
    (server.folder / "other.gcode").write_text("G1 X1 F1\n")
    one = Print(tmp_path / "p", server)

    def lose(name: str) -> None:
        server.board.selected = "other.gcode"
        server.board.code("M24")
        raise HostSilent("no answer")

    one.film._host.start = lose  # type: ignore[method-assign]
    ended = one.start().end()
    assert ended.state is LinkState.POSITION_UNKNOWN
    assert "it runs other.gcode)" in ended.message


def test_a_start_that_comes_while_its_file_is_replaced_is_followed(
    server: BoardServer, tmp_path: Path
):
    held, uploads = held_start(server), []
    lose = server.faults.meanwhile

    def come(path: str) -> None:
        lose(path)
        if held and re.search("upload|machine/file/", path) and not uploads:
            uploads.append(path)
            assert server.board.code(held[0]) == ""

    server.faults.meanwhile = come
    one = Print(tmp_path / "p", server).start()
    assert one.end().state is LinkState.DONE
    assert (len(uploads), starts(server), server.strokes()) == (1, 1, STROKES)


def test_a_print_begun_anew_between_two_questions_is_not_taken_for_ours(
    server: BoardServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(boards, "JOB", JOB.replace("F1200", "F120"))
    one = printing(Print(tmp_path / "p", server).start())
    board, name = server.board, server.board.selected
    time.sleep(1.7)  # a standalone board counts whole seconds
    board.code("M25")
    board.code("M0")
    wait(lambda: board.status == "idle")
    board.code(f'M32 "{name}"')
    ended = one.end()
    assert ended.state is LinkState.POSITION_UNKNOWN
    assert "begun anew, by another client" in ended.message


def test_another_begin_of_the_file_is_told_by_the_hosts_clock(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    first_s = one.film._begun_s or 70.0
    for begun_s in (0.0, 0.01, 5.0):
        said = HostReport(HostState.PRINTING, one.film.hosted.name, begun_s=first_s + begun_s)
        assert one.film.status.state is LinkState.PRINTING
        one.film._host.state = lambda name, said=said: said  # type: ignore[method-assign,misc]
        time.sleep(0.2)
    assert "begun anew" in one.end().message


def test_complete_before_the_files_end_is_not_done(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    said = HostReport(HostState.COMPLETE, one.film.hosted.name, position=len(JOB) // 2)
    one.film._host.state = lambda name: said  # type: ignore[method-assign]
    ended = one.end()
    assert ended.state is LinkState.FAILED
    assert f"has read {len(JOB) // 2} of {len(JOB)} bytes" in ended.message


def test_another_clients_file_is_not_started(server: BoardServer, tmp_path: Path):
    (server.folder / "other.gcode").write_text("G1 X1\n")

    def select(path: str) -> None:
        if server.board.selected:
            server.board.code('M23 "0:/gcodes/other.gcode"')

    server.faults.meanwhile = select
    one = Print(tmp_path / "p", server).start()
    ended = one.end()
    assert ended.state is LinkState.FAILED
    assert "file other.gcode); is another client at work?" in ended.message
    assert (starts(server), server.strokes(), one.steps()) == (0, [], ["selected"])


def test_process_that_takes_over_follows_and_starts_nothing(server: BoardServer, tmp_path: Path):
    first = printing(Print(tmp_path / "p", server).start())
    again = Print(tmp_path / "p", server).start(taken_over=True, step="begun")
    assert again.end().state is LinkState.DONE
    first.end()
    assert (starts(server), server.strokes()) == (1, STROKES)


def test_a_cancel_at_the_panel_is_not_done(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    server.board.code("M25")
    server.board.code("M0")
    ended = one.end()
    assert ended.state is (LinkState.STOPPED if server.sbc else LinkState.FAILED)
    assert "cancelled" in ended.message
    assert starts(server) == 1


def test_a_selected_file_is_not_done_because_the_last_one_was(server: BoardServer, tmp_path: Path):
    server.board.last = {"lastDuration": 300}  # of an earlier print
    (server.folder / "printctl-1-aa-job.gcode").write_text(JOB)
    server.board.code("M23 printctl-1-aa-job.gcode")
    one = Print(tmp_path / "p", server).start(taken_over=True, step="start")
    ended = one.end()
    assert starts(server) == (1 if server.sbc else 0)
    assert ended.state is (LinkState.DONE if server.sbc else LinkState.POSITION_UNKNOWN)
    assert server.sbc or "begun and ended or never begun" in ended.message


def test_takes_over_after_the_end(server: BoardServer, tmp_path: Path):
    Print(tmp_path / "p", server).start().end()
    again = Print(tmp_path / "p", server).start(taken_over=True, step="begun")
    assert again.end().state is LinkState.DONE
    assert starts(server) == 1


def test_restarted_host_without_a_record_ends_as_unknown(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    server.reset()
    status = one.end()
    assert status.state is LinkState.POSITION_UNKNOWN
    assert status.message.startswith("unknown, look at the machine")
    assert starts(server) == 1
    again = Print(tmp_path / "p", server).start(taken_over=True, step="begun")
    assert again.end().state is LinkState.POSITION_UNKNOWN
    assert starts(server) == 1


def test_silent_host_is_unknown_and_then_followed_again(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    server.down()
    wait(lambda: one.film.status.state is LinkState.UNKNOWN)
    words = one.film.status.message
    assert words.startswith("unknown since ")
    assert "the last report: printing" in words
    assert not one.film.status.position_known
    server.up()
    assert one.end().state is LinkState.DONE
    assert server.strokes() == STROKES


def test_host_silent_for_too_long_ends_as_unknown(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server, silent_limit_s=0.6).start())
    server.down()
    status = one.end()
    assert status.state is LinkState.POSITION_UNKNOWN
    assert status.message.startswith("unknown since ")
    server.up()


def test_pause_and_resume(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    one.film.pause()
    wait(lambda: one.film.status.state is LinkState.PAUSED)
    made = len(server.strokes())
    time.sleep(0.3)
    assert len(server.strokes()) == made
    why: list[str] = []
    one.film.resume(why.append)
    wait(lambda: bool(why))
    assert why == [""]
    assert one.end().state is LinkState.DONE
    assert server.strokes() == STROKES
    with pytest.raises(Refused):
        one.film.pause()


def test_stop_ends_it_in_the_hosts_way(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    one.film.stop()
    one.film.stop()
    status = one.end()
    assert status.state is LinkState.STOPPED
    assert "cancelled by the user" in status.message
    assert server.board.status == "idle"
    assert len(server.strokes()) < len(STROKES)


def test_stop_is_sent_once_however_long_the_hosts_macro_takes(
    server: BoardServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(file_print, "_AGAIN_S", 0.1)
    cancels: list[str] = []
    own = server.board.code

    def slow(text: str) -> str:
        if text == "M0":
            cancels.append(text)
            time.sleep(1.0)
        return own(text)

    monkeypatch.setattr(server.board, "code", slow)
    one = printing(Print(tmp_path / "p", server).start())
    one.film.stop()
    assert one.end().state is LinkState.STOPPED
    assert cancels == ["M0"]


def test_stop_does_not_wait_for_a_pauses_answer(
    server: BoardServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    held, answer, own = threading.Event(), threading.Event(), server.board.code

    def hold(text: str) -> str:
        if text != "M25" or held.is_set():
            return own(text)
        held.set()
        answer.wait(20)
        return ""

    monkeypatch.setattr(server.board, "code", hold)
    one = printing(Print(tmp_path / "p", server).start())
    one.film.pause()
    wait(held.is_set)
    one.film.stop()
    try:
        assert one.end(within_s=10).state is LinkState.STOPPED
    finally:
        answer.set()
    assert len(server.strokes()) < len(STROKES)


def test_stop_does_not_wait_for_a_starts_answer(
    server: BoardServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    begun, cancelled, own = threading.Event(), threading.Event(), server.board.code

    def hold(text: str) -> str:
        answer = own(text)
        if text.startswith("M32"):
            begun.set()
            cancelled.wait(3.0)
        elif text == "M0":
            cancelled.set()
        return answer

    monkeypatch.setattr(server.board, "code", hold)
    one = Print(tmp_path / "p", server).start()
    assert begun.wait(10)
    one.film.stop()
    assert cancelled.wait(2.0)
    assert one.end().state is LinkState.STOPPED
    assert len(server.strokes()) < len(STROKES)


def test_stop_whose_answer_is_lost_is_sent_again_only_where_the_file_is_read_on(
    server: BoardServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(file_print, "_AGAIN_S", 0.1)
    monkeypatch.setattr(boards, "JOB", JOB.replace("F1200", "F240"))
    one = printing(Print(tmp_path / "p", server).start())
    cancels: list[str] = []
    host = one.film._stops.host
    own = host.cancel

    def lose(name: str) -> None:
        cancels.append(name)
        if len(cancels) == 2:
            server.board.code("M25")  # taken: its macro begins
        raise HostSilent("no answer")

    host.cancel = lose  # type: ignore[method-assign]
    one.film.stop()
    wait(lambda: server.board.status == "paused")
    time.sleep(0.5)
    assert len(cancels) == 2
    assert "cancel it again" in one.film.status.message
    host.cancel = own  # type: ignore[method-assign]
    one.film.stop()
    assert one.end().state is LinkState.STOPPED


def test_a_late_answers_age_counts_from_its_question(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    before = one.film._known_at
    server.faults.meanwhile = lambda path: time.sleep(0.1)
    wait(lambda: one.film._known_at != before)
    assert time.monotonic() - one.film._known_at >= 0.1
    one.end()


def test_stop_before_the_start_starts_nothing(server: BoardServer, tmp_path: Path):
    one = Print(tmp_path / "p", server)
    one.film.stop()
    status = one.start().end()
    assert status.state is LinkState.STOPPED
    assert "nothing moved" in status.message
    assert starts(server) == 0


@pytest.mark.parametrize("state", ["uploading", "printing", "paused", "polling"])
def test_kill_waits_for_nothing(server: BoardServer, tmp_path: Path, state: str):
    one = Print(tmp_path / "p", server)
    hung = {"uploading": "upload|machine/file/", "polling": "rr_model|machine/model"}.get(state, "")
    if state == "uploading":
        server.faults.hang = hung
    one.start()
    if state == "uploading":
        wait(lambda: server.count(hung) > 0)
    else:
        printing(one)
    if state == "paused":
        one.film.pause()
        wait(lambda: one.film.status.state is LinkState.PAUSED)
    if state == "polling":
        asked = server.count(hung)
        server.faults.hang = hung
        wait(lambda: server.count(hung) > asked)
    one.film.kill()
    assert server.board.status == "halted"
    server.faults.hang = ""
    status = one.end()
    assert status.state is LinkState.KILLED
    assert "says halted" in status.message
    assert not status.position_known


def test_kill_without_an_answer_says_cut_the_power(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    server.down()
    one.film.kill()
    assert "NOT confirmed: cut its power" in one.end().message
    server.up()


def test_halt_by_the_firmware_itself_ends_it(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    server.board.code("M112")
    status = one.end()
    assert status.state is LinkState.KILLED
    assert "firmware has halted" in status.message


def test_file_stored_wrongly_is_not_started(
    server: BoardServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(type(server.board), "_size", lambda self: 1)
    server.faults.meanwhile = lambda path: (
        [file.write_bytes(b"G1") for file in server.folder.iterdir()] if "info" in path else None
    )
    status = Print(tmp_path / "p", server).start().end()
    assert status.state is LinkState.FAILED
    assert "nothing was started" in status.message
    assert starts(server) == 0


@pytest.mark.parametrize("busy", ["processing", "halted", "off"])
def test_printer_that_is_not_free_is_left_alone(server: BoardServer, tmp_path: Path, busy: str):
    server.board.status = busy
    one = Print(tmp_path / "p", server).start()
    status = one.end()
    assert status.state is LinkState.FAILED
    assert "nothing was started" in status.message
    assert server.count("upload|machine/file/") == 0


def test_upload_that_breaks_is_made_again(server: BoardServer, tmp_path: Path):
    server.faults.drop = "upload|machine/file/"
    one = Print(tmp_path / "p", server).start()
    assert one.end().state is LinkState.DONE
    assert starts(server) == 1


def test_a_command_takes_no_connection_that_was_idle(
    server: BoardServer, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(http_client, "IDLE_S", 0.1)
    if not server.sbc:
        pytest.skip("a standalone board closes each connection")
    host = make_host(parse_address(server.port), "")
    host.identify()
    opened = len(server.server.ends)
    host.state("")
    assert len(server.server.ends) == opened
    time.sleep(0.2)
    host.state("")
    assert len(server.server.ends) == opened + 1
    host.close()


def test_every_stop_of_a_person_is_sent(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())
    cancels: list[str] = []
    host = one.film._stops.host
    own = host.cancel
    host.cancel = cancels.append  # type: ignore[method-assign]  # answered, and not done
    for count in (1, 2):
        one.film.stop()
        wait(lambda count=count: len(cancels) == count)
        wait(lambda: not one.film._cancelling)
    host.cancel = own  # type: ignore[method-assign]
    one.film.stop()
    assert one.end().state is LinkState.STOPPED


def test_a_stop_that_never_left_has_no_lost_answer(server: BoardServer, tmp_path: Path):
    one = printing(Print(tmp_path / "p", server).start())

    def silent(do: str, host: object) -> None:
        raise HostSilent("no answer to the question before it")

    one.film._refuse_other_file = silent  # type: ignore[method-assign]
    one.film.stop()
    wait(lambda: not one.film._cancelling)
    assert "cancelling is requested" in one.film.status.message
    assert "lost" not in one.film.status.message
    one.end()


def test_a_held_start_of_a_file_that_another_client_began_is_void(
    server: BoardServer, tmp_path: Path
):
    held = held_start(server)
    one = Print(tmp_path / "p", server).start()
    wait(lambda: bool(held))
    server.board.code("M24")
    assert one.end().state is LinkState.DONE
    assert server.board.code(held[0]).startswith("Error")
    assert starts(server) == 1


def test_done_waits_for_moves_that_the_hosts_history_is_ahead_of(
    server: BoardServer, tmp_path: Path
):
    one = printing(Print(tmp_path / "p", server).start())
    said = HostReport(HostState.IDLE, moving=True)
    one.film._host.ended = lambda name: HostEnd(HostState.COMPLETE)  # type: ignore[method-assign]
    one.film._host.state = lambda name: said  # type: ignore[method-assign]
    time.sleep(1.0)
    assert one.status is None
    said = HostReport(HostState.IDLE)
    ended = one.end()
    assert (ended.state, ended.position_known) == (LinkState.DONE, True)


def test_done_under_another_print_says_that_the_place_is_not_known(
    server: BoardServer, tmp_path: Path
):
    one = printing(Print(tmp_path / "p", server).start())
    said = HostReport(HostState.PRINTING, "other.gcode")
    one.film._host.ended = lambda name: None  # type: ignore[method-assign]
    one.film._host.state = lambda name: said  # type: ignore[method-assign]
    wait(lambda: "runs another file, other.gcode (printing" in one.film.status.message)
    wait(lambda: one.film.status.state is LinkState.UNKNOWN)
    assert not one.film.status.position_known
    with pytest.raises(Refused, match=r"not halted: .* runs other\.gcode"):
        one.film.kill()
    assert server.board.status != "halted"
    one.film._host.ended = lambda name: HostEnd(HostState.COMPLETE)  # type: ignore[method-assign]
    ended = one.end()
    assert (ended.state, ended.proved) == (LinkState.DONE, False)
    assert "whether its motors rest isn't known" in ended.message


def test_kill_before_the_start_leaves_another_print_alone(server: BoardServer, tmp_path: Path):
    (server.folder / "other.gcode").write_text("G1 X99 F600\n")
    server.board.code('M32 "other.gcode"')
    one = Print(tmp_path / "p", server).start()
    wait(lambda: one.film.status.state is LinkState.CHECKING and one.film._report is not None)
    with pytest.raises(Refused, match=r"runs other\.gcode"):
        one.film.kill()
    assert server.board.status == "processing"
    assert one.end().state is LinkState.FAILED


def test_no_part_of_a_key_is_in_a_refusal_or_a_files_name(server: BoardServer):
    key = "A1b2C3d4E5f6G7h8"
    host = make_host(parse_address(server.port.replace("duet", "octoprint")), key)
    for before in range(400, 500, 7):
        refusal = HostRefused("x" * before + key)
        host.http.send = raising(refusal)  # type: ignore[attr-defined]
        with pytest.raises(HostRefused) as caught:
            host.identify()
        assert key[:6] not in str(caught.value)
    del host.http.send  # type: ignore[attr-defined]
    answer = {"state": "Printing", "job": {"file": {"path": f"{key}.gcode"}}}
    host.http.get = lambda path: answer  # type: ignore[attr-defined]
    assert host.state("mine.gcode").file == "***.gcode"
    assert host.state(f"{key}.gcode").file == f"{key}.gcode"


def raising(error: Exception) -> Callable[..., None]:
    def fail(*given: object, **more: object) -> None:
        raise error

    return fail


def test_a_dripping_answer_does_not_hold_the_emergency_stop(monkeypatch: pytest.MonkeyPatch):
    over = threading.Event()

    def drip(listener: socket.socket) -> None:
        with suppress(OSError):
            while not over.is_set():
                end, _ = listener.accept()
                threading.Thread(target=trickle, args=(end,), daemon=True).start()

    def trickle(end: socket.socket) -> None:
        with suppress(OSError), end:
            while not over.wait(0.1):
                end.sendall(b"H")

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=drip, args=(listener,), daemon=True).start()
        ready = http_client.ReadyConnection(
            parse_address(f"duet://127.0.0.1:{listener.getsockname()[1]}")
        )
        begun = time.monotonic()
        with pytest.raises(HostSilent, match="the emergency stop has no answer"):
            ready.send(HostRequest("GET", "/"), limit_s=0.5)
        assert time.monotonic() - begun < 3.0
        over.set()
        ready.close()


def test_an_end_between_two_questions_is_no_other_begin(server: BoardServer, tmp_path: Path):
    if server.sbc:
        pytest.skip("one question there")
    one = printing(Print(tmp_path / "p", server).start())
    board, own = server.board, server.board.model
    wait(lambda: board.begun_s > 0 and time.monotonic() - board.begun_s > 0.6)  # counts as 1 s

    def late(key: str) -> object:
        answer = own(key)
        if key == "state" and answer["status"] == "processing":
            wait(lambda: board.status == "idle")
        return answer

    board.model = late  # type: ignore[method-assign]
    assert one.end().state is LinkState.DONE


def test_start_that_a_board_has_only_queued_stays_open(tmp_path: Path):
    server = BoardServer(tmp_path / "board")

    def queued() -> str:
        server.board.status = "busy"  # a macro runs, and M32 waits for its end
        return ""

    server.board._start = queued  # type: ignore[method-assign]
    ended = Print(tmp_path / "p", server).start().end()
    assert ended.state is LinkState.POSITION_UNKNOWN
    assert "a start of printctl-1-aa-job.gcode may still come" in ended.message
    server.down()
