"""Run a print on a network host in this process: its folder, journal, clients; or halt one."""

from __future__ import annotations

import signal
import threading
import time
from contextlib import ExitStack, closing, suppress
from functools import partial
from typing import Any, Final

from firmware_profiles import Printer, load
from gcode.user_files import read_gcode_path
from printctl.machine.control.board.halting import UNCONFIRMED
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.job import Job, load_job
from printctl.machine.network.file_print import (
    FilePrint,
    HostedJob,
    file_stem,
    name_on_host,
    void_start,
)
from printctl.machine.network.host import (
    HostState,
    PrintHost,
    parse_address,
    read_key,
)
from printctl.machine.network.hosts import make_host, refuse_unsupported
from printctl.machine.network.http_client import ReadyConnection
from printctl.machine.process.orders import Order
from printctl.machine.process.outcome import followable, may_still_move
from printctl.machine.process.socket_server import Guest, Server, forget, listen
from printctl.machine.process.vocabulary import WORDS, action_of, read_values
from printctl.machine.records.folders import archive_journal, remember_folder
from printctl.machine.records.journal import Journal
from printctl.machine.records.record import JOURNAL, ContactRecord, load_record
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.sealing import sign_journal
from printctl.machine.records.states import LinkState, Status, state_words
from printctl.processes.alive import ignore_signals

HALT_TRIES: Final = 3
ASK_S: Final = 2.0
"""Longest wait for each answer about what a host runs, before a halt goes out all the same."""
_OVER: Final = (LinkState.DONE, LinkState.STOPPED, LinkState.GIVEN_UP)


def refuse_on_host(order: Order) -> None:
    """Raise Refused where an order asks for what its network host can't do."""
    kind = parse_address(order.port).kind
    printer = load(Printer, order.printer)
    refuse_unsupported(kind, printer, order.care, order.baud, order.retreat.prime_mm)


class HostDoor:
    """Grants clients' requests to a print on a network host; a `RequestTaker`.

    Attributes
    ----------
    server : Server
        Set once it listens.
    """

    server: Server

    def __init__(self, printing: FilePrint, print_id: str) -> None:
        self._printing, self._print_id = printing, print_id

    def kill(self) -> None:
        """Halt the firmware; called in a thread that does nothing else."""
        self._printing.kill()

    def publish(self, status: Status) -> None:
        """Send a status to all who have subscribed."""
        self.server.tell("print", status.to_dict())

    def take(self, guest: Guest, request: dict[str, Any]) -> bool:
        """Take a request; return whether it has an answer of its own."""
        do, printing = request["do"], self._printing
        values, guest.known = read_values(request), True
        if do in ("status", "subscribe"):
            if values["of"] != "print":
                raise Refused("a network host's printer has no station; ask for its print")
            if do == "subscribe":
                guest.subscribed, guest.of_print = "print", True
            asked = {"asked": True} if do == "status" else {}
            self.server.post(guest, {"event": "status", **asked, **printing.status.to_dict()})
            return True
        if do == "detach":
            guest.subscribed = ""
            return True
        guest.of_print = guest.of_print or bool(request.get("print"))
        if do == "kill":
            printing.see_no_other_file()
            self.server.kill()
        elif do == "stop":
            printing.stop()
        elif do == "pause" and not values["after"]:
            printing.pause()
        elif do == "resume" and not (values["change"] or values["unchanged"]):
            printing.resume(partial(self._resumed, guest))
        else:
            raise Refused(
                f"{do} isn't possible: {printing.address.kind} runs the file by itself, and "
                "printctl holds it at no layer, look or change of syringe"
            )
        printing.actions.append(action_of(request, values))
        return WORDS[do].answers

    def _resumed(self, guest: Guest, why: str) -> None:
        refused = {"event": "refused", "message": why, "error": Refused.__name__}
        self.server.post(guest, refused if why else {"event": "resumed"})


def run_host_print(order: Order, contact: Any, begin_journal: Any) -> Status:
    """Print on a network host, from upload or from where an earlier process left it.

    ``contact`` is the print's `PrintContact`; ``begin_journal`` writes its job record.
    """
    ignore_signals()
    refuse_on_host(order)
    printer = load(Printer, order.printer)
    job, data = load_job(order.job, printer), read_gcode_path(order.job)
    history = followable(order.folder, job.sha256) if order.resume else None
    identity = contact.print_id if history is None else history.print_id
    heard = {"heard": (order.folder / JOURNAL).stat().st_mtime} if history else {}
    path = order.folder / JOURNAL if history else archive_journal(order.folder)
    with ExitStack() as parting:
        journal = Journal(path, reserve=True, sign=sign_journal)
        parting.callback(journal.close)
        step, name = ("", name_on_host(identity, job.name)) if history is None else history.hosted
        name = name or name_on_host(identity, job.name)
        printing = _print_of(order, name, job, data, printer, journal)
        door = HostDoor(printing, identity)
        listener, address, token = listen(order.folder)
        door.server = Server(listener, token, door)
        parting.callback(forget, address)
        parting.callback(door.server.finish)
        printing.on_status = door.publish
        door.server.start()
        signal.signal(signal.SIGTERM, lambda *_: printing.stop("the system"))
        begin_journal(journal, order, job, printer, id=identity, lines=len(job), **heard)
        remember_folder(order.folder)
        contact.begin(identity, address, token)
        return printing.run(history is not None, step)


def _print_of(
    order: Order, name: str, job: Job, data: bytes, printer: Printer, journal: Journal
) -> FilePrint:
    key = read_key(load_record(order.folder).key_file)
    data = data if data.endswith(b"\n") else data + b"\n"  # else a host may leave the last line out
    hosted = HostedJob(job, data, name, printer, order.care.start_mm)
    limit_s = order.care.silent_limit_s
    return FilePrint(parse_address(order.port), key, hosted, journal, silent_limit_s=limit_s)


def halt_on_host(record: ContactRecord, before: Status, history: JournalledPrint) -> str:
    """Halt the firmware behind the network host of a print without a process; return the outcome.

    ``before`` is how the print ended. Refused where the host runs another file, or an ended print's
    isn't run; LinkError where it can't be reached, or doesn't confirm.
    """
    host = host_of(record)
    if (runs := _file_within(ASK_S, host, file_stem(record.print_id))) is None:
        host = host_of(record)  # the other one may be waiting for its answer still
    _refuse_other_print(record, before, runs or "")
    words, halted, tries = "", False, HALT_TRIES
    with closing(ReadyConnection(parse_address(record.port))) as urgent:
        while tries and not halted:
            tries -= 1
            try:
                taken = urgent.send(host.halt_request()) < 300
                reported = host.state("").state
            except LinkError as exc:
                words = str(exc)
            else:
                words = f"{record.port} says {reported.value}"
                halted = reported is HostState.HALTED or (taken and reported is HostState.OFFLINE)
    late = void_start(lambda: host, history.unanswered)
    if not halted:
        raise LinkError(f"{record.port}: {UNCONFIRMED} ({words}){late}")
    return f"emergency stop by the user; {words}{late}"


def host_of(record: ContactRecord) -> PrintHost:
    """Return the network host of a print's record; PortError without its key."""
    return make_host(parse_address(record.port), read_key(record.key_file))


def _file_within(limit_s: float, host: PrintHost, stem: str) -> str | None:
    """Return what a host runs; None where an answer doesn't come in time: a halt can't wait.

    A login before the question has the same limit for each of its answers.
    """
    found: list[str] = []

    def ask() -> None:
        with suppress(LinkError):
            found.append(host.active_file(stem))

    asking, since = threading.Thread(target=ask, daemon=True), time.monotonic()
    asking.start()
    while asking.is_alive() and time.monotonic() - max(since, host.answered_at) < limit_s:
        asking.join(0.02)
    return found[0] if found else None


def _refuse_other_print(record: ContactRecord, before: Status, runs: str) -> None:
    """Raise Refused where a halt would end another print than the record's."""
    if runs.startswith(file_stem(record.print_id)):
        return
    if runs or before.state in _OVER or not may_still_move(before):
        now = f"runs {runs}" if runs else "doesn't report that it runs its file"
        raise Refused(
            f"not halted: the print is {state_words(before.state)}, and {record.port} {now}; if "
            "the printer must stop all the same, use the host's own emergency stop or cut the power"
        )
