"""Moonraker, by its HTTP API (moonraker.readthedocs.io, Web API): upload, run, pause, state.

The file is selected (M23) and started by its name, by two commands. Between them the firmware
itself reports the file as loaded and not begun, which a restart of either program forgets: the
proof that a start whose answer was lost wasn't carried out.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final
from urllib.parse import quote, urlencode

from printctl.machine.errors import HostRefused
from printctl.machine.network.host import (
    ACTIVE,
    OVER,
    RUNNING,
    HostEnd,
    HostReport,
    HostRequest,
    HostState,
    StoredFile,
)
from printctl.machine.network.http_client import ANSWER_S, HttpHost, multipart

_QUERY: Final = (
    "/printer/objects/query?webhooks&print_stats=filename,state,message,total_duration"
    "&virtual_sdcard=file_path,file_position,file_size,progress"
    "&toolhead=print_time,estimated_print_time&motion_report=live_position&pause_resume"
)
_STATES: Final = {
    "printing": HostState.PRINTING,
    "paused": HostState.PAUSED,
    "complete": HostState.COMPLETE,
    "cancelled": HostState.CANCELLED,
    "error": HostState.FAILED,
}
_STILL_MOVING: Final = {
    HostState.PAUSED: HostState.PAUSING,
    HostState.COMPLETE: HostState.FINISHING,
    HostState.CANCELLED: HostState.CANCELLING,
}
"""The firmware reports an end once the last line is planned; its moves are made later."""
_HISTORY: Final = {
    "completed": HostState.COMPLETE,
    "cancelled": HostState.CANCELLED,
    "error": HostState.FAILED,
    "klippy_shutdown": HostState.FAILED,
    "klippy_disconnect": HostState.FAILED,
}
_ENDED_HERE: Final = ("completed", "cancelled", "error")
"""Ends of a print; the others are ends of what the host knew of it."""
_COMMAND_S: Final = 60.0
"""Longest wait for a command that waits for the lines planned before it."""
_NOT_CONNECTED: Final = 503


class Moonraker(HttpHost):
    """A Moonraker host; see `PrintHost`."""

    _since = 0.0
    """Start of the history that is asked for, s since 1970 by the host's clock."""

    def identify(self) -> str:
        """Return the host's program and version."""
        info = self.http.get("/server/info")["result"]
        if "history" not in info.get("components", ("history",)):
            raise HostRefused(
                "this Moonraker keeps no job history, by which a start is proved; put a section "
                "[history] into moonraker.conf"
            )
        return f"Moonraker {info.get('moonraker_version', '')}".strip()

    def upload(self, name: str, data: bytes, check: Callable[[float], None]) -> None:
        """Store a file; the host compares its checksum."""
        form = multipart(
            {"root": "gcodes", "checksum": hashlib.sha256(data).hexdigest()}, name, data
        )
        request = replace(form, method="POST", path="/server/files/upload")
        self.http.send(request, _COMMAND_S, check)

    def stored(self, name: str, data: bytes) -> StoredFile:
        """Return size and hash of the file as it is read back from the host."""
        request = HostRequest("GET", f"/server/files/gcodes/{quote(name)}")
        limit_s = _COMMAND_S if data else ANSWER_S
        back = self.http.send(request, limit_s, max_bytes=len(data) + 1)
        return StoredFile(len(back.body), sha256=hashlib.sha256(back.body).hexdigest())

    def select(self, name: str) -> None:
        """Load the file; nothing moves."""
        query = urlencode({"script": f"M23 {name}"})
        self.http.post(f"/printer/gcode/script?{query}", limit_s=_COMMAND_S)

    def start(self, name: str) -> None:
        """Start the file; refused while one is being printed, or without the file."""
        query = urlencode({"filename": name})
        self.http.post(f"/printer/print/start?{query}")

    def delete(self, name: str) -> None:
        """Delete the file; refused while it is being printed."""
        self.http.send(HostRequest("DELETE", f"/server/files/gcodes/{quote(name)}"))

    def pause(self, name: str) -> None:
        """Pause, by the printer's PAUSE."""
        self.http.post("/printer/print/pause", limit_s=_COMMAND_S)

    def resume(self, name: str) -> None:
        """Go on, by the printer's RESUME."""
        self.http.post("/printer/print/resume", limit_s=_COMMAND_S)

    def cancel(self, name: str) -> None:
        """End, by the printer's CANCEL_PRINT; the moves planned so far are made."""
        self.http.post("/printer/print/cancel", limit_s=_COMMAND_S)

    def halt_request(self) -> HostRequest:
        """Return the emergency stop (M112 past all queues)."""
        return HostRequest("POST", "/printer/emergency_stop", headers=self.http.headers)

    def state(self, name: str) -> HostReport:
        """Return what the firmware reports through the host."""
        try:
            result = self.http.get(_QUERY)["result"]
        except HostRefused as exc:
            if exc.status != _NOT_CONNECTED:
                raise
            return HostReport(HostState.OFFLINE, message=str(exc))
        report = read_state(result["status"])
        if report.state not in RUNNING:
            return report
        begun_s = result["eventtime"] - result["status"]["print_stats"]["total_duration"]
        return replace(report, begun_s=begun_s)

    def ended(self, name: str) -> HostEnd | None:
        """Return how the job history has the file's first print."""
        query = f"/server/history/list?limit=50&order=desc&since={self._since}"
        jobs = [job for job in self.http.get(query)["result"]["jobs"] if job["filename"] == name]
        if not jobs:
            return None
        status, self._since = str(jobs[-1]["status"]), float(jobs[-1]["start_time"]) - 1.0
        ends = sum(job["status"] in _ENDED_HERE for job in jobs)
        return HostEnd(_HISTORY.get(status), f"its job history says {status}", ends)


def read_state(found: dict[str, Any]) -> HostReport:
    """Read the status objects of one query."""
    hooks, stats, card = (
        found.get(key) or {} for key in ("webhooks", "print_stats", "virtual_sdcard")
    )
    words = str(hooks.get("state_message", "")).strip().partition("\n")[0]
    if hooks.get("state") in ("shutdown", "error"):
        return HostReport(HostState.HALTED, str(stats.get("filename", "")), message=words)
    if hooks.get("state") != "ready":
        return HostReport(HostState.OFFLINE, message=words)
    state, name = str(stats.get("state", "")), str(stats.get("filename") or "")
    loaded = HostState.READY if card.get("file_path") and name else HostState.IDLE
    reported = _STATES.get(state, loaded)
    head = found.get("toolhead") or {}
    moving = head.get("print_time", 0.0) > head.get("estimated_print_time", 0.0)
    if moving:
        reported = _STILL_MOVING.get(reported, reported)
    live = (found.get("motion_report") or {}).get("live_position")
    counted = reported in ACTIVE or reported in OVER
    return HostReport(
        reported,
        name,
        position=int(card["file_position"]) if counted and "file_position" in card else None,
        progress=float(card["progress"]) if counted and "progress" in card else None,
        message=str(stats.get("message") or ""),
        place=(float(live[0]), float(live[1]), float(live[2])) if live else None,
        moving=moving,
    )
