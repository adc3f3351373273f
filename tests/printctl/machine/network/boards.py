"""Twin of a Duet in this process, behind a server that loses requests, answers or waits."""

from __future__ import annotations

import re
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

from firmware_profiles import Printer, load
from printctl.machine.job.job import load_job
from printctl.machine.network.file_print import FilePrint, HostedJob, name_on_host
from printctl.machine.network.host import parse_address
from printctl.machine.records.journal import Journal, read_records
from printctl.machine.records.states import Status
from sim.devices.duet_twin import Board, Handler

PROFILE = "ender5_duet3_replistruder5"
JOB = "G92 X10 Y10 Z5\nG90\nM82\nG92 E0\n" + "".join(
    f"G1 X10 Y{10 + k} F6000\nG1 X14 E{0.2 * (k + 1):.1f} F1200\n" for k in range(4)
)


@dataclass
class Faults:
    """What happens to the next request whose path has a pattern."""

    drop: str = ""
    lose_answer: str = ""
    hang: str = ""
    asked: list[str] = field(default_factory=list)
    meanwhile: Callable[[str], None] = lambda path: None

    def take(self, name: str, path: str) -> bool:
        pattern = getattr(self, name)
        if not pattern or not re.search(pattern, path):
            return False
        if name != "hang":
            setattr(self, name, "")
        return True


class BoardServer:
    """A board that can be reset, and cut off; the port stays the same."""

    def __init__(self, folder: Path, sbc: bool = False, password: str = "") -> None:
        self.folder, self.sbc, self.password, self.faults = folder, sbc, password, Faults()
        folder.mkdir(exist_ok=True)
        self.board = Board(folder, sbc=sbc)
        self.lines: list[str] = []
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.number = int(free.getsockname()[1])
        self.up()

    @property
    def port(self) -> str:
        return f"duet://127.0.0.1:{self.number}"

    def up(self) -> None:
        faults = self.faults

        class Faulty(Handler):
            board, sbc, password = self.board, self.sbc, self.password

            def answer(self) -> None:
                faults.asked.append(self.path)
                faults.meanwhile(self.path)
                while faults.take("hang", self.path):
                    time.sleep(0.01)
                if faults.take("drop", self.path):
                    self.close_connection = True
                elif faults.take("lose_answer", self.path):
                    self.wfile = open("/dev/null", "wb")  # noqa: SIM115
                    super().answer()
                    self.close_connection = True
                else:
                    super().answer()

        class Server(ThreadingHTTPServer):
            daemon_threads, allow_reuse_address = True, True
            ends: ClassVar[list[socket.socket]] = []

            def get_request(self) -> tuple[socket.socket, Any]:
                end, address = super().get_request()
                self.ends.append(end)
                return end, address

            def handle_error(self, *about: Any) -> None:
                """Say nothing of clients that have gone."""

        self.server = Server(("127.0.0.1", self.number), Faulty)
        threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True).start()

    def down(self) -> None:
        self.server.shutdown()
        self.server.server_close()
        for end in self.server.ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def reset(self) -> None:
        """Power off and on: the job is forgotten, the card isn't."""
        self.down()
        self.lines += self.board.run_lines
        self.board.status = "halted"  # its thread ends
        self.board = Board(self.folder, sbc=self.sbc)
        self.up()

    def strokes(self) -> list[str]:
        lines = self.lines + self.board.run_lines
        return [line for line in lines if line.startswith("G1") and " E" in line]

    def count(self, pattern: str) -> int:
        return sum(bool(re.search(pattern, path)) for path in self.faults.asked)


class Print:
    """A `FilePrint` of `JOB` in a thread, and its journal."""

    def __init__(self, folder: Path, server: BoardServer, key: str = "", **more: Any) -> None:
        folder.mkdir(exist_ok=True)
        path, printer = folder / "job.gcode", load(Printer, PROFILE)
        path.write_text(JOB)
        self.journal_path = folder / "journal.log"
        job = load_job(path, printer)
        hosted = HostedJob(job, path.read_bytes(), name_on_host("1-aa", job.name), printer)
        self.journal = Journal(self.journal_path)
        self.seen: list[Status] = []
        self.film = FilePrint(
            parse_address(server.port), key, hosted, self.journal, self.seen.append, **more
        )
        self.status: Status | None = None
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.how: dict[str, Any] = {}

    def _run(self) -> None:
        self.status = self.film.run(**self.how)

    def start(self, **how: Any) -> Print:
        self.how = how
        self.thread.start()
        return self

    def end(self, within_s: float = 20.0) -> Status:
        self.thread.join(within_s)
        self.journal.close()
        assert self.status is not None, f"it hangs: {self.film.status}"
        return self.status

    def steps(self) -> list[str]:
        records = [one for one in read_records(self.journal_path) if one]
        return [one["do"] for one in records if one["t"] == "host"]
