"""Entry point of the camera process: camera name on standard input, JPEG pictures on output."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from typing import Any, Final

from printctl.web.job.camera.camera import write_message
from printctl.web.worker import lower_priority

LONGEST_PX: Final = 1280
_QUALITY: Final = 85


class Capture:
    """A camera, a film, or a sequence of pictures: whatever `cv2.VideoCapture` reads.

    A film gives its next picture at each look and begins anew at its end; of a camera the pictures
    between two looks are let go, so that the newest is seen.
    """

    def __init__(self, cv2: Any, source: str) -> None:
        self._cv2, self._source = cv2, source
        self._opened: Any = None

    def look(self, apart_s: float) -> tuple[str, bytes]:
        """Return why nothing is seen, or else the picture after so many seconds."""
        until = time.monotonic() + apart_s
        if self._opened is None and not self._open():
            time.sleep(apart_s)
            return "it can't be opened", b""
        picture = self._newest(until)
        if picture is None:  # the film's end, or a camera that was unplugged
            self._close()
            picture = self._newest(until) if self._open() else None
        time.sleep(max(until - time.monotonic(), 0.0))
        if picture is None:
            self._close()
            return "it gives no pictures", b""
        return "", self._jpeg(picture)

    @property
    def live(self) -> bool:
        """Whether pictures come by themselves, wanted or not."""
        return self._source.isdecimal() or self._source.startswith("/dev/") or "://" in self._source

    def _open(self) -> bool:
        source = int(self._source) if self._source.isdecimal() else self._source
        opened = self._cv2.VideoCapture(source)
        if not opened.isOpened():
            opened.release()
            return False
        self._opened = opened
        return True

    def _close(self) -> None:
        if self._opened is not None:
            self._opened.release()
            self._opened = None

    def _newest(self, until: float) -> Any:
        while self._opened.grab():
            if not self.live or time.monotonic() >= until:
                got, picture = self._opened.retrieve()
                return picture if got else None
        return None

    def _jpeg(self, picture: Any) -> bytes:
        height, width = picture.shape[:2]
        shrink = LONGEST_PX / max(height, width)
        if shrink < 1:
            size = max(round(width * shrink), 1), max(round(height * shrink), 1)
            picture = self._cv2.resize(picture, size, interpolation=self._cv2.INTER_AREA)
        _, coded = self._cv2.imencode(".jpg", picture, [self._cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        return bytes(coded.tobytes())


def main() -> None:
    """Look until the server is gone."""
    settings = json.loads(sys.stdin.buffer.readline())
    threading.Thread(target=_end_with_the_server, daemon=True).start()
    lower_priority()
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what drivers print must not come between the pictures
    import cv2  # what it prints while it is loaded must not come between them either

    cv2.setNumThreads(1)
    camera = Capture(cv2, settings["source"])
    try:
        while True:
            write_message(out, *camera.look(settings["apart_s"]))
    except BrokenPipeError:
        os._exit(0)


def _end_with_the_server() -> None:
    while os.read(0, 4096):
        pass
    os._exit(0)


if __name__ == "__main__":
    main()
