"""Say in what state an ended print leaves the printer: motors, needle, heaters.

Nothing is claimed that wasn't observed, or that doesn't follow from what was sent: a printer whose
connection was lost may have lost its power, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from firmware_profiles import Printer
from printctl.machine.control.board.halting import UNCONFIRMED
from printctl.machine.control.printing.context import Print
from printctl.machine.job.retreat import heaters_off
from printctl.machine.records.states import LinkState, PrintEnded

IN_PRINT = (
    "the needle wasn't lifted and may be in the print{}: before X or Y moves, lift it straight up, "
    "by hand with the printer's power off or with Z alone"
)
_HALTED_HEAT = "M112 switches the heaters off"
_HALTED_ITSELF_HEAT = "a halted firmware keeps its heaters off"
_ON_ITS_WAY = (
    LinkState.PAUSING,
    LinkState.RESUMING,
    LinkState.STOPPING,
)


@dataclass(frozen=True)
class Aftermath:
    """What a person must know of a printer after a print; each in words, empty for said before."""

    motors: str = ""
    needle: str = ""
    heaters: str = ""

    def __str__(self) -> str:
        parts = (self.motors, self.needle, self.heaters)
        return "".join(f"; {one}" for one in parts if one)


def aftermath_of(run: Print, ended: PrintEnded) -> Aftermath:
    """Return the state in which a print that was begun leaves its printer."""
    if ended.state is LinkState.DONE or not run.logbook.begun:
        return Aftermath()
    return Aftermath(_motors(run, ended), _needle(run, ended), _heaters(run, ended))


def halted_unlinked(state: LinkState) -> Aftermath:
    """Return the state of a printer that was halted once its print's process had gone."""
    needle = _away_words(state) or IN_PRINT.format("")
    return Aftermath(needle=needle, heaters=_HALTED_HEAT)


def heat_words(targets: Mapping[str, float]) -> str:
    """Say which heaters stay on, by their targets, °C."""
    on = [f"the {heater} at {celsius:g} °C" for heater, celsius in targets.items() if celsius > 0]
    return f"heaters stay set: {', '.join(on)}" if on else "no heater was set"


def _motors(run: Print, ended: PrintEnded) -> str:
    if ended.state is LinkState.KILLED and UNCONFIRMED not in ended.message:
        return ""
    if ended.known:
        return "the motors are at rest"
    if run.progress.was_reset:
        return "the reset stopped its motors, and its queued moves are lost"
    if run.progress.dropped:
        return "" if "told to stop" in ended.message else "its motors were told to stop"
    if run.excursion.rests:
        return "its motors were at rest"
    if stood := run.progress.standing_words():
        return stood
    seconds = run.progress.left_s()
    if seconds is None:
        return "if powered, its motors execute the queued moves"
    if seconds < 0.05:
        return "its motors are at rest according to the plan"
    return f"if powered, its motors execute the queued moves for up to {seconds:.1f} s, then stop"


def _needle(run: Print, ended: PrintEnded) -> str:
    state = run.logbook.state
    if ended.known and state is LinkState.STOPPING:
        lifted = run.excursion.going_on or run.retreat.lift_mm > 0
        return "the needle was lifted straight up" if lifted else "the needle wasn't lifted"
    if run.excursion.rests:
        return _away_words(LinkState.PAUSED)
    if state in _ON_ITS_WAY:
        return _away_words(state)
    z = run.progress.modal().z
    return IN_PRINT.format("" if z is None else f" at Z {z:.2f} mm, the job's height")


def _away_words(state: LinkState) -> str:
    if state in (LinkState.PAUSED, LinkState.LOOKING):
        return "the needle waits above the print, where the pause lifted it"
    if state in _ON_ITS_WAY:
        return "the needle was moving up or down: check where it is before anything moves"
    return ""


def _heaters(run: Print, ended: PrintEnded) -> str:
    if ended.state is LinkState.KILLED and UNCONFIRMED not in ended.message:
        return _HALTED_HEAT if run.channel.kill.asked.is_set() else _HALTED_ITSELF_HEAT
    if ended.known and run.logbook.state is LinkState.STOPPING:
        return _off_words(run.printer)
    if run.progress.was_reset:
        return "the reset switched its heaters off"
    return heat_words(run.heat.targets())


def _off_words(printer: Printer) -> str:
    off = any(one.startswith((b"M104", b"M140")) for one in heaters_off(printer))
    kept = ", ".join(printer.safe_state_on)
    parts = ["heaters were switched off" if off else "", f"kept on: {kept}" if kept else ""]
    return "; ".join(filter(None, parts))
