"""Entry point of the camera process: camera name on standard input, JPEG pictures on output."""

from __future__ import annotations

import json
import os
import sys
import threading

from printctl.web.job.camera.capture import Capture
from printctl.web.job.camera.pipe import write_message
from printctl.web.low_priority import lower_priority


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
            write_message(out, camera.look(settings["apart_s"]))
    except BrokenPipeError:
        os._exit(0)


def _end_with_the_server() -> None:
    while os.read(0, 4096):
        pass
    os._exit(0)


if __name__ == "__main__":
    main()
