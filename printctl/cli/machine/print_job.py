"""`printctl print`: check a G-code file, print it, follow the print to its end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from firmware_profiles import Printer, load
from gcode.dry_run.run import dry_run
from printctl.checks.made_for import is_recorded, read_made_for, record_of
from printctl.checks.preflight import file_checks, refuse_failed, warnings
from printctl.checks.preflight.shaft import file_shaft
from printctl.checks.set_up import ProfileNames, loads_of, of_each, set_up
from printctl.cli import options as cli
from printctl.cli.confirmation import ForMountedFlag, confirm_set_up
from printctl.cli.declare import json_command
from printctl.cli.machine.simulate import read_start_position
from printctl.machine.families import refuse_unsent
from printctl.machine.job.care import Care
from printctl.machine.job.job import load_job
from printctl.machine.job.syringes import usable_mm
from printctl.machine.ports.detection import SIMULATED, named_port, read_baud
from printctl.machine.prints.follow import confirm, follow, interrupted, retreat_for
from printctl.machine.prints.mounted import (
    ASSUMED,
    left_check,
    or_assumed,
    refuse_unknown,
    with_mounted,
)
from printctl.machine.process.clients.starting import find_or_start, running
from printctl.machine.process.orders import Order
from printctl.machine.process.simulated import simulated_printer
from printctl.machine.records.mounting import Mounting, load_mounting
from printctl.machine.records.states import Status, state_words
from printctl.observe.observer_launch import end_idle_observer, ensure_observer
from printctl.observe.records import ORDER_FILE
from printctl.pipeline.syringe_plan import plan_syringes
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

    def care(self, syringes: Sequence[str], capacity_mm: Sequence[float]) -> Care:
        """As the link takes it; of several heads, what is in each."""
        several = len(syringes) > 1
        return Care(
            checkpoint_s=None if math.isinf(self.checkpoint_every) else self.checkpoint_every,
            deadman_s=60.0 * self.deadman,
            deadman_stops=self.deadman_stops,
            syringe=syringes[0],
            capacity_mm=capacity_mm[0],
            head_syringes=tuple(syringes) if several else (),
            head_capacity_mm=tuple(capacity_mm) if several else (),
            silent_limit_s=self.silent_limit,
            noise_limit=self.noise_limit,
            wire_log=str(Path(self.wire_log).absolute()) if self.wire_log else "",
        )


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
    reload: bool = of(CarePart, "reload"),
    reload_min: float | None = of(CarePart, "reload_min", "--reload-min", metavar="MINUTES"),
    accept_crossings: bool = opt(
        "Print although the needle shaft crosses printed vessels; recorded in the journal.",
        False,
    ),
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
    kept, real = load_mounting(printer), port != SIMULATED
    syringe, ink, mounted = _parts(printer, kept, real, syringe, ink, mounted)
    loads = loads_of(profile, syringe, ink, mounted.needle)
    usable = [usable_mm(one.syringe, profile.of_head(k)) for k, one in enumerate(loads)]
    care = how.care(of_each(profile, syringe, "--syringe"), usable)
    retreat, *others = (retreat_for(one.syringe, one.ink, 20.0, prime_ul) for one in loads)
    retreat = replace(retreat, others=tuple(others))
    order = Order(file, printer, port, place, retreat, resume, care=care, baud=read_baud(baud))
    if running(order) is None:  # Check the file before the first byte.
        set_for = set_up(profile, syringe, ink, tip, mounted)
        run, job = dry_run(cli.read_gcode_file(file), profile, tip), load_job(file, profile)
        shaft = file_shaft(file, run, set_for, accepted=accept_crossings)
        line_map = file.with_suffix(".map.npz")
        checks = [*file_checks(run, set_for, line_map, real=real), *shaft.checks]
        changes = CarePart(reload=reload, reload_min=reload_min)
        plan = plan_syringes(checks, job, usable, set_for.inks, run.duration_s, changes)
        checks = plan.checks
        if real and (left_ul := kept.left_ul(profile)) is not None:
            checks.append(left_check(job, plan.reload_at, left_ul, set_for.syringe.area_mm2))
        refuse_failed(checks)
        if real and not is_recorded(read_made_for(run.opening), profile):
            confirm_set_up(file, record_of(set_for), for_mounted)
        cli.print_notes(warnings(checks))
        care = replace(
            care,
            reload_at=plan.reload_at,
            reload_heads=plan.reload_heads,
            accepted=shaft.accepted,
            start_mm=tip,
            set_up=("--syringe", syringe, "--ink", ink, *mounted.words()),
        )
        order = replace(order, care=care)
        if (file.parent / ORDER_FILE).is_file() and not resume:
            cli.print_note(
                f"note: nobody looks at this print, although {file.parent / ORDER_FILE} says how "
                "it is observed: `printctl print` starts no observer; `printctl run RECIPE` and "
                "the page (`printctl serve`) do for the run's whole part, not for the rest of one"
            )
    done = _print(order, profile, tip, yes)
    facts = {"state": done.state.value, "proved": done.proved, "lines": done.lines_done}
    facts |= {"message": done.message, "folder": str(place)}
    cli.print_result(facts, [f"{state_words(done.state)}: {done.message}", str(place)], done.proved)


def _parts(
    printer: str,
    kept: Mounting,
    real: bool,
    syringe: str | None,
    ink: str | None,
    mounted: ProfileNames,
) -> tuple[str, str, ProfileNames]:
    """Return syringe, ink and the other parts: named, mounted, or on a simulated port assumed."""
    named = {
        **{"syringe": syringe, "ink": ink, "needle": mounted.needle},
        **{"bath": mounted.bath, "dish": mounted.dish},
    }
    known = with_mounted(printer, named, refuse=real)
    if real:
        refuse_unknown(printer, known, ASSUMED)
    parts, notes = or_assumed(known)
    cli.print_notes(notes)
    depth, centre = mounted.bath_depth, mounted.dish_centre
    if parts["dish"] and parts["dish"] == kept.parts.dish:
        depth = depth or kept.parts.depth_mm
        if centre is None and kept.parts.dish_centre_mm is not None:
            centre = "{!r},{!r}".format(*kept.parts.dish_centre_mm)
    names = replace(
        mounted,
        needle=parts["needle"] or None,
        bath=parts["bath"] or None,
        dish=parts["dish"] or None,
        bath_depth=depth,
        dish_centre=centre,
    )
    return parts["syringe"], parts["ink"], names


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
