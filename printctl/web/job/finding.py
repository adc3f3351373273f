"""Find running prints of a workspace, also those started from the command line."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from printctl.machine.link.errors import LinkError, NoLink
from printctl.machine.link.find_link import alive
from printctl.machine.link.record import JOURNAL, RECORD, load_record
from printctl.machine.station.record import RECORD as STATION_RECORD
from printctl.web.workspace import Workspace

LOOK_AGAIN_S: Final = 1.0


def prints_of(workspace: Workspace) -> Iterator[tuple[str, Path]]:
    """Job and folder of every print that was ever started in a workspace."""
    for path in workspace.found(f"runs/*/print/{RECORD}"):
        yield f"run~{path.parent.parent.name}", path.parent
    for path in workspace.found(f"jobs/*.print/{RECORD}"):
        yield f"file~{path.parent.name.removesuffix('.print')}", path.parent


class Finder:
    """A thread that looks for prints that go on.

    Parameters
    ----------
    workspace : Workspace
    found : function
        Given job and folder of a print that goes on, each time that it is seen.
    ended : function
        Given job and folder of the newest print where none goes on, each time that it has changed.
    """

    def __init__(
        self,
        workspace: Workspace,
        found: Callable[[str, Path], None],
        ended: Callable[[str, Path], None],
    ) -> None:
        self._workspace, self._found, self._ended_print = workspace, found, ended
        self._newest: tuple[object, ...] = ()
        self._dead: dict[Path, int] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look, name="prints", daemon=True)

    def begin(self) -> None:
        """Start to look."""
        self._thread.start()

    def end(self) -> None:
        """Look no more."""
        self._ended.set()
        self._thread.join(5.0)

    def look(self) -> None:
        """Look once."""
        prints = list(prints_of(self._workspace))
        live = [(job, folder) for job, folder in prints if self._goes_on(folder)]
        for job, folder in live:
            self._found(job, folder)
        if prints and not live:
            self._look_at_newest(max(prints, key=lambda one: _changed(one[1] / RECORD)))

    def _look_at_newest(self, newest: tuple[str, Path]) -> None:
        """Hand on the newest print where anything has changed that its truth rests on."""
        job, folder = newest
        station = self._workspace.station / STATION_RECORD
        now = (folder, *map(_changed, (folder / RECORD, folder / JOURNAL, station)))
        if now != self._newest:
            self._newest = now
            with contextlib.suppress(LinkError, OSError):  # it begins, or goes away, meanwhile
                self._ended_print(job, folder)

    def _goes_on(self, folder: Path) -> bool:
        """Whether a link process lives there; one known to be dead isn't asked for its lock again.

        Asking takes the lock for a moment, in which no other process could begin there.
        """
        try:
            changed = (folder / RECORD).stat().st_mtime_ns
            if self._dead.get(folder) == changed:
                return False
            record = load_record(folder)
        except (NoLink, OSError):
            return False
        if not record.status and record.address and alive(folder):
            return True
        if record.status or record.address:
            self._dead[folder] = changed
        return False

    def _look(self) -> None:
        while not self._ended.is_set():
            # Without a file handle, say: the next look tells what this one couldn't see.
            with contextlib.suppress(OSError):
                self.look()
            self._ended.wait(LOOK_AGAIN_S)


def _changed(path: Path) -> int:
    """When a file was changed last, ns; 0 for one that isn't there."""
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0
