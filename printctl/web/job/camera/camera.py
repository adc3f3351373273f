"""Run a camera in a separate process; keep its latest picture or error."""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import IO, Annotated, Final, Literal

from pydantic import Field

from printctl.sources import python_command

APART_S: Final = 1.0
_TOO_OLD_S: Final = 5.0
_HANGS_S: Final = 30.0
_LOOK_AGAIN_S: Final = 0.5

State = Literal["none", "starting", "there", "lost"]


@dataclass(frozen=True)
class CameraState:
    """A camera as it stands."""

    state: State
    message: Annotated[str, Field(description="Why there is no picture; else empty.")] = ""
    number: Annotated[int, Field(description="Pictures so far.")] = 0
    at: Annotated[float | None, Field(description="Of the last picture, s since 1970.")] = None
    jpeg: Annotated[bytes, Field(exclude=True)] = field(default=b"", repr=False)
    """The last picture, however old."""


_LONGEST_LINE: Final = 2000
_MOST_BYTES: Final = 20_000_000


def write_message(out: IO[bytes], problem: str, jpeg: bytes = b"") -> None:
    """Write a picture, or why there is none."""
    head = {"problem": problem, "size": len(jpeg)}
    out.write(json.dumps(head).encode() + b"\n" + jpeg)
    out.flush()


def read_message(source: IO[bytes]) -> tuple[str, bytes] | None:
    """Read what was written; None at the end, or where what comes is no message."""
    try:
        head = json.loads(source.readline(_LONGEST_LINE))
        size = int(head["size"])
        if not 0 <= size <= _MOST_BYTES:
            return None
        jpeg = source.read(size)
        return (str(head["problem"]), jpeg) if len(jpeg) == size else None
    except (ValueError, KeyError, TypeError, OSError):
        return None


class CameraProcess:
    """A camera at which a process of its own looks, so that no driver holds up server or print.

    A process that dies or hangs is replaced. ``source`` is what `cv2.VideoCapture` reads, every
    ``apart_s`` seconds; ``tell`` is called whenever the camera is lost or comes back.
    """

    def __init__(
        self, source: str, tell: Callable[[CameraState], None], apart_s: float = APART_S
    ) -> None:
        self._source, self._tell, self._apart_s = source, tell, apart_s
        self._last = CameraState("starting")
        self._problem, self._heard = "", time.monotonic()
        self._told: State = "starting"
        self._process: subprocess.Popen[bytes] | None = None
        self._lock, self._saying = threading.Lock(), threading.Lock()
        self._ended = threading.Event()
        self._threads = [
            threading.Thread(target=work, name=f"camera {name}", daemon=True)
            for name, work in (("pictures", self._listen), ("watch", self._watch))
        ]
        for thread in self._threads:
            thread.start()

    @property
    def seen(self) -> CameraState:
        """What is known of it now."""
        last, problem = self._last, self._problem
        if last.at is None and not problem:
            return replace(last, message=f"{self.name} is being opened")
        old = last.at is not None and time.time() - last.at > _TOO_OLD_S + self._apart_s
        if not problem and not old:
            return last
        since = f" since {time.strftime('%H:%M:%S', time.localtime(last.at))}" if last.at else ""
        why = problem or "it doesn't answer"
        message = f"no picture from {self.name}{since}: {why}; tried again"
        return replace(last, state="lost", message=message)

    @property
    def name(self) -> str:
        """The camera, without the password that its address may hold."""
        if self._source.isdecimal():
            return f"camera {self._source}"
        return re.sub(r"//[^/@]*@", "//", self._source).partition("?")[0]

    def close(self) -> None:
        """Let go of it."""
        self._ended.set()
        self._kill()
        for thread in self._threads:
            thread.join(5.0)

    def _listen(self) -> None:
        while not self._ended.is_set():
            with self._lock:
                if self._ended.is_set():
                    return
                self._heard = time.monotonic()
                process = self._process = self._begun()
            if process.stdout is not None:
                while (message := read_message(process.stdout)) is not None:
                    self._hear(*message)
                process.stdout.close()
            process.kill()
            process.wait()
            if process.stdin is not None:
                process.stdin.close()
            if not self._ended.is_set():
                self._hear("the process at the camera ended")
            self._ended.wait(self._apart_s)

    def _begun(self) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            python_command("printctl.web.job.camera"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "OPENCV_LOG_LEVEL": "SILENT"},
        )
        settings = {"source": self._source, "apart_s": self._apart_s}
        if process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(json.dumps(settings).encode() + b"\n")
                process.stdin.flush()
        return process

    def _hear(self, problem: str, jpeg: bytes = b"") -> None:
        self._heard, self._problem = time.monotonic(), problem
        if jpeg:
            self._last = CameraState("there", "", self._last.number + 1, time.time(), jpeg)
        self._say()

    def _say(self) -> None:
        with self._saying:
            seen = self.seen
            if seen.state != self._told:
                self._told = seen.state
                self._tell(seen)

    def _watch(self) -> None:
        while not self._ended.wait(_LOOK_AGAIN_S):
            self._say()
            if time.monotonic() - self._heard > _HANGS_S:
                self._kill()

    def _kill(self) -> None:
        with self._lock:
            if self._process is not None:
                self._process.kill()
