"""Entry point of the station process (``python -m printctl.machine.process.station_main``)."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from printctl.machine.control.station_status import Place, StationState
from printctl.machine.errors import LinkError
from printctl.machine.ports.detection import read_baud
from printctl.machine.process.detached_process import detach
from printctl.machine.process.station_process import Opening, serve_station
from printctl.machine.process.station_record import LOG


def main() -> int:
    """Read the arguments and serve until closed; 0 when it was closed by a client."""
    parser = argparse.ArgumentParser(
        prog="python -m printctl.machine.process.station_main", description=__doc__
    )
    parser.add_argument("--printer", required=True, help="profile, by name or path")
    parser.add_argument("--port", required=True, help="device, address, auto or simulated")
    parser.add_argument("--folder", required=True, type=Path)
    parser.add_argument("--baud")
    parser.add_argument("--sim-speed", type=float, default=1.0)
    parser.add_argument("--start", type=_place, default=(0.0, 0.0, 0.0))
    parser.add_argument("--detach", action="store_true", help="go on in the background")
    args = parser.parse_args()
    if args.detach:
        detach(args.folder / LOG, "printctl.machine.process.station_main")
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s"
    )
    try:
        baud = read_baud(args.baud)
        opening = Opening(args.printer, args.port, args.folder, baud, args.sim_speed, args.start)
        return 0 if serve_station(opening).state is StationState.CLOSED else 4
    except LinkError as exc:
        logging.error("%s", exc)
        return 4


def _place(text: str) -> Place:
    x, y, z = (float(part) for part in text.split(","))
    return x, y, z


if __name__ == "__main__":
    sys.exit(main())
