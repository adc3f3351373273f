"""Stage 7: print the job through a separate link process, and follow it to its end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from firmware_profiles import Printer, load
from gcode.motion.executed import ExecutedMotion
from printctl.checks.set_up import refuse_failed
from printctl.errors import PrinterFailedError
from printctl.machine.families import refuse_unsent
from printctl.machine.job.job import GrownText, grown_text, parse_job
from printctl.machine.ports.detection import SIMULATED, named_port
from printctl.machine.prints.follow import confirm, follow, interrupted
from printctl.machine.prints.mounted import There
from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.clients.starting import find_or_start, finished, stop_and_leave
from printctl.machine.process.orders import Order
from printctl.machine.process.simulated import is_complete_record, simulated_printer
from printctl.machine.records.printed_job import grown_in
from printctl.observe.observer_launch import (
    ObserverError,
    end_idle_observer,
    ensure_observer,
    start_observer,
)
from printctl.observe.order import ObserverOrder
from printctl.pipeline.checked_order import Plan, completed, machine_checks
from printctl.pipeline.context import RunContext
from printctl.pipeline.observing import (
    look_care,
    observed_otherwise,
    order_observer,
    unlooked_words,
)
from printctl.pipeline.stage import Stage
from printctl.pipeline.stages.paths.dry_run import set_up_of
from printctl.progress import Report
from printctl.recipe.sections.measuring import SimulatedScan
from printctl.recipe.sections.toolpath import Embedded
from printctl.run_folder.artefacts import GCODE, JOURNAL_FOLDER
from printctl.run_folder.manifest import digest_file

EXECUTED = "executed.npz"


def depends(context: RunContext) -> Any:
    """The machine, the port, where the tip stands, and how the print is watched over."""
    return [
        context.printer.model_dump(mode="json"),
        context.recipe.printer.port,
        context.start_mm.tolist(),
        context.recipe.printer.care.model_dump(mode="json"),
        plan_of(context).to_dict(),
        None if context.recipe.observe is None else context.recipe.observe.model_dump(mode="json"),
        *context.digests(context.recipe.printer.files()).values(),
    ]


def plan_of(context: RunContext) -> Plan:
    """What the dry run has found for the order."""
    return Plan.from_dict(context.manifest.stages["dry run"].summary)


def order_of(context: RunContext) -> Order:
    """The order of a run's print, with the looks of its observer."""
    recipe, folder = context.recipe, context.folder
    part = recipe.printer
    order = Order(folder / GCODE, part.profile, part.port, folder / JOURNAL_FOLDER, once=True)
    order = completed(order, set_up_of(context), part.care, plan_of(context))
    looks = look_care(recipe.observe, embedded=isinstance(recipe.toolpath, Embedded))
    return replace(order, care=replace(order.care, **looks))


def work(context: RunContext, report: Report) -> tuple[dict[str, Any], Sequence[str]]:
    """Start the print (or find the one that is going on here) and follow it to its end."""
    if context.printed:
        return load_finished_print(context)
    if not context.printer.streamed:
        return loaded_by_hand(context), []
    part = context.recipe.printer
    folder = context.folder / JOURNAL_FOLDER
    folder.mkdir(0o700, exist_ok=True)
    record = context.folder / EXECUTED
    goes_on = context.rehearsal_speed is None  # a rehearsal's print is of no use without its run
    x, y, z = context.start_mm.tolist()

    def port() -> str:
        if part.port != SIMULATED:
            refuse_other_mounted(context)
            name = named_port(part.port, load(Printer, part.profile))
            confirm(name, context.bars, context.assume_yes)
            observe_from_start(context, folder)
            return name
        observe_from_start(context, folder)
        record.unlink(missing_ok=True)
        faults = context.recipe_folder / part.faults if part.faults else None
        return simulated_printer(
            part.profile,
            (x, y, z),
            gcode,
            record,
            folder,
            speed=context.rehearsal_speed or 0.0,
            faults=faults,
            detached=goes_on,
        )

    order = order_of(context)
    gcode = order.job
    try:
        at_interrupt = interrupted(context.bars) if goes_on else stop_and_leave
        client = _begun(context, order, port, at_interrupt)
        outcome = follow(client, report, context.bars, goes_on)
    except KeyboardInterrupt as exc:
        if goes_on:
            words = (
                f"IT GOES ON by itself, if it has begun: look by `printctl status {folder}`, end "
                f"it by `printctl cancel {folder}`"
            )
            context.bars.remark("print", str(exc) or words)
        raise
    summary: dict[str, Any] = {
        "printer": context.printer.name,
        "port": part.port,
        "state": outcome.state.value,
        "proved": outcome.proved,
        "lines": outcome.lines_done,
    }
    if part.port != SIMULATED:
        return summary, []
    return {**summary, **executed_facts(context)}, [EXECUTED]


def refuse_other_mounted(context: RunContext) -> None:
    """Raise `SafetyError` where another part is mounted than the recipe names or assumes, or less.

    A part that the recipe assumes must be mounted, and the syringe must hold the ink.
    """
    recipe = context.recipe
    there = There.kept(recipe.printer.profile)
    checks = machine_checks(set_up_of(context), there, plan_of(context), recipe.assumed_parts)
    refuse_failed(checks)


def observe_from_start(context: RunContext, folder: Path) -> None:
    """Start the observer of a print that is about to begin, where the recipe asks for one.

    Raises
    ------
    ObserverError
    """
    if context.recipe.observe is not None:
        if words := unlooked_words(context):
            context.bars.remark("print", words)
        order_observer(context)
        ObserverOrder.load(context.folder).save(folder)
        start_observer(folder)


def _begun(
    context: RunContext,
    order: Order,
    port: Callable[[], str],
    at_interrupt: Callable[[PrintClient], None],
) -> PrintClient:
    """Find the print or start it; one that goes on without its observer gets another."""
    try:
        client = find_or_start(order, port, at_interrupt)
    except (Exception, KeyboardInterrupt):
        end_idle_observer(order.folder)
        raise
    if not client.status.ended:
        if observed_otherwise(context, order.folder):
            context.bars.remark(
                "print",
                "it goes on as it was begun; what was changed in the recipe's observe since counts "
                "from the next print on",
            )
        try:
            ensure_observer(order.folder)
        except ObserverError as exc:
            context.bars.remark("print", f"NOBODY LOOKS at it: {exc}")
    return client


def load_finished_print(context: RunContext) -> tuple[dict[str, Any], Sequence[str]]:
    """Take the print that is done in the run's folder, with the simulated printer's record.

    Raises
    ------
    PrinterFailedError
        When no print of this very G-code is done there, or its record is missing.
    """
    part, folder = context.recipe.printer, context.folder / JOURNAL_FOLDER
    gcode = context.folder / GCODE
    client = finished(Order(gcode, part.profile, part.port, folder))
    if client is None:
        raise PrinterFailedError(
            f"no finished print of {gcode.name} as it is now lies in {folder}; print it first, or "
            "leave --printed out"
        )
    summary: dict[str, Any] = {
        "printer": context.printer.name,
        "port": part.port,
        "state": client.status.state.value,
        "proved": client.status.proved,
        "lines": client.status.lines_done,
    }
    if not isinstance(context.scan_part, SimulatedScan):
        return summary, []
    job = digest_file(gcode)
    if not is_complete_record(context.folder / EXECUTED, job, context.printer):
        raise PrinterFailedError(
            f"what the motors did in that print isn't known ({EXECUTED} is missing, broken off, or "
            "of another version), so its scan can't be simulated; print it again on the simulated "
            "printer, or give the scan as a file (scan: {file: ...})"
        )
    return {**summary, **executed_facts(context)}, [EXECUTED]


def loaded_by_hand(context: RunContext) -> dict[str, Any]:
    """Leave out the print on a controller that runs the file by itself, with a word.

    Raises
    ------
    Refused
        When the recipe's scan is to be simulated from a print that nobody follows here.
    """
    file = context.folder / GCODE
    if isinstance(context.scan_part, SimulatedScan):
        then = "Then give the scan of the part as a file (scan: {file: ...}) and run again"
        refuse_unsent(context.printer, str(file), then)
    context.bars.remark(
        "print",
        f"left out: {context.printer.name} runs its program by itself; load {file} in the "
        "controller's own software and print it there, before the scan",
    )
    return {
        "printer": context.printer.name,
        "port": context.recipe.printer.port,
        "state": "by hand",
        "lines": 0,
    }


def printed_text(context: RunContext) -> GrownText:
    """Put what was inserted in the print of a run's folder into its G-code."""
    data = (context.folder / GCODE).read_bytes()
    job = parse_job(data, GCODE, context.printer)
    return grown_text(grown_in(context.folder / JOURNAL_FOLDER, job), data)


def executed_facts(context: RunContext) -> dict[str, Any]:
    """What the simulated printer's own record says."""
    record = context.folder / EXECUTED
    if not record.exists():
        raise PrinterFailedError(
            f"the simulated printer left no record of its motion ({record}); see print/sim.log"
        )
    motion = ExecutedMotion.load(record)
    return {
        "blocks": len(motion),
        "duration_s": float(motion.time_end[-1] - motion.time_start[0]),
    }


STAGE = Stage(
    "print", depends, (GCODE,), ("gcode", "sim", "printctl/machine", "firmware_profiles"), work
)
