"""Record a print's time-lapse: one picture per layer or vessel, a video at the end."""

from __future__ import annotations

import logging
import queue
import shutil
import subprocess
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from design.files import write_bytes
from printctl.machine.prints.progress import Progress
from printctl.machine.records.folders import film_file, frames_folder
from printctl.sources import python_command
from printctl.web.job.camera.camera import CameraProcess
from printctl.web.job.prints import PrintReport

log = logging.getLogger(__name__)
MOST_FRAMES: Final = 2000
MOST_BYTES: Final = 500_000_000
LEAVE_FREE_BYTES: Final = 1_000_000_000
_WAITING: Final = 16


@dataclass(frozen=True)
class TimeLapseState:
    """State of a time-lapse: pictures kept, and whether its film is there or being made.

    ``message`` says why no more pictures are kept, or why there is no film.
    """

    frames: int
    bytes: int
    film: bool
    making: bool
    message: str


class TimeLapse:
    """Keeps pictures of the prints that go on, in a thread of its own.

    Without a camera films are still made of what was kept.
    """

    def __init__(self, camera: CameraProcess | None) -> None:
        self._camera = camera
        self._marks: dict[Path, int] = {}
        self._ended: set[Path] = set()
        self._making: set[Path] = set()
        self._said: dict[Path, str] = {}
        self._waiting: queue.Queue[tuple[str, Path] | None] = queue.Queue(_WAITING)
        self._film: subprocess.Popen[bytes] | None = None
        self._closed = False
        self._thread = threading.Thread(target=self._work, name="time-lapse", daemon=True)
        self._thread.start()

    def hear(self, heard: PrintReport) -> None:
        """Look whether a layer or vessel has ended, or the print; never waits."""
        if not heard.journal.started:
            return
        frames = frames_folder(heard.folder, heard.journal.started)
        if heard.progress is not None:
            mark = mark_of(heard.progress)
            if self._marks.setdefault(frames, mark) != mark:
                self._marks[frames] = mark
                self._keep(frames)
        if heard.status.ended and frames not in self._ended:
            self._ended.add(frames)
            self._keep(frames)
            self._make(frames)

    def told(self, heard: PrintReport) -> TimeLapseState:
        """The time-lapse of a print; makes its film where a server before couldn't."""
        frames = frames_folder(heard.folder, heard.journal.started)
        kept = sorted(frames.glob("*.jpg"))
        film = film_file(heard.folder, heard.journal.started).is_file()
        over = heard.status.ended and len(kept) > 1
        if over and not film and frames not in self._said:
            self._make(frames)
        size = sum(path.stat().st_size for path in kept)
        message = "" if film else self._said.get(frames, "")
        return TimeLapseState(len(kept), size, film, frames in self._making, message)

    def close(self) -> None:
        """Keep no more."""
        self._closed = True
        film = self._film
        if film is not None:
            film.kill()
        try:
            self._waiting.put_nowait(None)
        except queue.Full:
            return
        self._thread.join(5.0)

    def _keep(self, frames: Path) -> None:
        if self._camera is not None:
            self._ask("keep", frames)

    def _make(self, frames: Path) -> None:
        if frames not in self._making:
            self._making.add(frames)
            if not self._ask("make", frames):
                self._making.discard(frames)

    def _ask(self, what: str, frames: Path) -> bool:
        try:
            self._waiting.put_nowait((what, frames))
        except queue.Full:  # a slow disk: a picture less, and the print isn't held up
            return False
        return True

    def _work(self) -> None:
        while (asked := self._waiting.get()) is not None and not self._closed:
            what, frames = asked
            try:
                if what == "keep":
                    self._take(frames)
                else:
                    self._make_now(frames)
            except OSError as exc:
                self._said[frames] = f"the time-lapse can't be kept: {exc.strerror or exc}"
                log.warning("%s", self._said[frames])
            finally:
                if what == "make":
                    self._making.discard(frames)

    def _take(self, frames: Path) -> None:
        seen = self._camera.seen if self._camera is not None else None
        if seen is None or seen.state != "there":
            return
        frames.mkdir(parents=True, exist_ok=True)
        kept = sorted(frames.glob("*.jpg"))
        full = limit_reached(kept, len(seen.jpeg), shutil.disk_usage(frames).free)
        self._said[frames] = full
        if not full:
            number = int(kept[-1].stem) + 1 if kept else 1
            write_bytes(frames / f"{number:06d}.jpg", seen.jpeg)

    def _make_now(self, frames: Path) -> None:
        film = frames.with_name(frames.name + ".webp")
        if len(list(frames.glob("*.jpg"))) < 2 or film.is_file():
            return
        command = [*python_command("printctl.web.job.camera.film"), str(frames), str(film)]
        self._film = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        _, output = self._film.communicate()
        if not film.is_file() and not self._closed:
            self._said[frames] = "no film could be made of the pictures, which are kept"
            log.warning("%s: %s", self._said[frames], output.decode(errors="replace")[-2000:])


def mark_of(progress: Progress) -> int:
    """What a picture is kept of: layers done, or vessels where there is but one layer."""
    return progress.layers_done if progress.layers > 1 else progress.vessels_done


def limit_reached(kept: list[Path], more: int, free: int) -> str:
    """Why no picture of ``more`` bytes is kept with so many free on the disk; empty if one is."""
    if len(kept) >= MOST_FRAMES:
        return f"no more pictures are kept: {MOST_FRAMES} are there, the most"
    if sum(path.stat().st_size for path in kept) + more > MOST_BYTES:
        return f"no more pictures are kept: they have {MOST_BYTES / 1e6:g} MB, the most"
    if free - more < LEAVE_FREE_BYTES:
        return (
            f"no more pictures are kept: {free / 1e6:.0f} MB are free on the disk, and "
            f"{LEAVE_FREE_BYTES / 1e6:g} MB stay free for the print's journal"
        )
    return ""
