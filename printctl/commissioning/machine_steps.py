"""Steps of a commissioning at the machine: profile, connection, plunger steps."""

from __future__ import annotations

import csv
import io
from datetime import date
from pathlib import Path
from typing import Any, Final

import yaml

from design.files import write_text
from firmware_profiles import Printer, Syringe, load, profile_doubts, shipped, shipped_text
from firmware_profiles.families import family_of
from printctl import calibration
from printctl.calibration.writing import MAX_CHANGE, MeasuredValue, save_measured
from printctl.commissioning.bench import Bench
from printctl.commissioning.state import YES_NO, CheckFailedError, Desk, profile_choices
from printctl.errors import UsageError
from printctl.machine.errors import LinkError
from printctl.machine.ports.detection import (
    AUTO,
    SIMULATED,
    list_ports,
    matches,
    named_port,
    runs_files,
)
from printctl.machine.probing import ABSOLUTE, Row, compare, corrected_profile, reported_firmware
from printctl.machine.records.mounting import load_mounting

KEEP: Final = "keep"
WATER_G_CM3: Final = (0.998, 0.001)
DOSES: Final = (0.02, 0.04, 0.06)
"""Of the syringe's volume, or of 2 mL where it holds more."""
REPEATS: Final = 4
PUSH: Final = 0.01
"""Of the same, to see which way the plunger goes."""


def profile(desk: Desk, bench: Bench) -> str:
    """Choose the port; copy a shipped profile, or keep the file that is there; check it."""
    found = [one for one in list_ports() if one.usb_id]
    ports = "".join(f"; {one}" for one in found) or "; no USB serial port is seen here"
    usual = found[0].device if len(found) == 1 else "" if found else SIMULATED
    text = (
        f"Port: a device, tcp:HOST:PORT, auto or simulated{ports}? It is opened to ask which "
        "firmware answers, which resets many boards and moves nothing."
    )
    port = desk.ask("port", text, usual)
    if runs_files(port):
        raise CheckFailedError(
            f"{port} is a network host that runs files by itself; no step here can be done there. "
            "Connect the printer's own port, or calibrate by single commands (printctl calibrate)",
            "port",
        )
    file = Path(desk.commission.printer)
    names = [name for name in shipped(Printer) if _can_be_commissioned(load(Printer, name))]
    there = [KEEP] if file.exists() else []
    proposed, why = (KEEP, f"{file} exists") if there else _proposed(port, names)
    text = f"Which shipped profile is nearest to the printer ({why})?"
    name = desk.ask("profile", text, proposed, [*there, *names])
    desk.once("copied", lambda: _copy(file, name))
    printer = load(Printer, str(file))
    if not _can_be_commissioned(printer):
        raise CheckFailedError(
            f"{printer.name}: a printer with one plunger that takes lines from a host can be "
            "commissioned here; for several heads see docs/heads.md, for air `printctl calibrate "
            "weigh`",
            "profile",
            "copied",
        )
    desk.record.answers["port"] = named_port(port, printer)  # of auto, the one found
    doubts = profile_doubts(printer, [load(Syringe, one) for one in shipped(Syringe)])
    if grave := [f"{one.key}: {one.text}" for one in doubts if one.grave]:
        raise CheckFailedError(f"{file}: {'; '.join(grave)}. Correct the file, then go on here")
    for one in doubts:
        desk.say(f"{one.key}: {one.text}")
    return f"{printer.name} ({printer.firmware}) in {file}; {len(doubts)} notes"


def _can_be_commissioned(printer: Printer) -> bool:
    return printer.streamed and printer.pneumatic is None and not printer.heads


def _proposed(port: str, names: list[str]) -> tuple[str, str]:
    """Return the profile proposed for a port, and why: by its USB id, then by its firmware."""
    if port == SIMULATED:
        return "generic_marlin", "the simulated printer can be any of them"
    ports = [one for one in list_ports() if port in (AUTO, one.device)]
    by_id = [one for one in names if any(matches(load(Printer, one), p) for p in ports)]
    if len(by_id) == 1:
        return by_id[0], "by the port's USB id"
    if port == AUTO:
        return "", f"{len(by_id)} profiles fit the USB ids seen here"
    try:
        firmware = reported_firmware(port, [load(Printer, name) for name in names])
    except LinkError as exc:
        return "", f"the firmware couldn't be asked: {exc}"
    families = {name: family_of(load(Printer, name)).reported_name for name in names}
    if fitting := [name for name, word in families.items() if word in firmware.lower()]:
        usual = "generic_marlin" if "generic_marlin" in fitting else fitting[0]
        return usual, f"the firmware says {firmware}"
    return "", f"the firmware calls itself {firmware!r}, which no family does"


def _copy(file: Path, name: str) -> str:
    if name == KEEP:
        return KEEP
    if file.exists():
        file.replace(file.with_suffix(".yaml.before"))
    write_text(file, shipped_text(Printer, name))
    return name


def connection(desk: Desk, bench: Bench) -> str:
    """Read the printer's settings, compare them with the profile, take them over if wanted."""
    if not bench.simulated:
        desk.confirm(
            "open",
            f"Open {bench.port}? Nothing moves, but opening it resets many boards.",
        )
    settings, printer = bench.query(), bench.profile
    family = family_of(printer)
    if family.reported_name not in settings.firmware.lower():
        raise CheckFailedError(
            f"{bench.port} answers as {settings.firmware!r}, the profile says {printer.firmware}; "
            "choose the profile of this firmware: printctl commission --from profile"
        )
    for note in settings.notes:
        desk.say(note)
    rows, shifted = _without_shifts(compare(settings, printer))
    if shifted:
        desk.say(
            f"{', '.join(shifted)}: the printer counts from another place (G92), over the same "
            "length; not taken over"
        )
    differing = [row for row in rows if not row.same]
    if differing:
        text = "; ".join(f"{row.key} {row.printer:g}, profile {row.profile:g}" for row in differing)
        question = f"The printer says otherwise than the profile: {text}. Take its values over?"
        if desk.ask("take_over", question, "yes", YES_NO) == "no":
            steps = [row.key for row in differing if row.key.startswith("steps_per_mm")]
            if steps:
                raise CheckFailedError(
                    f"{', '.join(steps)} differ, and every print would be refused; take the "
                    "printer's values over (take_over=yes), or set them in the firmware",
                    "take_over",
                )
        else:
            data = corrected_profile(printer, rows, bench.port, date.today().isoformat())
            text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=100)
            write_text(Path(bench.printer), text)
            again = [row.key for row in compare(settings, bench.profile) if not row.same]
            again = [key for key in again if key.partition(".")[0] not in shifted]
            if again:
                raise CheckFailedError(f"{bench.printer} still differs in {', '.join(again)}")
    left = ", ".join(bench.profile.starting_values)
    if left:
        desk.say(f"starting values that the printer doesn't report, to be measured: {left}")
    return f"{settings.firmware}: {len(rows)} settings compared, {len(differing)} differed"


def _without_shifts(rows: list[Row]) -> tuple[list[Row], list[str]]:
    """Drop axes whose two ends are off by the same: a G92 since the board's start."""
    off = {row.key: float(row.printer) - float(row.profile) for row in rows if not row.same}
    shifted = [
        name
        for name in ("x_mm", "y_mm", "z_mm")
        if {f"{name}.low", f"{name}.high"} <= off.keys()
        and abs(off[f"{name}.low"] - off[f"{name}.high"]) <= ABSOLUTE
    ]
    return [row for row in rows if row.key.partition(".")[0] not in shifted], shifted


def plunger_steps(desk: Desk, bench: Bench) -> str:
    """Weigh doses of water; send, store and verify the plunger's steps/mm."""
    kept = load_mounting(bench.printer).parts.syringe
    usual = kept or ("hamilton_1ml" if bench.simulated else "")
    text = f"Which syringe is mounted, full of water: {profile_choices(Syringe)}?"
    name = desk.ask("syringe", text, usual, check=lambda one: load(Syringe, one))
    syringe = load(Syringe, name)
    push_ul = PUSH * min(syringe.volume_ul, 2000.0)
    desk.once(
        "pushed",
        lambda: _push(bench, name, push_ul),
        f"Push {push_ul:g} µL? The plunger moves {push_ul / syringe.area_mm2:.2f} mm; nothing else "
        "moves.",
    )
    expected = "forward" if bench.simulated else ""
    way = desk.ask(
        "plunger_moved",
        "Which way did the plunger move: forward (water leaves the needle) or backward?",
        expected,
        ("forward", "backward", "not"),
    )
    if way != "forward":
        fault = (
            "didn't move: see its motor's cable and driver"
            if way == "not"
            else "moved backward, so E has the wrong sign: invert it in the firmware (Marlin "
            "INVERT_E0_DIR, Klipper dir_pin, RepRapFirmware M569), or turn the motor's plug round "
            "with the power off"
        )
        raise CheckFailedError(f"the plunger {fault}", "pushed", "plunger_moved")
    found = desk.once("weighed", lambda: _weigh(desk, bench, name, syringe))
    old, new, change = found["old"], found["new"], found["change"]
    words = f"{old:.2f} to {new:.2f} steps/mm ({change:+.1%})"
    if found["agrees"]:
        return f"{old:.2f} steps/mm agree with the weighing ({found['text']}); nothing was sent"
    if abs(change) > MAX_CHANGE:
        text = (
            f"The steps would change from {words}, above {MAX_CHANGE:.0%}. Likely cause: another "
            "syringe than the one named, or masses in another unit. Accept the change?"
        )
        if desk.ask("accept_change", text, "no", YES_NO) == "no":
            raise CheckFailedError(
                f"{words} isn't accepted (limit {MAX_CHANGE:.0%}); name the syringe that was "
                "weighed (--from steps), or weigh again, or accept it (--accept-change)",
                "accept_change",
                "masses",
                "weighed",
            )
    family = family_of(bench.profile)
    if family.stores_steps:
        confirm = (
            f"Send M92 E{new:.2f} and M500 to {bench.port}? Steps change from {words}, in the "
            "printer's memory (EEPROM) and the profile."
        )
    else:
        confirm = (
            f"{bench.profile.firmware} stores no steps that are sent. "
            f"{family.steps_remedy.format(steps=f'{new:.2f}')}. Done? Then the profile is written, "
            f"from {words}."
        )
    verified = desk.once("written", lambda: _write_steps(bench, name, found), confirm)
    back = "read back" if verified else "which this firmware doesn't report, so not verified"
    return f"{words}, measured {found['text']}; {back}, and written into {bench.printer}"


def _push(bench: Bench, syringe: str, ul: float) -> float:
    station = bench.station()
    station.mount(syringe=syringe, plunger_mm=0.0)
    station.plunger(ul)
    return ul


def _weigh(desk: Desk, bench: Bench, name: str, syringe: Syringe) -> dict[str, Any]:
    """Print the doses, read their masses, fit; return old and new steps."""
    printer, path = bench.profile, desk.commission.folder / "weigh.gcode"
    volume = min(syringe.volume_ul, 2000.0)
    doses = [round(part * volume, 3) for part in DOSES] * REPEATS
    flow = min(volume / 500.0, 0.8 * printer.max_speed_mm_s.e * syringe.area_mm2)
    (wait_s,) = desk.numbers("wait_s", "Seconds to change a vial?", 1, "30")
    test = calibration.weighing_test(doses, flow, wait_s, syringe)
    at = bench.middle_mm()
    job = calibration.Job(path, test, printer, syringe, at)

    def push_doses() -> dict[str, Any]:
        station = bench.station()
        station.mount(needle="", dish="", ink="", syringe=name)
        made = calibration.make_test(job)
        station.set_position(*at)
        return {**bench.print(path, path.with_suffix(".print"), name), "s": made.duration_s}

    desk.once(
        "doses",
        push_doses,
        f"Push {len(doses)} doses of {', '.join(f'{one:g}' for one in doses[:3])} µL, "
        f"{wait_s:g} s before each, {sum(doses):g} µL in all? A vial under the needle, 10 mm of "
        "room above the head: the plunger moves, and at the end the needle 5 mm straight up.",
    )
    travel = [float(row[0]) for row in test.rows]
    # The simulated printer is as its profile says, so that it pushes what is commanded.
    ideal = ",".join(f"{mm * syringe.area_mm2 * WATER_G_CM3[0]:.2f}" for mm in travel)
    text = f"Masses of the {len(doses)} doses in their order, mg, with commas between?"
    masses = desk.numbers("masses", text, len(doses), ideal if bench.simulated else "")
    sheet = job.sheet
    head = sheet.read_text(encoding="utf-8").splitlines()
    above = [line for line in head if line.startswith("#")]
    table = io.StringIO()
    table.writelines(f"{line}\n" for line in above)
    rows = [test.columns, *zip((row[0] for row in test.rows), masses, strict=True)]
    csv.writer(table, lineterminator="\n").writerows(rows)
    write_text(sheet, table.getvalue())
    try:
        data = calibration.read_readings(sheet, test.columns, ())
        result = calibration.weighing_result(data, WATER_G_CM3, printer, syringe)
    except UsageError as exc:
        raise CheckFailedError(f"the masses can't be used: {exc}", "masses") from exc
    steps, old = result.lines["steps per travel, if the bore is right"], printer.steps_per_mm.e
    if steps.value <= 0:
        raise CheckFailedError("larger doses weigh less; enter the masses again", "masses")
    for note in result.notes:
        desk.say(note)
    new = round(steps.value, 2)
    agrees = steps.low <= old <= steps.high or abs(new - old) <= ABSOLUTE
    return {"old": old, "new": new, "change": new / old - 1, "agrees": agrees, "text": steps.text()}


def _write_steps(bench: Bench, name: str, found: dict[str, Any]) -> bool:
    """Send and store the steps where the family does, write the profile; whether they read back."""
    printer, new = bench.profile, found["new"]
    stores = family_of(printer).stores_steps
    settings = bench.set_plunger_steps(new) if stores else bench.query()
    reported = settings.values.get("steps_per_mm.e")
    if bench.simulated and not stores:
        reported = new  # a new simulated printer is as its profile says
    if reported is not None and abs(float(reported) - new) > ABSOLUTE:
        raise CheckFailedError(
            f"the printer reports {reported:g} steps/mm after {new:.2f} were set; see whether its "
            "memory can be written (Marlin EEPROM_SETTINGS) and go on here"
        )
    axes = printer.steps_per_mm.model_dump(mode="json") | {"e": new}
    said = f"weighed with {name}, {found['text']}, 95 %"
    measured = {"steps_per_mm.e": MeasuredValue(axes, said)}
    save_measured(Path(bench.printer), printer, measured, accept_change=True)
    return reported is not None
