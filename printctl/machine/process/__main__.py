"""Entry point of the process that prints one job (``python -m printctl.machine.process``)."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from pathlib import Path

from printctl.machine.errors import LinkError
from printctl.machine.job.care import Care
from printctl.machine.job.retreat import Retreat
from printctl.machine.process.detached_process import detach
from printctl.machine.process.process import Order, serve
from printctl.machine.records.record import LOG


def main() -> int:
    """Read the order from the arguments and carry it out; 0 when the print is done."""
    parser = argparse.ArgumentParser(prog="python -m printctl.machine.process", description=__doc__)
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
        detach(args.folder / LOG, "printctl.machine.process")
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


if __name__ == "__main__":
    sys.exit(main())
