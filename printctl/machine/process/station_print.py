"""A print on a station's open port: whether it may begin, and what the station learns from it."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from firmware_profiles import Printer, ProfileError, load
from gcode.motion.executed import ExecutedMotion
from printctl.machine.control.idle.station_status import Place, StationState
from printctl.machine.control.printing.streamer import Streamer
from printctl.machine.errors import BY_NAME, LinkError, Refused
from printctl.machine.job.job import Job, load_job
from printctl.machine.process.machine import Machine, Request
from printctl.machine.process.one_print import contact_of, run_print
from printctl.machine.process.orders import Order, check_homing, check_start, leaves_motors_on
from printctl.machine.process.plug import Plug
from printctl.machine.process.simulated import record_for, write_note
from printctl.machine.process.socket_server import refusal
from printctl.machine.records.mounting import after_print
from printctl.machine.records.printed_job import grown_in
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.states import LinkState, Status

_REPORT: Final = b"M155 S2"


@dataclass(frozen=True)
class _Print:
    """A print that goes on here: where the tip stood, and where the job declares it."""

    order: Order
    job: Job
    at: Place | None
    declared: Place | None
    record: Path


def print_here(machine: Machine, request: Request) -> Status:
    """Print what is asked for; the printer has to be connected or stood by again after it.

    LinkError when it may not begin; the station stands by as before.
    """
    known, plug, standby = machine.known, machine.plug, machine.standby
    order = _read_order(request, plug)
    order = replace(order, care=replace(order.care, used_mm=known.plunger_mm or 0.0))
    job = load_job(order.job, known.printer)
    at = standby.position if standby else None
    check_homing(job, known.mounted.needle)
    declared = check_start(job, at, known.trusted)
    here = _Print(order, job, at, declared, record_for(order.folder))
    values = {"job": str(order.job), "sha256": job.sha256}
    machine.write_down("asked", do="print", values=values, **order.by)
    reports = machine.reports

    def on_begin(streamer: Streamer) -> None:
        if reports:  # so that no line waits for an answer to M105
            streamer.command(_REPORT, lambda lines: None)
        machine.grant(request)

    machine.switching = True
    machine.enter(StationState.PRINTING, f"printing {job.name}", print_folder=str(order.folder))
    status, begun = Status(LinkState.FAILED), False
    try:
        with contact_of(order) as contact:
            if plug.simulated:
                place = declared or at or plug.start_mm
                plug.open_for(order.job, here.record, order.folder / JOURNAL, place)
            contact.status = run_print(machine, order, contact, on_begin)
        status, begun = contact.status, contact.begun
    except LinkError as exc:
        status = Status(LinkState.FAILED, message=str(exc), error=type(exc).__name__)
    finally:
        machine.end_print()
    if begun:
        _learn(machine, here, status)
    else:
        kind = BY_NAME.get(status.error, LinkError)
        machine.answer(request, refusal(kind(status.message)))
    if plug.simulated:
        plug.close()
        plug.start_mm = at or plug.start_mm
        if begun:
            _remember_executed(machine, here, status)
    return status


def _read_order(request: Request, plug: Plug) -> Order:
    """Return the order of a request; Refused for another printer than the connected one."""
    try:
        order = replace(Order.from_json(request.values["order"]), port=plug.port, resume=False)
    except (KeyError, TypeError, ValueError, AttributeError) as exc:
        raise Refused(
            f"the order to print can't be read ({exc}): client and station may be of different "
            "versions of printctl; close the station and connect with the client's"
        ) from exc
    try:
        asked = load(Printer, order.printer)
    except ProfileError as exc:
        raise Refused(str(exc)) from exc
    if asked != plug.printer:
        raise Refused(
            f"the job is for {asked.name} ({order.printer}), connected is "
            f"{plug.printer.name} ({plug.profile}); connect with the "
            "profile that the job was made for"
        )
    return order


def _learn(machine: Machine, here: _Print, status: Status) -> None:
    """Record what a print did to place, plunger, syringe and dish."""
    known, folder = machine.known, here.order.folder
    job, done = grown_in(folder, here.job), status.lines_done
    if here.declared is not None and done:  # else it told the firmware nothing
        known.count_anew(here.at or here.declared, here.declared, {"x", "y", "z"})
    if not status.position_known or not leaves_motors_on(job, done, known.printer):
        known.lose_position()
    known.take_over(after_print(known.mounting, known.printer, job, folder, status))


def _remember_executed(machine: Machine, here: _Print, status: Status) -> None:
    """Keep where a simulated tip stands now; and that the record is whole, where it is."""
    with contextlib.suppress(OSError, ValueError, KeyError, IndexError):
        motion = ExecutedMotion.load(here.record)
        x, y, z = motion.end[-1].tolist()
        machine.plug.start_mm = x, y, z
        if status.state is LinkState.DONE:
            write_note(here.record, here.job.sha256, machine.known.printer, len(motion))
