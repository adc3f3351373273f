"""``python -m printctl.link``: the link process, as `printctl.link.client` starts it."""

from __future__ import annotations

import argparse
import json
import logging
import os
import subprocess
import sys
from pathlib import Path

from printctl.link.care import Care
from printctl.link.errors import LinkError
from printctl.link.process import Order, serve
from printctl.link.record import LOG
from printctl.link.retreat import Retreat


def main() -> int:
    """Read the order from the arguments and carry it out; 0 when the print is done."""
    parser = argparse.ArgumentParser(prog="python -m printctl.link", description=__doc__)
    parser.add_argument("job", type=Path, help="G-code file")
    parser.add_argument("--printer", required=True, help="profile, by name or path")
    parser.add_argument("--port", required=True)
    parser.add_argument("--folder", required=True, type=Path)
    parser.add_argument("--baud", type=int)
    parser.add_argument("--retreat", type=json.loads, default={}, help="JSON of Retreat's fields")
    parser.add_argument("--care", type=json.loads, default={}, help="JSON of Care's fields")
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--detach", action="store_true", help="go on in the background")
    args = parser.parse_args()
    if args.detach:
        detach(args.folder / LOG)
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s"
    )
    order = Order(
        job=args.job,
        profile=args.printer,
        port=args.port,
        folder=args.folder,
        baud=args.baud,
        retreat=Retreat(**args.retreat),
        care=Care.from_dict(args.care),
        resume=args.resume,
    )
    try:
        return 0 if serve(order).state == "done" else 4
    except LinkError as exc:
        logging.error("%s", exc)
        return 4


def detach(log: Path) -> None:
    """Go on as a process of its own session, which nobody waits for; print its number.

    On Windows there is no fork; a copy of this command is started instead.
    """
    if not hasattr(os, "fork"):
        command = [sys.executable, "-m", "printctl.link", *sys.argv[1:]]
        command.remove("--detach")
        with log.open("ab") as handle:
            flags = 0x00000008 | 0x00000200  # DETACHED_PROCESS, CREATE_NEW_PROCESS_GROUP
            copy = subprocess.Popen(command, stdout=handle, stderr=handle, creationflags=flags)
        print(copy.pid, flush=True)
        os._exit(0)
    pid = os.fork()
    if pid:
        print(pid, flush=True)
        os._exit(0)
    os.setsid()
    null, out = os.open(os.devnull, os.O_RDWR), os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for source, target in ((null, 0), (out, 1), (out, 2)):
        os.dup2(source, target)


if __name__ == "__main__":
    sys.exit(main())
