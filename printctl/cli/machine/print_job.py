"""`printctl print`: check a G-code file, print it, follow the print to its end."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

from firmware_profiles import Printer, load
from printctl.checks.made_for import is_recorded, read_made_for, record_of
from printctl.checks.set_up import ASSUMED, ProfileNames, or_assumed, set_up, warnings
from printctl.cli import options as cli
from printctl.cli.confirmation import ForMountedFlag, confirm_set_up
from printctl.cli.declare import json_command
from printctl.cli.machine.simulate import CheckOptions, read_start_position
from printctl.machine.families import refuse_unsent
from printctl.machine.ports.detection import SIMULATED, named_port, read_baud
from printctl.machine.prints.follow import confirm, follow, interrupted
from printctl.machine.prints.mounted import There, with_mounted
from printctl.machine.process.clients.starting import find_or_start, running
from printctl.machine.process.orders import Order
from printctl.machine.process.simulated import simulated_printer
from printctl.machine.records.mounting import load_mounting
from printctl.machine.records.states import Status, state_words
from printctl.observe.observer_launch import end_idle_observer, ensure_observer
from printctl.observe.records import ORDER_FILE
from printctl.pipeline.checked_order import OrderCare, care_part, checked_order
from printctl.progress import StageBars
from printctl.recipe.sections.making import CarePart
from printctl.settings import of, opt, settings


@settings
class CareOptions:
    """How a print is supervised, as the command line says it."""

    checkpoint_every: float = opt(
        "Minimum time between position checks at ends of layers or passes, s; 0: every end, inf: "
        "none.",
        30.0,
        metavar="SECONDS",
        min=0.0,
    )
    silent_limit: float | None = of(CarePart, "silent_limit_s", "--silent-limit", metavar="SECONDS")
    noise_limit: int = of(CarePart, "noise_limit", metavar="LINES")
    wire_log: str = opt(
        "Write all traffic to this file or folder; otherwise only the latest part is saved on an "
        "alarm.",
        "",
        metavar="PATH",
    )
    deadman: float = of(CarePart, "deadman_min", "--deadman", metavar="MINUTES")
    deadman_stops: bool = of(CarePart, "deadman_stops")

    def values(self) -> dict[str, Any]:
        """As `CarePart` takes them."""
        every = None if math.isinf(self.checkpoint_every) else self.checkpoint_every
        return {
            "checkpoint_every_s": every,
            "deadman_min": self.deadman,
            "deadman_stops": self.deadman_stops,
            "silent_limit_s": self.silent_limit,
            "noise_limit": self.noise_limit,
        }


@json_command
def print_job(
    *,
    file: cli.GcodeArg,
    printer: cli.PrinterOption,
    port: str = opt(
        "Serial port, tcp:HOST:PORT, simulated, auto (the one with the profile's USB id), or a "
        "network host: moonraker://HOST:PORT, octoprint://HOST:PORT, duet://HOST.",
        ...,
    ),
    syringe: cli.SyringeOption = None,
    ink: cli.InkOption = None,
    mounted: ProfileNames,
    start: cli.StartOption = None,
    folder: Path | None = opt("Folder for the journal; default: FILE.print."),
    baud: str | None = opt("Baud rate; default: the profile's; auto tries the profile's list."),
    resume: bool = opt("Continue an interrupted print of this file.", False),
    how: CareOptions,
    prime_ul: float = of(CarePart, "prime_ul"),
    checks: CheckOptions,
    for_mounted: ForMountedFlag = False,
    host_key: cli.HostKeyOption = None,
    yes: cli.YesFlag = False,
) -> None:
    """Check a G-code file and print it; attach when its print is already going on.

    The print runs in a process of its own and goes on when this command ends. Ctrl-C asks: detach,
    cancel or emergency stop.

    Parts that aren't named are those entered with `printctl mount`; on a simulated port the usual
    ones are assumed where none are mounted.

    Exit code 1 when all lines were taken but it isn't proved that all was made: another program
    wrote to the printer, or flow or speed was changed at its panel.
    """
    cli.use_host_key(host_key)
    profile = load(Printer, printer)
    refuse_unsent(profile, str(file))
    tip = read_start_position(file, profile, start)
    place = folder if folder is not None else file.with_name(file.name + ".print")
    real = port != SIMULATED
    order = Order(file, printer, port, place, resume=resume, baud=read_baud(baud))
    part = care_part(prime_ul=prime_ul, **how.values(), **checks.values())
    if running(order) is None:  # Check the file before the first byte.
        syringe, ink, names, assumed = _parts(printer, real, syringe, ink, mounted)
        set_for = set_up(profile, syringe, ink, tip, names)
        there = There.kept(printer) if real else None
        accepts = checks.accept_crossings
        care = OrderCare(part, real, accept_crossings=accepts, there=there, assumed=assumed)
        checked = checked_order(file, set_for, care)
        order = checked.complete(order)
        if real and not is_recorded(read_made_for(checked.run.opening), profile):
            confirm_set_up(file, record_of(set_for), for_mounted)
        cli.print_notes(warnings(checked.checks))
        wire_log = str(Path(how.wire_log).absolute()) if how.wire_log else ""
        order = replace(order, care=replace(order.care, wire_log=wire_log))
        if (file.parent / ORDER_FILE).is_file() and not resume:
            cli.print_note(
                f"note: nobody looks at this print, although {file.parent / ORDER_FILE} says how "
                "it is observed: `printctl print` starts no observer; `printctl run RECIPE` and "
                "the page (`printctl serve`) do for the run's whole part, not for the rest of one"
            )
    done = _print(order, profile, tip or (0.0, 0.0, 0.0), yes)
    facts = {"state": done.state.value, "proved": done.proved, "lines": done.lines_done}
    facts |= {"message": done.message, "folder": str(place)}
    cli.print_result(facts, [f"{state_words(done.state)}: {done.message}", str(place)], done.proved)


def _parts(
    printer: str, real: bool, syringe: str | None, ink: str | None, mounted: ProfileNames
) -> tuple[str, str, ProfileNames, Collection[str]]:
    """Return syringe, ink and the others, named or mounted; and which of them are assumed.

    What is assumed refuses a real print, and is told before a simulated one.
    """
    named = {
        **{"syringe": syringe, "ink": ink, "needle": mounted.needle},
        **{"bath": mounted.bath, "dish": mounted.dish},
    }
    known = with_mounted(printer, named, refuse=False)
    parts, notes = or_assumed(known)
    if not real:
        cli.print_notes(notes)
    kept = load_mounting(printer).parts
    depth, centre = mounted.bath_depth, mounted.dish_centre
    if parts["dish"] and parts["dish"] == kept.dish:
        depth = depth or kept.depth_mm
        if centre is None and kept.dish_centre_mm is not None:
            centre = "{!r},{!r}".format(*kept.dish_centre_mm)
    others = replace(
        mounted,
        needle=parts["needle"] or None,
        bath=parts["bath"] or None,
        dish=parts["dish"] or None,
        bath_depth=depth,
        dish_centre=centre,
    )
    assumed = [part for part in ASSUMED if real and not known[part]]
    return parts["syringe"], parts["ink"], others, assumed


def _print(order: Order, printer: Printer, tip: tuple[float, float, float], yes: bool) -> Status:
    """Start the print, or find it again, and follow it to its end."""
    order.folder.mkdir(0o700, parents=True, exist_ok=True)
    bars = StageBars(cli.messages())

    def open_port() -> str:
        if order.port == SIMULATED:
            return simulated_printer(
                order.printer, tip, order.job, order.folder / "executed.npz", order.folder
            )
        name = named_port(order.port, printer)
        confirm(name, bars, yes)
        if order.resume:  # a print with looks
            ensure_observer(order.folder)
        return name

    with bars.all(), bars.stage("print") as report:
        try:
            client = find_or_start(order, open_port, interrupted(bars))
        except (Exception, KeyboardInterrupt):
            end_idle_observer(order.folder)
            raise
        return follow(client, report, bars)
