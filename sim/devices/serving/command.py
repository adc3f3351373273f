"""Command line of the simulated printer (``python -m sim``)."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from firmware_profiles import Printer, ProfileError, load
from gcode.errors import SimError
from gcode.motion.state import Board
from gcode.program.gcode import checksum
from sim.devices.families.registry import simulated_printer
from sim.devices.faults import Fault, FaultFile, FaultyCable, Pace, parse_fault
from sim.devices.serving.job_lines import JobLines
from sim.devices.serving.port import open_port
from sim.devices.serving.serve import Server, Serving
from sim.errors import ServeError


def _start(text: str) -> tuple[float, float, float]:
    x, y, z = (float(part) for part in text.split(","))
    return x, y, z


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    options = argparse.ArgumentParser(
        prog="python -m sim",
        description="A simulated printer: Marlin, Duet or Klipper, by the profile. Its port's "
        "address is the first line it prints. `python -m sim camera` and `python -m sim oct` "
        "show what lies in its dish.",
    )
    options.add_argument("--printer", required=True, help="profile name, or path of a .yaml file")
    port = options.add_mutually_exclusive_group()
    port.add_argument("--link", type=Path, help="make this path a link to the pseudo-terminal")
    port.add_argument("--tcp", type=int, metavar="PORT", help="TCP port instead; 0 for any")
    options.add_argument(
        "--speed", type=float, default=0.0, help="times real time; 0 (default): as fast as it can"
    )
    options.add_argument("--record", type=Path, help="write the executed motion here (.npz)")
    options.add_argument(
        "--job",
        type=Path,
        metavar="FILE",
        help="the G-code that will be sent: the record then tells its commands from a host's own",
    )
    options.add_argument(
        "--journal",
        type=Path,
        metavar="FILE",
        help="with --job: the journal of the link that prints it, which tells what is inserted",
    )
    options.add_argument(
        "--start",
        type=_start,
        default=(0.0, 0.0, 0.0),
        metavar="X,Y,Z",
        help="where the tip stands at power-up, mm",
    )
    options.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND@LINE",
        help="unplug, reset, kill, drop_ok or runaway when the firmware takes line number LINE; "
        "repeatable",
    )
    options.add_argument(
        "--faults",
        type=Path,
        metavar="FILE",
        help="a fault file (YAML), see sim.devices.faults",
    )
    options.add_argument(
        "--no-thermistors", action="store_true", help="temperature inputs aren't wired"
    )
    options.add_argument(
        "--exit-on-hangup", action="store_true", help="end when the host closes the port"
    )
    options.add_argument(
        "--linger",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="with --exit-on-hangup: wait so long, once, for another host, unless the file that "
        "stdout goes to was deleted",
    )
    options.add_argument(
        "--parent-pid",
        type=int,
        help="process that starts this one: end when it does, until a host has come",
    )
    return options


def _faults(given: argparse.Namespace) -> tuple[FaultFile, tuple[Fault, ...]]:
    """The file, and its faults with those of the command line."""
    file = FaultFile.load(given.faults) if given.faults else FaultFile()
    faults = (*file.at, *(parse_fault(text) for text in given.fault))
    returns = any(fault.back_after_s is not None for fault in faults)
    if returns and given.link is None and given.tcp is None:
        raise ServeError(
            "a port that comes back needs a name of its own: give --link PATH or --tcp PORT"
        )
    return file, faults


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as exc:
        raise ServeError(f"job file {path} can't be read: {exc.strerror}; check the path") from exc


def serve_printer(words: list[str]) -> int:
    """Serve until stopped by a signal; 0 when that went well, 1 when not, 2 for a wrong use."""
    given = parser().parse_args(words)
    try:
        file, faults = _faults(given)
        profile = load(Printer, given.printer)
        printer = simulated_printer(profile)(
            profile,
            given.start,
            Board(thermistors=not given.no_thermistors),
            faults,
        )
        printer.pace = Pace(file.speed)
        printer.bad_line = FaultyCable(file, np.random.default_rng(file.seed))
        printer.gauges = {gauge.command: gauge for gauge in file.gauges}
        if given.job:
            machine = printer.machine.printer
            printer.job = JobLines(_read(given.job), machine, given.journal)
        port = open_port(given.link, given.tcp)
    except (SimError, ProfileError) as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    warm_printer()
    print(port.address, flush=True)
    serving = Serving(
        given.speed, given.record, given.exit_on_hangup, given.parent_pid, given.linger
    )
    try:
        Server(printer, port, serving).run()
    except SimError as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 1
    return 0


_FILE = b"M302 P1\nG92 X0 Y0 Z0 E0\nG1 X1 E1 F600\nG2 X2 I1\nG28 X\nM400\n"


def warm_printer() -> None:
    """Put each kernel that takes G-code through one call, on the short road and the general one."""
    profile = load(Printer, "marlin_avr")
    printer = simulated_printer(profile)(profile)
    printer.exchange(_FILE)
    body = b"N1 G1 X3 E2"
    printer.exchange(b"%s*%d\n" % (body, checksum(body)))
    printer.exchange(b"G4 S1\nM114\n")
    printer.kill("warm")
    printer.executed()
    heads = load(Printer, "two_syringe_marlin")
    simulated_printer(heads)(heads).exchange(b"T1 S1\nM400\n")
