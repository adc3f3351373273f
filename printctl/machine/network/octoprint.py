"""OctoPrint, by its REST API (docs.octoprint.org/en/main/api): upload, select, start, state.

There is no emergency stop of its own: M112 is sent as a command, which OctoPrint passes before its
queue. It doesn't report where the tip is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final
from urllib.parse import quote

from printctl.machine.errors import HostRefused
from printctl.machine.network.host import (
    HostEnd,
    HostReport,
    HostRequest,
    HostState,
    StoredFile,
)
from printctl.machine.network.http_client import HttpHost, multipart

_STATES: Final = {
    "Starting": HostState.PRINTING,
    "Printing": HostState.PRINTING,
    "Pausing": HostState.PAUSING,
    "Paused": HostState.PAUSED,
    "Resuming": HostState.RESUMING,
    "Finishing": HostState.FINISHING,
    "Cancelling": HostState.CANCELLING,
}
_UPLOAD_S: Final = 60.0
_NO_FILE: Final = 404


class OctoPrint(HttpHost):
    """An OctoPrint host; see `PrintHost`."""

    def identify(self) -> str:
        """Return the host's program and version."""
        return str(self.http.get("/api/version")["text"])

    def upload(self, name: str, data: bytes, check: Callable[[float], None]) -> None:
        """Store a file."""
        form = multipart({}, name, data)
        self.http.send(replace(form, method="POST", path="/api/files/local"), _UPLOAD_S, check)

    def stored(self, name: str, data: bytes) -> StoredFile:
        """Return size and hash as the host has them."""
        found = self._file(name) or {}
        return StoredFile(int(found.get("size", -1)), sha1=str(found.get("hash", "")))

    def select(self, name: str) -> None:
        """Select the file; nothing moves."""
        self.http.post(f"/api/files/local/{quote(name)}", {"command": "select", "print": False})

    def start(self, name: str) -> None:
        """Select the file and start it; refused while one is being printed, or without the file."""
        self.http.post(f"/api/files/local/{quote(name)}", {"command": "select", "print": True})

    def delete(self, name: str) -> None:
        """Delete the file; refused while it is being printed."""
        self.http.send(HostRequest("DELETE", f"/api/files/local/{quote(name)}"))

    def pause(self, name: str) -> None:
        """Pause, by the host's own script."""
        self.http.post("/api/job", {"command": "pause", "action": "pause"})

    def resume(self, name: str) -> None:
        """Go on after a pause."""
        self.http.post("/api/job", {"command": "pause", "action": "resume"})

    def cancel(self, name: str) -> None:
        """End, by the host's own script; what the printer holds is made."""
        self.http.post("/api/job", {"command": "cancel"})

    def halt_request(self) -> HostRequest:
        """Return M112 as a command; OctoPrint closes the port behind it."""
        headers = {**self.http.headers, "Content-Type": "application/json"}
        return HostRequest("POST", "/api/printer/command", b'{"command": "M112"}', headers)

    def state(self, name: str) -> HostReport:
        """Return what the host reports of its job."""
        report = read_job(self.http.get("/api/job"))
        if report.state is not HostState.IDLE or report.file != name:
            return report
        end = self.ended(name)
        if end is not None and end.state is not None:
            return replace(report, state=end.state, message=end.message)
        if report.position or report.progress:  # read, and its end isn't in the record yet
            return replace(report, state=HostState.FINISHING)
        return replace(report, state=HostState.READY)

    def ended(self, name: str) -> HostEnd | None:
        """Return how the file's own record has its last print."""
        prints = (self._file(name) or {}).get("prints") or {}
        if not prints.get("last"):
            return None
        ends = int(prints.get("success", 0)) + int(prints.get("failure", 0))
        if prints["last"].get("success"):
            return HostEnd(HostState.COMPLETE, "its record says: successful", ends)
        words = "its record says: not successful (cancelled, or failed)"
        return HostEnd(HostState.FAILED, words, ends)

    def _file(self, name: str) -> dict[str, Any] | None:
        try:
            found: dict[str, Any] = self.http.get(f"/api/files/local/{quote(name)}")
        except HostRefused as exc:
            if exc.status == _NO_FILE:
                return None
            raise
        return found


def read_job(found: dict[str, Any]) -> HostReport:
    """Read ``/api/job``; IDLE for a printer at rest, whatever file is selected."""
    text = str(found.get("state") or "")
    file, progress = (found.get("job") or {}).get("file") or {}, found.get("progress") or {}
    share = progress.get("completion")
    first = text.split(" ")[0]
    state = HostState.IDLE if text == "Operational" else _STATES.get(first, HostState.OFFLINE)
    return HostReport(
        state,
        str(file.get("path") or ""),
        position=progress.get("filepos"),
        progress=None if share is None else float(share) / 100.0,
        message=str(found.get("error") or (text if state is HostState.OFFLINE else "")),
    )
