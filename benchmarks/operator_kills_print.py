"""One print from the web page whose processes are killed, and the reports about it afterwards."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from benchmarks.checkers.journal_verdict import Written, lives, read_written
from benchmarks.link_files import START_MM, PrintFile
from benchmarks.link_printers import PeerFailedError
from benchmarks.machine import ROOT
from benchmarks.operator_kills_offers import may, offers
from benchmarks.operator_page import PageServer
from benchmarks.operator_server import browsers

_LIMIT_S: Final = 2.0
_PATIENCE_S: Final = 60.0
_CLICKED_EVERY: Final = 5
_MOUNTED: Final = {
    "syringe": "hamilton_1ml",
    "ink": "collagen_fresh",
    "needle": "22g",
    "bath": "gelatin_support",
}
Told = dict[str, Any]


@dataclass(frozen=True)
class Kill:
    """Which process, when, and how far into that moment (0 to 1)."""

    victim: str
    moment: str
    part: float


@dataclass
class Killed:
    """What was seen after a kill.

    Attributes
    ----------
    kill : Kill
    agreed_s : float, s
        From the kill (of the server: from when it answers again) to the first answer that agrees
        with the journal.
    restart_s : float, s
        How long a killed server took to come up.
    resumable, went_on, clicked : bool
        Whether the journal says that the print can be gone on with, whether it was, and by clicks.
    wrong : list of str
        Contradictions.
    """

    kill: Kill
    agreed_s: float = 0.0
    restart_s: float = 0.0
    resumable: bool = False
    went_on: bool = False
    clicked: bool = False
    wrong: list[str] = field(default_factory=list)


class KilledPrint:
    """A print that is started, killed, gone on with and finished through the page's interface.

    Parameters
    ----------
    page : PageServer
    file : PrintFile
    number : int
        Of the print; every fifth is gone on with by clicks in Chromium.
    port : str
        Of the simulated printer.
    """

    def __init__(self, page: PageServer, file: PrintFile, number: int, port: str) -> None:
        self.page, self.number, self.port = page, number, port
        self.killed: list[Killed] = []
        self._lines = len([one for one in file.lines if not one.startswith(b";")])
        self._connect()
        self.job = page.upload(f"p{number}.gcode", file.data)
        self.folder = page.workspace / "jobs" / f"p{number}.gcode.print"
        self._prepare()
        self._started = False

    # --- a kill ------------------------------------------------------------------------------

    def kill(self, kill: Kill) -> bool:
        """Bring the print to a moment, kill a process there, look at what is told, go on.

        Returns whether it could be: the print may have ended before.
        """
        seen = Killed(kill)
        if kill.moment != "start" and not self._started:
            self._start()
        if kill.victim == "link" and self._station_pid():  # the print is still the station's
            os.kill(self._station_pid(), signal.SIGKILL)
            self._until(lambda told: told["state"] == "interrupted")
        working = self._reach(kill)
        if self._started and self._written().ended:
            return False
        self.killed.append(seen)
        at = time.monotonic()
        self._strike(kill, seen)
        self._look(seen, at if kill.victim != "server" else time.monotonic())
        working.join(_PATIENCE_S)
        self._settle(seen)
        return True

    def finish(self) -> list[str]:
        """Let the print end; return what is wrong with its end."""
        if not self._started:
            self._start()
        told = self._until(lambda told: told["ended"], resume=True)
        wrong = []
        written = read_written(self.folder / "journal.log")
        if told["state"] != "done" or written.state != "done":
            wrong.append(f"print {self.number} ended as {told['state']}: {told['message']}")
        self.leave()
        return wrong

    def leave(self) -> None:
        """Let go of the printer; what still prints is killed."""
        status, told = self.page.ask(f"/api/v1/prints/{self.job}")
        if status == 200 and not told["ended"]:
            self.page.ask("/api/v1/stop", "POST")
            time.sleep(4)
        elif status == 200 and told["state"] == "interrupted":
            self.page.ask(f"/api/v1/prints/{self.job}/give-up", "POST")
        if self._station_pid():
            self.page.ask("/api/v1/printer/disconnect", "POST")
        if self._station_pid():
            os.kill(self._station_pid(), signal.SIGKILL)

    # --- moments -----------------------------------------------------------------------------

    def _reach(self, kill: Kill) -> threading.Thread:
        """Reach the moment of a kill; return the thread whose call is under way."""
        calls: dict[str, Callable[[], object]] = {
            "start": self._ask_start,
            "pausing": lambda: self._post("pause", {"after": "now"}),
            "resuming": lambda: self._post("resume", {}),
            "going on": lambda: self._post("go-on"),
        }
        if kill.moment == "going on" and self._told()["state"] != "interrupted":
            os.kill(self._holder(), signal.SIGKILL)
            self._until(lambda told: told["state"] == "interrupted")
        if kill.moment != "going on":
            self._broken_off_goes_on()
        if kill.moment == "printing":
            done = self._until(lambda told: told["state"] == "printing", resume=True)["lines_done"]
            goal = done + 1 + 0.3 * kill.part * (self._lines - done)
            self._until(lambda told: told["lines_done"] >= goal or told["ended"])
        elif kill.moment != "start":
            self._ready_for(kill.moment)
        call = calls.get(kill.moment, lambda: None)
        working = threading.Thread(target=call, daemon=True)
        working.start()
        reach = {"start": 1.5, "going on": 2.0}.get(kill.moment, 0.6)
        time.sleep(reach * kill.part if kill.moment in calls else 0.0)
        return working

    def _ready_for(self, moment: str) -> None:
        if moment == "pausing":
            self._until(lambda told: told["state"] == "printing", resume=True)
        elif moment in ("paused", "resuming"):
            if self._told()["state"] != "paused":
                self._until(lambda told: told["state"] == "printing")
                self._post("pause", {"after": "now"})
            self._until(lambda told: told["state"] == "paused" or told["ended"])

    def _strike(self, kill: Kill, seen: Killed) -> None:
        if kill.victim == "server":
            self.page.kill()
            seen.restart_s = self.page.start()
        elif kill.victim == "door":
            self.page.kill_door()
        else:
            os.kill(self._holder(), signal.SIGKILL)

    # --- what is told ------------------------------------------------------------------------

    def _look(self, seen: Killed, at: float) -> None:
        """Hold what is told against the journal until 2 s after ``at``, and the command line."""
        before = self._written()
        first, wrong = float("inf"), ["never asked"]
        while True:
            now = time.monotonic() - at
            wrong = self._contradictions(before)
            first = float("inf") if wrong else min(first, now)
            if now >= _LIMIT_S:
                break
            time.sleep(0.05)
        seen.agreed_s = first
        if seen.kill.victim == "door" and not self.page.door_answers():
            wrong.append("the stop process doesn't answer")
        wrong += self._command_line()
        where = f"print {self.number}, {seen.kill.victim} killed while {seen.kill.moment}"
        seen.wrong += [f"{where}: {text}" for text in wrong]

    def _contradictions(self, at_kill: Written) -> list[str]:
        """What REST says of the print against the journal as it was before and after asking."""
        before = self._written()
        status, told = self.page.ask(f"/api/v1/prints/{self.job}")
        after = self._written()
        if status != 200:
            return [] if not after.pid else [f"REST answers {status} {told}"]
        if not after.pid and not after.state:  # not begun: it can't be told to go on
            return [] if not may(told, "go_on") else ["go on is offered before the first line"]
        wrong = []
        if told["state"] not in (before.true_state, after.true_state):
            wrong.append(f"REST says {told['state']}, the journal {after.true_state}")
        over = after.true_state == "interrupted" or after.ended
        low, high = (after.done, after.done) if over else (at_kill.done, float("inf"))
        if before == after and not low <= told["lines_done"] <= high:
            wrong.append(f"REST says {told['lines_done']} lines, the journal {after.done}")
        if before == after:
            wrong += offers(told, after)
        station = self.page.ask("/api/v1/printer/status")[1]
        if not self._station_pid() and station["state"] not in ("lost", "closed"):
            wrong.append(f"the station's process is gone, and REST says {station['state']}")
        return wrong

    def _command_line(self) -> list[str]:
        """What `printctl status` says against REST."""
        command = [sys.executable, "-m", "printctl", "status", str(self.folder), "--json"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        status, told = self.page.ask(f"/api/v1/prints/{self.job}")
        if status != 200 or done.returncode:
            both = (status == 200) != (done.returncode == 0)
            return [f"REST {status}, command {done.stderr[-200:]}"] if both else []
        said = json.loads(done.stdout)
        if not (said["ended"] and told["ended"]):
            return []  # it goes on meanwhile
        keys = ("state", "message", "lines_done", "lines_executed", "actions", "position_known")
        return [
            f"{key}: REST {told[key]!r}, command {said[key]!r}"
            for key in keys
            if _unclocked(told[key]) != _unclocked(said[key])
        ]

    # --- going on ----------------------------------------------------------------------------

    def _settle(self, seen: Killed) -> None:
        """After a kill: go on with a print that was interrupted, or begin anew what never began."""
        written = self._written()
        holder_died = written.true_state == "interrupted"
        if seen.kill.moment == "start":
            self._started = bool(written.pid) and not (holder_died and not written.resumable)
        if not holder_died:
            return
        seen.resumable = written.resumable
        if written.resumable:
            seen.clicked = self.number % _CLICKED_EVERY == 0
            seen.went_on = self._click_go_on(seen) if seen.clicked else self._go_on(seen)
            return
        status, said = self._post("give-up")
        if status != 200:
            seen.wrong.append(f"print {self.number}: give up answers {status} {said}")
        if self._station_pid():
            os.kill(self._station_pid(), signal.SIGKILL)
        self._connect()
        self._prepare()
        self._started = False

    def _go_on(self, seen: Killed) -> bool:
        status, said = self._post("go-on")
        if status == 200 and said["state"] not in ("interrupted", "failed", "position_unknown"):
            return True
        seen.wrong.append(f"print {self.number}: go-on answers {status} {said}")
        return False

    def _click_go_on(self, seen: Killed) -> bool:
        """Go on by two clicks in Chromium."""
        try:
            with browsers(1) as (page,):
                page.goto(f"{self.page.url}/job?job={self.job}")
                page.wait_for_selector("#pc-take:visible")
                while page.locator("#pc-take").inner_text() != "Release":
                    page.locator("#pc-take").click()
                    page.wait_for_timeout(300)
                page.get_by_role("button", name="Go on …").first.click(timeout=20_000)
                page.get_by_role("button", name="Yes, go on").click(timeout=20_000)
                self._until(lambda told: told["state"] != "interrupted")
        except Exception as exc:  # whatever a browser's library raises
            seen.wrong.append(f"print {self.number}: no two clicks lead on: {str(exc)[:400]}")
            return False
        finally:
            self.page.ask("/api/v1/controls", "POST", {"force": True})
        return True

    def _broken_off_goes_on(self) -> None:
        if self._started and self._told()["state"] == "interrupted":
            self._post("go-on")

    # --- asking ------------------------------------------------------------------------------

    def _connect(self) -> None:
        want = self.page.want
        want("/api/v1/printer/connect", body={"profile": "generic_marlin", "port": self.port})
        x, y, z = START_MM
        want("/api/v1/printer/set-position", body={"x": x, "y": y, "z": z})
        want("/api/v1/printer/mount", body=_MOUNTED)

    def _prepare(self) -> None:
        """Fill in what a start wants, and check the job."""
        form = self.page.ask(f"/api/v1/jobs/{self.job}/form")[1]
        ticked = {point["id"]: True for point in form["checklist"]}
        record = {"operator": "Ada", "ticked": ticked}
        self.page.want(f"/api/v1/jobs/{self.job}/record", "PATCH", record)
        found = self.page.want(f"/api/v1/jobs/{self.job}/preflight", body={})
        if not found["passed"]:
            failed = [one for one in found["checks"] if one["result"] == "failed"]
            raise PeerFailedError(f"the job doesn't pass its checks: {failed}")
        self._words = form["machine"]["words"]

    def _ask_start(self) -> tuple[int, Any]:
        return self._post("start", {"confirmed": self._words})

    def _start(self) -> None:
        status, said = self._ask_start()
        if status != 200:
            raise PeerFailedError(f"the start: {status} {said}")
        self._started = True

    def _post(self, what: str, body: object = None) -> tuple[int, Any]:
        try:
            return self.page.ask(f"/api/v1/prints/{self.job}/{what}", "POST", body)
        except OSError as exc:  # the server was killed meanwhile
            return 0, str(exc)

    def _told(self) -> Told:
        status, told = self.page.ask(f"/api/v1/prints/{self.job}")
        if status != 200:
            raise PeerFailedError(f"the print: {status} {told}")
        return dict(told)

    def _until(self, so: Callable[[Told], bool], resume: bool = False) -> Told:
        limit = time.monotonic() + _PATIENCE_S
        for told in self._polled(limit):
            if so(told) or told["state"] == "done":
                return told
            if resume and told["state"] == "paused" and told["waits_for"] == "":
                self._post("resume", {})
            if resume and told["state"] == "interrupted":
                self._post("go-on")
        raise PeerFailedError(f"it stays {told['state']}: {told['message']}")

    def _polled(self, limit: float) -> Iterator[Told]:
        while time.monotonic() < limit:
            yield self._told()
            time.sleep(0.05)

    def _written(self) -> Written:
        return read_written(self.folder / "journal.log")

    def _holder(self) -> int:
        """The process that speaks to the printer."""
        limit = time.monotonic() + _PATIENCE_S
        while time.monotonic() < limit:
            found = self._station_pid() or _live_pid(self.folder / "link.json")
            if found:
                return found
            time.sleep(0.01)
        raise PeerFailedError("nobody speaks to the printer")

    def _station_pid(self) -> int:
        return _live_pid(self.page.workspace / "station" / "station.json")


def _live_pid(record: Path) -> int:
    with contextlib.suppress(OSError, ValueError, KeyError):
        pid = int(json.loads(record.read_text())["pid"])
        return pid if lives(pid) else 0
    return 0


def _unclocked(told: Any) -> Any:
    """Leave out how long ago something was: two questions are never asked at once."""
    return re.sub(r"last word \d+ s ago", "last word", told) if isinstance(told, str) else told
