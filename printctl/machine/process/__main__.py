"""Entry point of the machine process (``python -m printctl.machine.process``)."""

from __future__ import annotations

import argparse
import json
import logging
import sys
from pathlib import Path
from typing import Any

from printctl.machine.control.idle.station_status import StationState
from printctl.machine.errors import LinkError
from printctl.machine.process.clients.launch import detach
from printctl.machine.process.contact import STATION_LOG
from printctl.machine.process.one_print import serve_print
from printctl.machine.process.orders import Order
from printctl.machine.process.plug import Plug
from printctl.machine.process.station import serve_station
from printctl.machine.records.record import LOG
from printctl.machine.records.states import LinkState


def main() -> int:
    """Do what is ordered; 0 when the print is done, or the station was closed by a client."""
    parser = argparse.ArgumentParser(prog="python -m printctl.machine.process", description=__doc__)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--print", type=json.loads, help="JSON of an Order: one print, then part")
    what.add_argument("--station", type=json.loads, help="JSON of a Plug: stay connected")
    parser.add_argument("--detach", action="store_true", help="go on in the background")
    args = parser.parse_args()
    given: dict[str, Any] = args.print or args.station
    if args.detach:
        log = LOG if args.print else STATION_LOG
        detach(Path(given["folder"]) / log, "printctl.machine.process")
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s"
    )
    try:
        if args.print:
            right = serve_print(Order.from_json(given)).state is LinkState.DONE
        else:
            plug = Plug.from_json(given)
            right = serve_station(plug).state is StationState.CLOSED
    except LinkError as exc:
        logging.error("%s", exc)
        return 4
    return 0 if right else 4


if __name__ == "__main__":
    sys.exit(main())
