"""Twin of a Duet board's network interface: ``rr_`` requests, or ``/machine/`` with an SBC.

Modelled, standalone after RepRapFirmware's source (3.5.3: PrintMonitor, GCodes), with an SBC
after the description of Duet Software Framework (REST API, object model): sessions by address
(standalone) or key (SBC), upload with CRC-32, deletion, M23, M32, M24, M25, M0, M112, the object
model's ``state``, ``job``, ``move``, ``boards`` and (standalone) ``seqs.job``, a file run line by
line in the time that its moves take. Standalone, ``job.file.fileName`` is there only while the
file is printed, ``lastFileName`` only while none is (M23 sets it), and ``lastDuration`` alone
tells a print's end: 0 s but for a complete one. A new process is a board after a reset.

Not modelled: planning ahead, macros and the queue behind them, simulation, heaters, replies by
``rr_reply``, limits of memory and of sockets, any other G-code than G1 with F (others take no
time).
"""

from __future__ import annotations

import argparse
import json
import re
import secrets
import threading
import time
import zlib
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

_WORD = re.compile(r"([A-Z])(-?[0-9.]+)")
_SLICE_S = 0.01
_FOLDER = "0:/gcodes/"


@dataclass
class Board:
    """The board: files, the job, the tip.

    Attributes
    ----------
    folder : Path
        For stored files.
    sbc : bool
        Whether the object model is Duet Software Framework's.
    log : Path or None
        Gets ``seconds since 1970, command`` of each line run and of M112.
    """

    folder: Path
    log: Path | None = None
    sbc: bool = False
    status: str = "idle"
    place: dict[str, float] = field(default_factory=lambda: dict.fromkeys("XYZE", 0.0))
    selected: str = ""
    position: int | None = None
    last: dict[str, Any] = field(default_factory=dict)
    run_lines: list[str] = field(default_factory=list)
    sessions: set[str] = field(default_factory=set)
    changes: int = 0
    named: str = ""
    begun_s: float = 0.0
    _cancel: bool = False

    def code(self, text: str) -> str:
        """Carry out a command; return the reply."""
        word = text.split(maxsplit=1)[0] if text.strip() else ""
        if word == "M112":
            self.status = "halted"
            self._note("M112")
        elif self.status == "halted":
            return "Error: halted"
        elif word in ("M23", "M32"):
            wrong = self._select(text[3:].strip().strip('"').removeprefix(_FOLDER))
            return wrong or (self._start() if word == "M32" else "")
        elif word == "M24":
            return self._start()
        elif word == "M25" and self.status == "processing":
            self.status = "pausing"
        elif word == "M0" and self.status in ("pausing", "paused"):
            self._cancel = True
        return ""

    def model(self, key: str) -> Any:
        """Return a part of the object model."""
        file = {"fileName": _FOLDER + self.selected, "size": self._size()} if self.selected else {}
        job = (
            {"file": file, "filePosition": self.position, **self.last} if self.sbc else self._job()
        )
        return {
            "seqs": {"job": self.changes},
            "state": {"status": self.status, "upTime": int(time.monotonic())},
            "job": job,
            "move": {"axes": [{"letter": a, "userPosition": self.place[a]} for a in "XYZ"]},
            "boards": [{"firmwareName": "RepRapFirmware twin", "firmwareVersion": "3.5"}],
        }.get(key)

    def _job(self) -> dict[str, Any]:
        """Return what a standalone board says of its job."""
        runs, name = self.begun_s > 0.0, _FOLDER + self.named if self.named else None
        return {
            "file": {"fileName": name if runs else None, "size": self._size()},
            "filePosition": self.position if runs else 0,
            "duration": round(time.monotonic() - self.begun_s) if runs else None,
            "lastFileName": None if runs else name,
            "lastDuration": None if runs else self.last.get("lastDuration", 0),
        }

    def delete(self, name: str) -> bool:
        """Delete a file; return whether it was there and not open."""
        path = self.folder / name
        if name == self.selected or not path.is_file():
            return False
        path.unlink()
        return True

    def _size(self) -> int:
        path = self.folder / self.selected
        return path.stat().st_size if path.is_file() else 0

    def _note(self, text: str) -> None:
        self.run_lines.append(text)
        if self.log is not None:
            with self.log.open("a") as handle:
                handle.write(f"{time.time():.6f} {text}\n")

    def _select(self, name: str) -> str:
        if self.status not in ("idle", "busy") or not (self.folder / name).is_file():
            return f"Error: Cannot set file to print: {name}"
        self.selected, self.position, self.named = name, 0, name
        self.changes += 1
        return ""

    def _start(self) -> str:
        if self.status == "paused":
            self.status = "processing"
        elif self.status == "idle" and self.selected:
            self.status, self.named, self.begun_s = "processing", self.selected, time.monotonic()
            self.changes += 1
            threading.Thread(target=self._run, daemon=True).start()
        elif self.status == "idle":
            return "Error: M24: Cannot print, because no file is selected!"
        return ""

    def _run(self) -> None:
        """Run the selected file to its end."""
        for line in (self.folder / self.selected).read_bytes().splitlines(keepends=True):
            while self.status in ("pausing", "paused") and not self._cancel:
                self.status = "paused"
                time.sleep(_SLICE_S)
            if self._cancel or self.status == "halted":
                break
            self._move(line.decode().partition(";")[0].strip())
            self.position = (self.position or 0) + len(line)
        if self.status == "halted":
            return
        name, cancelled = self.selected, self._cancel
        lasted_s = 0 if cancelled else round(time.monotonic() - self.begun_s)
        ends = {"lastFileAborted": False, "lastFileCancelled": cancelled, "lastDuration": lasted_s}
        self.last = {"lastFileName": _FOLDER + name, **ends}
        self.selected, self.position, self._cancel, self.status = "", None, False, "idle"
        self.begun_s, self.changes = 0.0, self.changes + 1

    def _move(self, line: str) -> None:
        if not line:
            return
        self._note(line)
        words = {letter: float(value) for letter, value in _WORD.findall(line)}
        if line.startswith(("G92", "G1 ", "G0 ")):
            to = {axis: words.get(axis, self.place[axis]) for axis in "XYZE"}
            way = max(abs(to[axis] - self.place[axis]) for axis in "XYZE")
            until = time.monotonic() + (60 * way / words["F"] if "F" in words else 0.0)
            while time.monotonic() < until and self.status != "halted":
                time.sleep(_SLICE_S)
            self.place.update(to)


class Handler(BaseHTTPRequestHandler):
    """Answers one request; ``board``, ``sbc`` and ``password`` are its class's."""

    protocol_version = "HTTP/1.1"
    board: Board
    sbc = False
    password = ""

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Say nothing."""

    def do_GET(self) -> None:
        """Answer a GET."""
        self.answer()

    def do_POST(self) -> None:
        """Answer a POST."""
        self.answer()

    def do_PUT(self) -> None:
        """Answer a PUT."""
        self.answer()

    def do_DELETE(self) -> None:
        """Answer a DELETE."""
        self.answer()

    def answer(self) -> None:
        """Answer a request by the board."""
        split = urlsplit(self.path)
        query = {key: values[0] for key, values in parse_qs(split.query).items()}
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        mine = split.path.startswith("/machine/") == self.sbc
        if not mine:  # a standalone board sends its web page for a path without a dot
            status, value = (404, "") if self.sbc else (200, "<!DOCTYPE html>")
        else:
            status, value = self._known(split.path, query, body)
        data = value.encode() if isinstance(value, str) else json.dumps(value).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(data)))
        if not self.sbc:  # the board closes each connection
            self.send_header("Connection", "close")
            self.close_connection = True
        self.end_headers()
        self.wfile.write(data)

    def _known(self, path: str, query: dict[str, str], body: bytes) -> tuple[int, Any]:
        board = self.board
        session = self.headers.get("X-Session-Key", "") if self.sbc else self.client_address[0]
        if path.endswith("connect"):
            if query.get("password", "") != self.password:
                return (403, "") if self.sbc else (200, {"err": 1})
            key = secrets.token_hex(8) if self.sbc else session
            board.sessions.add(key)
            return 200, {"sessionKey": key} if self.sbc else {"err": 0}
        if session not in board.sessions:
            return (403 if self.sbc else 401), ""
        if self.sbc:
            return self._of_sbc(path.removeprefix("/machine/"), body)
        name = query.get("name", "").removeprefix(_FOLDER)
        if path == "/rr_upload":
            wrong = int(query.get("crc32", "0"), 16) not in (0, zlib.crc32(body))
            if not wrong:
                (board.folder / name).write_bytes(body)
            return 200, {"err": int(wrong)}
        if path == "/rr_fileinfo":
            return self._info(name)
        if path == "/rr_delete":
            return 200, {"err": int(not board.delete(name))}
        if path == "/rr_gcode":
            board.code(query.get("gcode", ""))
            return 200, {"buff": 255}
        if path == "/rr_model":
            return 200, {"key": query["key"], "flags": "", "result": board.model(query["key"])}
        return 404, ""

    def _of_sbc(self, path: str, body: bytes) -> tuple[int, Any]:
        board, (do, _, rest) = self.board, path.partition("/")
        name = unquote(rest).removeprefix(_FOLDER)
        if do == "file" and self.command == "DELETE":
            return (204 if board.delete(name) else 404), ""
        if do == "file":
            (board.folder / name).write_bytes(body)
            return 201, ""
        if do == "fileinfo":
            return self._info(name)
        if do == "code":
            return 200, board.code(body.decode())
        if do == "model":
            return 200, {key: board.model(key) for key in ("state", "job", "move", "boards")}
        return 404, ""

    def _info(self, name: str) -> tuple[int, Any]:
        path = self.board.folder / name
        if not path.is_file():
            return (404, "") if self.sbc else (200, {"err": 1})
        return 200, {"err": 0, "fileName": name, "size": path.stat().st_size}


def serve(
    board: Board, port: int = 0, sbc: bool = False, password: str = ""
) -> ThreadingHTTPServer:
    """Return a server of a board, bound and not yet serving; port 0 takes a free one."""
    own = {"board": board, "sbc": sbc, "password": password}
    return ThreadingHTTPServer(("127.0.0.1", port), type("OwnHandler", (Handler,), own))


def main() -> None:
    """Serve until killed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--sbc", action="store_true")
    parser.add_argument("--password", default="")
    given = parser.parse_args()
    board = Board(given.folder, given.log, given.sbc)
    serve(board, given.port, given.sbc, given.password).serve_forever()


if __name__ == "__main__":
    main()
