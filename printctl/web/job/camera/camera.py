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
from dataclasses import dataclass
from typing import Final, Literal, Protocol

from printctl.sources import python_command
from printctl.web.job.camera.pipe import Message, read_message

APART_S: Final = 1.0
_TOO_OLD_S: Final = 5.0
_HANGS_S: Final = 30.0
_LOOK_AGAIN_S: Final = 0.5

State = Literal["none", "starting", "there", "lost"]


@dataclass(frozen=True)
class LatestPicture:
    """Latest picture of a camera.

    Attributes
    ----------
    number : int
        From 1, as they came.
    at : float
        Wall-clock time, s since 1970.
    jpeg : bytes
    """

    number: int
    at: float
    jpeg: bytes


@dataclass(frozen=True)
class CameraState:
    """What is known of a camera.

    Attributes
    ----------
    state : {"starting", "there", "lost"}
    message : str
    still : LatestPicture or None
        The last picture, however old.
    """

    state: State
    message: str
    still: LatestPicture | None = None


class Camera(Protocol):
    """A camera; any thread may ask, and nobody waits."""

    @property
    def seen(self) -> CameraState:
        """What is known of it now."""

    def close(self) -> None:
        """Let go of it."""


class CameraProcess:
    """A camera at which a process of its own looks, so that no driver holds up server or print.

    A process that dies or hangs is replaced.

    Parameters
    ----------
    source : str
        What `cv2.VideoCapture` reads.
    tell : function
        Given what is known whenever the camera is lost or comes back.
    apart_s : float, s
        Between two pictures.
    """

    def __init__(
        self, source: str, tell: Callable[[CameraState], None], apart_s: float = APART_S
    ) -> None:
        self._source, self._tell, self._apart_s = source, tell, apart_s
        self._still: LatestPicture | None = None
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
        still, problem = self._still, self._problem
        old = time.time() - still.at > _TOO_OLD_S + self._apart_s if still else False
        if still is None and not problem:
            return CameraState("starting", f"{self.name} is being opened")
        if not problem and not old:
            return CameraState("there", "", still)
        since = f" since {time.strftime('%H:%M:%S', time.localtime(still.at))}" if still else ""
        why = problem or "it doesn't answer"
        return CameraState("lost", f"no picture from {self.name}{since}: {why}; tried again", still)

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
                    self._hear(message)
                process.stdout.close()
            process.kill()
            process.wait()
            if process.stdin is not None:
                process.stdin.close()
            if not self._ended.is_set():
                self._hear(Message("the process at the camera ended"))
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

    def _hear(self, message: Message) -> None:
        self._heard = time.monotonic()
        self._problem = message.problem
        if message.jpeg:
            number = self._still.number + 1 if self._still else 1
            self._still = LatestPicture(number, time.time(), message.jpeg)
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
