"""Link process's command socket: access, understood requests, kill never delayed."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from firmware_profiles import Printer, load
from printctl.checks.gate import Bounds, LineOrigin, Phase, PrinterSituation, judge
from printctl.machine.control.gating import allowed_command
from printctl.machine.control.idle.known_state import Knowledge
from printctl.machine.control.idle.station_status import StationState
from printctl.machine.errors import LinkError
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.machine import Machine
from printctl.machine.process.plug import Plug
from printctl.machine.process.socket_server import MAX_CLIENTS, Server, forget, listen
from printctl.machine.records.record import ContactRecord
from printctl.machine.records.states import LinkState, Status


class Spy:
    """Stands for the channel; notes what was requested."""

    def __init__(self) -> None:
        self.requests: list[str] = []
        self.notes: list[dict] = []
        self.killed = threading.Event()
        self.wiring = SimpleNamespace(printer=load(Printer, "generic_marlin"))
        self.protocol = SimpleNamespace(report=b"")
        self.status = Status(LinkState.PRINTING, lines_done=5, lines_total=9)

    def stop(self, by: str = "the user") -> None:
        self.requests.append("stop" if by == "the user" else f"stop by {by}")

    def pause(self, after: MarkKind | None = None) -> None:
        if after is MarkKind.VESSEL:
            raise LinkError("no end of a vessel is marked")
        self.requests.append(f"pause after {after}" if after else "pause")

    def reload(self) -> None:
        self.requests.append("reload")

    def resume(self, change: NewSyringe | None, unchanged: bool, unobserved: bool, answer) -> None:
        self.requests.append(f"resume {change}" if change else "resume")
        answer("not resumed: pushed" if unchanged else "")

    def alive(self) -> None:
        self.requests.append("alive")

    def look(self, request) -> None:
        what = (
            f"{len(request.lines)} {request.flow}" if request.decision is None else request.decision
        )
        sort = "insert" if request.decision is None else "look_done"
        self.requests.append(f"{sort} {request.look} {what}")

    def typed(self, text: str, done, refused) -> None:
        known = PrinterSituation(Bounds(self.wiring.printer), Phase.PRINTING)
        self.requests.append(allowed_command(judge(text, LineOrigin.CONSOLE, known)).text)
        done((b"X:0.00", b"ok"))

    def note(self, action: dict) -> None:
        self.notes.append(action)

    def kill(self) -> None:
        self.killed.set()

    def end(self) -> None:
        self.requests.append("end")


def serving(listener: socket.socket, token: str, spy: Spy) -> Server:
    """Serve a machine whose print is a spy."""
    plug = Plug("generic_marlin", "/dev/nowhere", Path("nowhere"))
    machine = Machine(plug, Knowledge(plug.printer))
    machine.server = server = Server(listener, token, machine)
    machine.begin_print(spy, "a print")  # type: ignore[arg-type]
    server.start()
    return server


@pytest.fixture(params=["unix", "tcp"])
def door(request, tmp_path, monkeypatch):
    if request.param == "tcp":
        monkeypatch.delattr(socket, "AF_UNIX", raising=False)
    elif not hasattr(socket, "AF_UNIX"):
        pytest.skip("no Unix sockets here")
    listener, address, token = listen(tmp_path)
    monkeypatch.undo()
    spy = Spy()
    server = serving(listener, token, spy)
    guests: list[socket.socket] = []

    def enter() -> socket.socket:
        kind, _, rest = address.partition(":")
        if kind == "unix":
            guest = socket.socket(socket.AF_UNIX)
            guest.connect(rest)
        else:
            host, _, port = rest.rpartition(":")
            guest = socket.create_connection((host, int(port)))
        guest.settimeout(5)
        guests.append(guest)
        return guest

    yield spy, server, enter, token
    server.finish()
    for guest in guests:
        guest.close()
    forget(address)


def say(guest: socket.socket, **message: object) -> None:
    guest.sendall(json.dumps(message).encode() + b"\n")


def hear(guest: socket.socket) -> dict:
    data = b""
    while not data.endswith(b"\n"):
        data += guest.recv(1)
    return json.loads(data)


def test_each_request_that_is_granted_is_noted_with_who_and_from_where(door):
    spy, _, enter, token = door
    guest, by = enter(), {"who": "ada", "from": "page, Chrome at 192.168.1.7", "more": "x"}
    say(guest, do="kill", token=token, by=by)
    assert spy.killed.wait(5)
    say(guest, do="pause", after="vessel", answer=True, token=token, by=by)
    assert hear(guest)["event"] == "refused"
    say(guest, do="pause", after="layer", answer=True, token=token, by=["no", "object"])
    hear(guest)
    killed, paused = spy.notes
    assert killed == {"do": "kill", "who": "ada", "from": "page, Chrome at 192.168.1.7"}
    assert paused == {"do": "pause", "given": {"after": "layer"}, "who": "", "from": ""}


def test_request_that_asks_for_an_answer_is_heard_or_refused(door):
    spy, _, enter, token = door
    guest = enter()
    say(guest, do="pause", after="layer", answer=True, token=token)
    assert hear(guest) == {"event": "heard", "do": "pause"}
    say(guest, do="pause", after="vessel", answer=True, token=token)
    assert hear(guest) == {
        "event": "refused",
        "message": "no end of a vessel is marked",
        "error": "LinkError",
    }
    say(guest, do="resume", change={"plunger_mm": 2.5}, token=token)
    assert hear(guest) == {"event": "resumed"}
    say(guest, do="resume", unchanged=True, token=token)
    refused = {"event": "refused", "message": "not resumed: pushed", "error": "Refused"}
    assert hear(guest) == refused
    say(guest, do="pause", after="lunch", answer=True, token=token)
    assert "must be one of layer, vessel, part, reload" in hear(guest)["message"]
    for request in ("reload", "alive"):
        say(guest, do=request, answer=True, token=token)
        assert hear(guest)["event"] == "heard"
    change = NewSyringe(plunger_mm=2.5)
    assert spy.requests == ["pause after layer", f"resume {change}", "resume", "reload", "alive"]


NONSENSE = [b"nonsense\n", b"[]\n", b'{"do": "dance"}\n', b"{}\n", b"\xff\n", b"[" * 9000 + b"\n"]
HUGE = "1" + "0" * 400  # a whole number that no float is as large as


@pytest.mark.parametrize("value", ['"jog", "by": {"x": HUGE}', '"insert", "look": 1, "flow": HUGE'])
def test_a_number_beyond_all_floats_ends_no_door(door, value):
    _, _, enter, token = door
    guest = enter()
    guest.sendall(f'{{"token": "{token}", "do": {value.replace("HUGE", HUGE)}}}\n'.encode())
    assert hear(guest)["event"] == "refused"
    say(guest, do="status", token=token)
    assert hear(guest)["event"] == "status"


@pytest.mark.parametrize("line", NONSENSE)
def test_nonsense_is_refused_and_the_door_stays_open(door, line):
    spy, _, enter, token = door
    guest = enter()
    guest.sendall(line)
    assert hear(guest)["event"] == "refused"
    say(guest, do="status", token=token)
    assert hear(guest)["event"] == "status"
    assert spy.requests == []


@pytest.mark.parametrize(
    "text",
    ["M110 N5", "M112", "M83", "g91", "G92 E0", "g092E0", "N5 G1 X1", "M84", "m018 Z", "G1 X1*5"]
    + ["", "G1\nX2", "µ"],
)
def test_command_that_must_not_be_sent_is_refused(door, text):
    spy, _, enter, token = door
    guest = enter()
    say(guest, do="command", text=text, token=token)
    assert hear(guest)["event"] == "refused"
    assert spy.requests == []


INSERT = {"do": "insert", "look": 25, "lines": ["G4 P1"], "why": "a gap", "flow": None}
LOOK_DONE = {"do": "look_done", "look": 25, "decision": "go_on", "why": ""}
WRONG = [
    (INSERT, "look", "25"),
    (INSERT, "look", 25.0),
    (INSERT, "look", True),
    (INSERT, "look", None),
    (INSERT, "flow", True),
    (INSERT, "flow", "1.1"),
    (INSERT, "flow", float("nan")),
    (INSERT, "lines", "G4 P1"),
    (INSERT, "lines", {"G4 P1": 1}),
    (INSERT, "lines", [4]),
    (INSERT, "lines", None),
    (INSERT, "why", 3),
    (LOOK_DONE, "look", "25"),
    (LOOK_DONE, "decision", "maybe"),
    (LOOK_DONE, "decision", 1),
    (LOOK_DONE, "why", ["a"]),
    ({"do": "reload"}, "head", "1"),
    ({"do": "reload"}, "head", True),
    ({"do": "resume"}, "unchanged", "false"),
    ({"do": "resume"}, "change", [1]),
    ({"do": "pause"}, "after", 1),
    ({"do": "command"}, "text", 5),
]


@pytest.mark.parametrize(("request_", "name", "value"), WRONG)
def test_a_value_of_another_type_is_refused_by_its_name(door, request_, name, value):
    spy, _, enter, token = door
    guest = enter()
    say(guest, **{**request_, name: value, "token": token, "answer": True})
    answer = hear(guest)
    assert (answer["event"], answer.get("error")) == ("refused", "Refused")
    assert answer["message"].startswith(f"{request_['do']}: {name} ")
    assert spy.requests == []


def test_a_message_beyond_the_limit_gets_one_answer_and_the_next_is_heard(door):
    spy, _, enter, token = door
    guest = enter()
    say(guest, do="status", token=token)
    assert hear(guest)["event"] == "status"
    say(guest, **{**INSERT, "lines": ["G1 X1.000 Y1.000"] * 150_000, "token": token})
    answer = hear(guest)
    assert (answer["event"], answer["error"]) == ("refused", "Refused")
    assert "1,000,000 bytes" in answer["message"]
    say(guest, do="stop", answer=True, token=token)
    assert hear(guest) == {"event": "heard", "do": "stop"}
    assert spy.requests == ["stop"]


@pytest.mark.parametrize("used", ["NaN", "-1", "1e999", '"1"', "null"])
def test_syringe_that_is_no_length_is_refused(door, used):
    spy, _, enter, token = door
    guest = enter()
    request = f'{{"do": "resume", "token": "{token}", "change": {{"plunger_mm": {used}}}}}\n'
    guest.sendall(request.encode())
    answer = hear(guest)
    assert answer["event"] == "refused"
    assert "is no length" in answer["message"]
    assert spy.requests == []


def test_stranger_without_the_token_is_refused(door):
    spy, _, enter, token = door
    guest = enter()
    say(guest, do="stop", token=token + "x")
    assert hear(guest) == {"event": "refused", "message": "wrong token"}
    assert spy.requests == []


def test_kill_gets_through_beside_guests_that_never_read_or_never_end_a_line(door):
    spy, server, enter, token = door
    deaf, endless, user = enter(), enter(), enter()
    say(deaf, do="subscribe", token=token)
    endless.sendall(b"x" * 50_000)
    for done in range(5_000):
        server.tell(
            "print", Status(LinkState.PRINTING, lines_done=done, message="m" * 100).to_dict()
        )
    say(user, do="kill", token=token)
    assert spy.killed.wait(10)


def test_a_stop_of_who_leaves_at_once_is_heard(tmp_path):
    """What it is answered can't be delivered any more; what it wrote before leaving counts."""
    if not hasattr(socket, "AF_UNIX"):
        pytest.skip("no Unix sockets here")
    listener, address, token = listen(tmp_path)
    spy = Spy()
    with socket.socket(socket.AF_UNIX) as guest:
        guest.connect(address.removeprefix("unix:"))
        say(guest, do="subscribe")
        say(guest, do="status", aside="x" * 6000)  # more than one read: it is answered in between
        say(guest, do="stop")
        say(guest, do="kill")
    server = serving(listener, token, spy)
    assert spy.killed.wait(5)
    server.finish()
    forget(address)
    assert spy.requests == ["stop"]


# --- modes: who is spoken to
def test_request_for_another_print_is_refused_and_reaches_none(door):
    spy, server, enter, token = door
    guest = enter()
    say(guest, do="stop", print="an earlier print", token=token)
    answer = hear(guest)
    assert answer["event"] == "refused"
    assert answer["message"].startswith("that print is over")
    assert guest.recv(1) == b""
    assert spy.requests == []
    own, late = enter(), enter()
    for one in (own, late):
        say(one, do="subscribe", print="a print", token=token)
        assert hear(one)["state"] == "printing"
    say(own, do="stop", print="a print", answer=True, token=token)
    assert hear(own) == {"event": "heard", "do": "stop"}
    server.machine.end_print()
    assert own.recv(1) == late.recv(1) == b""


def test_who_is_hung_up_on_and_reads_late_hears_nothing_of_others(door):
    _, server, enter, token = door
    late, other = enter(), enter()
    say(late, do="subscribe", print="a print", token=token)
    assert hear(late)["event"] == "status"
    server.tell("print", {"long": "x" * 500_000})  # more than the system takes at once
    server.machine.end_print()
    say(other, do="status", of="printer", token=token)
    assert hear(other)["state"] == "connecting"
    with late.makefile("rb") as heard:
        assert ["long" in json.loads(line) for line in heard] == [True]


def test_client_of_a_print_that_is_over_where_the_station_goes_on_reads_its_journal(tmp_path):
    """A full disk kept its end out of link.json, which names the station's socket."""
    listener, address, token = listen(tmp_path)
    server = serving(listener, token, Spy())
    own = {"print_id": "an earlier print", "address": address, "token": token}
    job = tmp_path / "gone.gcode"
    record = ContactRecord(0, "", "", str(job), "generic_marlin", "", 0.0)
    replace(record, **own).save(tmp_path)
    client = PrintClient(tmp_path)
    assert client.wait(5).state is LinkState.INTERRUPTED
    assert PrintClient(tmp_path).status.state is LinkState.INTERRUPTED
    server.finish()
    forget(address)


def test_request_of_another_mode_is_refused(door):
    spy, server, enter, token = door
    server.machine.enter(StationState.PRINTING, "", print_folder="here")
    guest = enter()
    say(guest, do="jog", by={"x": 1}, token=token)
    assert "a print is running in here" in hear(guest)["message"]
    server.machine.end_print()
    server.machine.enter(StationState.READY, "")
    say(guest, do="pause", token=token)
    assert "no print is running here" in hear(guest)["message"]
    say(guest, do="status", of="printer", token=token)
    assert hear(guest)["state"] == "ready"
    assert spy.requests == []


def test_kill_that_falls_into_a_switch_of_modes_reaches_who_speaks_next(door):
    first, server, enter, token = door
    server.machine.switching = True
    guest = enter()
    say(guest, do="kill", answer=True, token=token)
    assert hear(guest) == {"event": "heard", "do": "kill"}
    assert first.killed.wait(5)
    following = Spy()
    server.machine.begin_print(following, "the next")
    assert following.killed.wait(5)


def test_kill_between_a_prints_end_and_the_next_standby_reaches_it(door):
    over, server, enter, token = door
    server.machine.standby, over.status = Spy(), Status(LinkState.DONE)
    guest = enter()
    say(guest, do="kill", answer=True, token=token)
    assert hear(guest) == {"event": "heard", "do": "kill"}
    assert over.killed.wait(5)
    server.machine.end_print()
    following = Spy()
    server.machine.stand_by(following)
    assert following.killed.wait(5)


def test_stop_of_a_system_that_shuts_down_is_called_so(door):
    spy, server, _, _ = door
    server.machine.leave()
    assert spy.requests == ["stop by the system (SIGTERM, as when it shuts down)"]


# --- command socket under load: admission, eviction, no free file handle
ROOT = Path(__file__).parents[4]


class CountingListener(socket.socket):
    """Counts how often it was asked for a connection."""

    asked = 0

    def accept(self) -> tuple[socket.socket, object]:
        self.asked += 1
        return super().accept()


@contextmanager
def crowded_door(folder: Path) -> Iterator[tuple[Spy, Server, CountingListener, str]]:
    if not hasattr(socket, "AF_UNIX"):
        pytest.skip("no Unix sockets here")
    plain, address, token = listen(folder)
    listener = CountingListener(fileno=plain.detach())
    spy = Spy()
    server = serving(listener, token, spy)
    try:
        yield spy, server, listener, address.removeprefix("unix:")
    finally:
        server.finish()
        forget(address)


@pytest.fixture
def open_door(tmp_path: Path) -> Iterator[tuple[Spy, Server, CountingListener, str]]:
    with crowded_door(tmp_path) as opened:
        yield opened


def client(stack: ExitStack) -> socket.socket:
    one = stack.enter_context(socket.socket(socket.AF_UNIX))
    one.settimeout(5)
    return one


def test_a_crowd_that_says_nothing_makes_room_and_who_has_spoken_stays(open_door):
    spy, server, _, path = open_door
    with ExitStack() as stack:
        watching, silent = client(stack), client(stack)
        for one in (watching, silent):
            one.connect(path)
        say(watching, do="subscribe")
        assert hear(watching)["state"] == "printing"
        for _ in range(MAX_CLIENTS):
            client(stack).connect(path)
        last = client(stack)
        last.connect(path)
        say(last, do="status")
        assert hear(last)["asked"]
        assert silent.recv(1) == b""  # it was the oldest that had said nothing
        server.tell("print", Status(LinkState.PAUSED).to_dict())
        assert hear(watching)["state"] == "paused"
        say(last, do="kill")
        assert spy.killed.wait(5)


def test_a_message_to_one_client_looks_at_no_other(open_door):
    _, server, _, address = open_door
    with ExitStack() as stack:
        guests = [client(stack) for _ in range(40)]
        for guest in guests:
            guest.connect(address.removeprefix("unix:"))
            say(guest, do="detach", answer=True)
            assert hear(guest)["event"] == "heard"
        flushed = list[object]()
        flush = server._flush
        server._flush = lambda one: (flushed.append(one), flush(one))  # type: ignore
        say(guests[7], do="alive", answer=True)
        assert hear(guests[7])["event"] == "heard"
        assert len(flushed) == 1


def test_a_crowd_of_subscribers_doesnt_keep_a_kill_out(open_door):
    spy, _, _, path = open_door
    with ExitStack() as stack:
        for _ in range(MAX_CLIENTS):
            one = client(stack)
            one.connect(path)
            say(one, do="subscribe")
            hear(one)
        last = client(stack)
        last.connect(path)
        say(last, do="kill")
        assert spy.killed.wait(5)


@pytest.mark.parametrize("name", ["a_kill_gets_in", "a_door_that_cant_accept_doesnt_spin"])
def test_a_door_without_file_handles(name: str, tmp_path: Path) -> None:
    pytest.importorskip("resource")
    module = "tests.printctl.machine.link.door_without_handles"
    command = [sys.executable, "-m", module, name, str(tmp_path)]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
