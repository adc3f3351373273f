"""Duet boards: ``rr_`` requests of a standalone board, ``/machine/`` of one with an SBC.

Written from RepRapFirmware's source (3.5.3: PrintMonitor, GCodes; standalone) and the description
of Duet Software Framework (REST API, object model; SBC), and tried on a twin alone, on no real
board.

The file is selected (M23) and started by its name (M32). An SBC says which file is selected and
how the last one ended. A standalone board names as its last file one that is selected as well as
one that has ended. That it hasn't begun is known while the board's count of changes to its job is
what it was before the start; that it is complete, by a duration above 0 of a file that had begun.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final
from urllib.parse import quote, urlencode

from printctl.machine.errors import HostRefused, HostSilent
from printctl.machine.network.host import (
    RUNNING,
    HostAddress,
    HostEnd,
    HostReport,
    HostRequest,
    HostState,
    StoredFile,
)
from printctl.machine.network.http_client import ANSWER_S, HttpHost, HttpReply

_STATES: Final = {
    "processing": HostState.PRINTING,
    "simulating": HostState.PRINTING,
    "pausing": HostState.PAUSING,
    "paused": HostState.PAUSED,
    "resuming": HostState.RESUMING,
    "cancelling": HostState.CANCELLING,
    "halted": HostState.HALTED,
    "off": HostState.OFFLINE,
    "starting": HostState.OFFLINE,
    "updating": HostState.OFFLINE,
    "disconnected": HostState.OFFLINE,
}
_FOLDER: Final = "0:/gcodes/"
_UPLOAD_S: Final = 60.0
_COMMAND_S: Final = 60.0
_SAME_BEGIN_S: Final = 8.0
"""Reported times of one begin differ by whole seconds and by what lies between two answers."""
_KEYS: Final = ("state", "job", "move")
_LOGIN: Final = (401, 403)
_ABSENT: Final = (404, 405, 501)


class Duet(HttpHost):
    """A Duet board, with an SBC or without; see `PrintHost`."""

    def __init__(self, address: HostAddress, key: str = "") -> None:
        super().__init__(address)
        self.secret = key
        self._sbc: bool | None = None
        self._selected: str | None = None
        self._changes = -1  # standalone: to the job, before the start
        self._begun_s, self._lasted_s, self._simulated = 0.0, math.inf, False

    def identify(self) -> str:
        """Log in; return the board's firmware and its version."""
        self._log_in()
        boards = self._model("boards")
        main = boards[0] if boards else {}
        words = f"{main.get('firmwareName', 'Duet')} {main.get('firmwareVersion', '')}".strip()
        return f"{words} ({'SBC' if self._sbc else 'standalone'})"

    def upload(self, name: str, data: bytes, check: Callable[[float], None]) -> None:
        """Store a file; a standalone board compares its CRC-32."""
        if self._is_sbc():
            self._send(HostRequest("PUT", _file("file", name), data), _UPLOAD_S, check)
            return
        crc = f"{zlib.crc32(data):08x}"
        query = urlencode({"name": _FOLDER + name, "crc32": crc})
        headers = {"Content-Type": "application/octet-stream"}
        request = HostRequest("POST", f"/rr_upload?{query}", data, headers)
        if self._send(request, _UPLOAD_S, check).json().get("err"):
            raise HostRefused(
                f"the board refused {name}: its CRC-32 isn't {crc}, or it has no room"
            )

    def stored(self, name: str, data: bytes) -> StoredFile:
        """Return the size as the board reports it."""
        path = _file("fileinfo", name) if self._is_sbc() else _rr_file("fileinfo", name)
        found = self._send(HostRequest("GET", path), _COMMAND_S if data else ANSWER_S).json()
        return StoredFile(int(found.get("size", -1)))

    def select(self, name: str) -> None:
        """Select the file; nothing moves."""
        self._selected, self._changes = name, -1
        self._code(f'M23 "{_FOLDER}{name}"')

    def start(self, name: str) -> None:
        """Select the file and start it; unlike M24 that never goes on with a paused one."""
        if not self._is_sbc():
            self._changes = self._model("seqs")["job"]
        self._code(f'M32 "{_FOLDER}{name}"', ANSWER_S)

    def delete(self, name: str) -> None:
        """Delete the file."""
        if self._is_sbc():
            self._send(HostRequest("DELETE", _file("file", name)), ANSWER_S)
            return
        request = HostRequest("GET", _rr_file("delete", name))
        if self._send(request, ANSWER_S).json().get("err"):
            raise HostRefused(f"the board doesn't delete {name}")

    def pause(self, name: str) -> None:
        """Pause, by the board's pause.g."""
        self._code("M25")

    def resume(self, name: str) -> None:
        """Go on, by the board's resume.g."""
        self._code("M24")

    def cancel(self, name: str) -> None:
        """Pause, then end, by the board's cancel.g; refused while it pauses or goes on."""
        if (status := self._model("state")["status"]) in ("pausing", "resuming"):
            raise HostRefused(f"the board is {status}, and would refuse it")
        with suppress(HostSilent):  # if it was lost as well, the board refuses M0
            self._code("M25")
        self._code("M0")

    def halt_request(self) -> HostRequest:
        """Return M112, which the board takes before its queues."""
        if self._sbc:
            return HostRequest("POST", "/machine/code", b"M112", self.http.headers)
        return HostRequest("GET", "/rr_gcode?gcode=M112")

    def state(self, name: str) -> HostReport:
        """Return what the board's object model reports."""
        if self._is_sbc():
            model = self._send(HostRequest("GET", "/machine/model"), ANSWER_S).json()
            return read_model(model.get("state"), model.get("job"), model.get("move"), name)
        state, job, move = (self._model(key) for key in _KEYS)
        report, status = read_model(state, job, move, name), state["status"]
        if status == "simulating":
            self._simulated = True
            return replace(report, message="it simulates (M37), and nothing moves")
        if report.state in RUNNING:
            lasted_s = job.get("duration")
            if lasted_s is None:  # over between the two questions
                return report
            begun_s = float(state["upTime"] - lasted_s - (job.get("pauseDuration") or 0))
            if lasted_s < self._lasted_s or abs(begun_s - self._begun_s) > _SAME_BEGIN_S:
                self._begun_s = begun_s
            self._lasted_s = lasted_s
            return replace(report, begun_s=self._begun_s)
        if report.state is HostState.IDLE and status != "idle":  # a macro: a start would wait
            own = name if self.begun and report.file == name else ""
            return replace(report, state=HostState.FINISHING, file=own)
        if report.state is not HostState.IDLE or report.file != name or self.begun:
            return report
        if self._selected == name and self._changes in (-1, self._model("seqs")["job"]):
            return replace(report, state=HostState.READY)
        return replace(report, message="its last file, begun and ended or never begun")

    def active_file(self, name: str) -> str:
        """Return the file that is run: a standalone board names it while it runs alone."""
        if self._is_sbc():
            return self.state(name).active_file
        return _base((self._model("job").get("file") or {}).get("fileName"))

    def ended(self, name: str) -> HostEnd | None:
        """Return how the board has its last job, if that was the file's."""
        job = self._model("job")
        if self._is_sbc():
            end = _last_end(job, name)
            return None if end is None else HostEnd(end, "the board's last job")
        if not self.begun or _base(job.get("lastFileName")) != name:
            return None
        if self._simulated:
            return HostEnd(HostState.FAILED, "the board simulated it (M37), and nothing moved")
        if job.get("lastDuration"):
            return HostEnd(HostState.COMPLETE, "the board's last job")
        words = "the board says only that it isn't complete (cancelled, failed, or under 0.5 s)"
        return HostEnd(HostState.FAILED, words)

    # --- sessions and requests -----------------------------------------------------------------

    def _is_sbc(self) -> bool:
        if self._sbc is None:
            self._log_in()
        return bool(self._sbc)

    def _log_in(self) -> None:
        """Open a session; the SBC's request is unknown to a standalone board."""
        query = urlencode({"password": self.secret})
        try:
            reply = self.http.send(HostRequest("GET", f"/machine/connect?{query}"))
            key = str(reply.json()["sessionKey"])
        except HostRefused as exc:
            if exc.status not in _ABSENT:
                raise
        except (LookupError, TypeError, ValueError):
            pass  # the page on its card, which is what it sends for a path that it doesn't know
        else:
            self._sbc, self.http.headers = True, {"X-Session-Key": key}
            return
        self._sbc = False
        if self.http.get(f"/rr_connect?{query}").get("err"):
            raise HostRefused("the board refuses the password, or has no session free", _LOGIN[0])

    def _send(
        self,
        request: HostRequest,
        limit_s: float = _COMMAND_S,
        check: Callable[[float], None] | None = None,
    ) -> HttpReply:
        """Send a request; log in once where the session has ended (it wasn't carried out then)."""
        self._is_sbc()
        try:
            return self.http.send(request, limit_s, check)
        except HostRefused as exc:
            if exc.status not in _LOGIN:
                raise
        self._log_in()
        return self.http.send(request, limit_s, check)

    def _code(self, text: str, limit_s: float = _COMMAND_S) -> None:
        if self._is_sbc():
            request = HostRequest("POST", "/machine/code", text.encode())
            reply = self._send(request, limit_s).body.decode()
            if reply.startswith("Error"):
                raise HostRefused(f"{text}: {reply.strip()}", 400)
            return
        self._send(HostRequest("GET", f"/rr_gcode?{urlencode({'gcode': text})}"), limit_s)

    def _model(self, key: str) -> Any:
        if self._is_sbc():
            return self._send(HostRequest("GET", "/machine/model"), ANSWER_S).json().get(key)
        query = urlencode({"key": key, "flags": "d99vn"})
        return self._send(HostRequest("GET", f"/rr_model?{query}"), ANSWER_S).json().get("result")


def read_model(state: Any, job: Any, move: Any, name: str) -> HostReport:
    """Read the object model's ``state``, ``job`` and ``move``, seen from the print of ``name``.

    A standalone board's last file is left to `Duet.state`: it doesn't say how that ended.
    """
    state, job = state or {}, job or {}
    status, file = str(state["status"]), job.get("file") or {}
    current = _base(file.get("fileName"))
    reported = _STATES.get(status, HostState.IDLE)
    if reported is HostState.IDLE:  # idle, busy, changingTool
        end = _last_end(job, name) if "lastFileCancelled" in job else None
        if current:
            reported = HostState.READY if status == "idle" else HostState.PRINTING
        elif end is not None:
            reported, current = (end if status == "idle" else HostState.FINISHING), name
    current = current or _base(job.get("lastFileName"))
    position, size = job.get("filePosition") or None, file.get("size")
    axes = {str(axis.get("letter")): axis for axis in (move or {}).get("axes") or ()}
    place = [axes.get(letter, {}).get("userPosition") for letter in "XYZ"]
    known = all(isinstance(mm, (int, float)) for mm in place)
    return HostReport(
        reported,
        current,
        position=position,
        progress=min(position / size, 1.0) if position is not None and size else None,
        place=(float(place[0]), float(place[1]), float(place[2])) if known else None,
    )


def _last_end(job: Any, name: str) -> HostState | None:
    if not job or _base(job.get("lastFileName")) != name:
        return None
    if job.get("lastFileCancelled"):
        return HostState.CANCELLED
    unmade = job.get("lastFileAborted") or job.get("lastFileSimulated")
    return HostState.FAILED if unmade else HostState.COMPLETE


def _file(do: str, name: str) -> str:
    return f"/machine/{do}/{quote(_FOLDER + name, safe='')}"


def _rr_file(do: str, name: str) -> str:
    return f"/rr_{do}?{urlencode({'name': _FOLDER + name})}"


def _base(path: Any) -> str:
    return str(path or "").rpartition("/")[2]
