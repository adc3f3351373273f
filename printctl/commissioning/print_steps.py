"""Steps of a commissioning with needle and dish: mounted parts, touch-off, first lines."""

from __future__ import annotations

import re
import statistics
from collections import defaultdict
from dataclasses import asdict, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Bath, Dish, Ink, Printer, Syringe, load, shipped
from gcode.deposit.written import SMOOTHING_MM
from gcode.dry_run.run import dry_run
from printctl.calibration import widths as measuring
from printctl.calibration.pattern_job import (
    LineShape,
    PatternMachine,
    PatternOptions,
    pattern_job,
    write_pattern_job,
)
from printctl.calibration.patterns import WrittenPattern, read_pattern
from printctl.calibration.widths.result import Widths
from printctl.checks.preflight.steps import single_step_share, writing_moves
from printctl.checks.set_up import ProfileNames
from printctl.commissioning.bench import Bench
from printctl.commissioning.first_part import slice_first_part
from printctl.commissioning.state import (
    EXPECTED,
    YES_NO,
    CheckFailedError,
    Desk,
    asked_again,
    profile_choices,
)
from printctl.errors import SafetyError, UsageError
from printctl.machine.errors import Refused
from printctl.machine.prints.mounted import mount_parts
from printctl.machine.process.clients.client import Station
from printctl.machine.records.mounting import PARTS, MountedParts, load_mounting

MOST_SINGLE_STEPS: Final = 0.1
"""Share of moves with at most one plunger step above which it is asked about."""
TOUCHES: Final = 3
SPREAD_MM: Final = 0.05
"""Greatest difference of three touches, as on the Printer page."""
LIFT_MM: Final = 5.0
LIFT_ERROR_MM: Final = 1.0
"""Of a height read off a ruler."""
DIPS: Final = 0.03
"""Share by which a wider line may look narrower than the one before, by its reading alone."""
_WAYS: Final = {
    "z": ("up", "down"),
    "x": ("right", "left"),
    "y": ("back", "front"),
}
"""Where the needle goes, seen from the front and relative to the dish, for + and -."""
_USUAL: Final = {
    "needle": "fresh_150um",
    "ink": "collagen_fresh",
    "bath": "gelatin_support",
    "dish": "petri_60mm",
}


def parts_of(desk: Desk) -> MountedParts:
    """Return what was entered at the step of the parts."""
    return MountedParts.from_dict(desk.commission.step("parts").facts["mounted"])


def mount_on(station: Station, parts: MountedParts, **more: Any) -> None:
    """Tell the station what is mounted, where it doesn't know."""
    there, given = station.status.mounted, {}
    for key in (*PARTS, "dish_centre_mm", "bath_depth_mm"):
        if getattr(there, key) != getattr(parts, key):
            given[key] = getattr(parts, key)
    if given | more:
        station.mount(**given | more)


def mounted_parts(desk: Desk, bench: Bench) -> str:
    """Enter what is mounted; see whether the plunger's steps are fine enough for the needle."""
    kept, printer = load_mounting(bench.printer), bench.profile
    weighed = desk.commission.step("steps").answers.get("syringe", "")
    names = {"syringe": kept.parts.syringe or weighed}
    names |= {key: getattr(kept.parts, key) for key in _USUAL}
    given: dict[str, Any] = {}
    for part, model in PARTS.items():
        usual = names[part] or (_USUAL.get(part, "") if bench.simulated else "")
        text = f"Which {part}: {profile_choices(model)}?"
        given[part] = desk.ask(part, text, usual, check=partial(load, model))
    syringe, dish = load(Syringe, given["syringe"]), load(Dish, given["dish"])
    text = f"Ink in the syringe, µL (it holds {syringe.volume_ul:g})?"
    (fill_ul,) = desk.numbers("fill_ul", text, 1, f"{syringe.volume_ul:g}")
    usual = f"{round(min(8.0, 0.7 * dish.wall_mm), 1):g}"
    (depth,) = desk.numbers("bath_depth", "Depth of the bath in the dish, mm?", 1, usual)
    x, y, _ = bench.middle_mm()
    centre = desk.numbers(
        "dish_centre", "Centre of the dish in the printer's frame, X,Y in mm?", 2, f"{x:g},{y:g}"
    )
    given |= {"bath_depth_mm": depth, "dish_centre_mm": (centre[0], centre[1])}
    parts = replace(MountedParts(), **given)
    desk.record.facts["mounted"] = asdict(parts)
    with asked_again("fill_ul", "bath_depth", "dish_centre"):
        mount_parts(load_mounting(bench.printer), printer, dict(given), fill_ul)
    load(Bath, parts.bath)
    fine = _fineness(desk, bench, parts)
    if fine["share"] > MOST_SINGLE_STEPS:
        text = f"{fine['words']} Go on with these parts?"
        evened = "yes" if fine["bead_mm"] <= SMOOTHING_MM else "no"
        if desk.ask("accept_coarse", text, evened, YES_NO) == "no":
            raise CheckFailedError(fine["words"], "accept_coarse", "syringe", "needle", "fineness")
    return fine["words"]


def _fineness(desk: Desk, bench: Bench, parts: MountedParts) -> dict[str, Any]:
    """Slice the first part and count the moves that get at most one plunger step."""
    printer, held = bench.profile, load(Syringe, parts.syringe)
    desk.say(
        "slicing the first part with these parts, to count plunger steps; the first time this "
        "compiles for a minute or two"
    )
    gcode, start = slice_first_part(
        desk.commission.folder / "part", bench.printer, bench.port, parts
    )
    run = dry_run(gcode.read_bytes(), printer, start)
    wrote = writing_moves(run, held.area_mm2)
    share = single_step_share(wrote, printer, held)
    bead_mm = (
        float(wrote.length.sum() / wrote.dose_ul.sum()) * held.area_mm2 / printer.steps_per_mm.e
    )
    words = (
        f"{share:.0%} of the first part's {len(wrote.length)} moves get at most one plunger step "
        f"with {held.name}; one step fills {bead_mm:.2f} mm of bead"
    )
    if share > MOST_SINGLE_STEPS:
        words += (
            f", which syringe and ink even out over about {SMOOTHING_MM:g} mm"
            if bead_mm <= SMOOTHING_MM
            else f", more than the {SMOOTHING_MM:g} mm that syringe and ink even out: it shows as "
            "blobs"
        )
        words += f". At most {MOST_SINGLE_STEPS:.0%} would need {_finer(wrote, printer, held)}."
    return {"share": share, "bead_mm": bead_mm, "words": words}


def _finer(wrote: Any, printer: Printer, held: Syringe) -> str:
    """Name the syringe and the microsteps with which few moves get a single step."""
    narrower = [load(Syringe, name) for name in shipped(Syringe)]
    good = [
        one.name
        for one in sorted(narrower, key=lambda one: -one.volume_ul)
        if one.area_mm2 < held.area_mm2
        and single_step_share(wrote, printer, one) <= MOST_SINGLE_STEPS
    ]
    ways = [f"the syringe {good[0]}"] if good else []
    for times in (2, 4, 8, 16):
        axes = printer.steps_per_mm.model_copy(update={"e": times * printer.steps_per_mm.e})
        finer = printer.model_copy(update={"steps_per_mm": axes})
        if single_step_share(wrote, finer, held) <= MOST_SINGLE_STEPS:
            ways.append(f"{times} times as many microsteps of the plunger")
            break
    return " or ".join(ways) or "a narrower syringe and a wider needle; none shipped would do"


def touch_off(desk: Desk, bench: Bench) -> str:
    """Verify which way each axis moves, touch the dish's floor, verify the height."""
    station, parts = bench.station(), parts_of(desk)
    if bench.simulated:  # of a real printer the same file is kept
        filled = load_mounting(bench.printer).plunger_mm
        desk.once("filled", lambda: mount_on(station, parts, plunger_mm=filled))
    mount_on(station, parts)
    floor = bench.profile.z_mm.low
    status, record = station.status, desk.record
    gone = "floor" in record.facts and status.mounted.floor_mm is None
    if gone or not status.position_trusted:  # disconnected or reset since: nothing of it holds
        for key in ("tip", "heights", "taken", "foil", "floor", "lifted", "height"):
            record.answers.pop(key, None)
            record.facts.pop(key, None)
        for axis in _WAYS:  # a move that nobody has judged is made again
            if f"moved_{axis}" not in record.answers:
                record.facts.pop(f"jogged_{axis}", None)
    if not status.position_trusted:
        at = status.position_mm or bench.middle_mm()
        counts = ",".join(f"{mm:g}" for mm in at)
        text = (
            "Bring the tip 10 to 20 mm above the middle of the dish, by hand or the printer's "
            f"menu (never home with the needle on). Where is it, X,Y,Z in mm (it counts {counts})?"
        )
        x, y, z = desk.numbers("tip", text, 3, counts if bench.simulated else "")
        _refuse_outside(parts, x, y)
        station.set_position(x, y, z)
    for axis, (plus, minus) in _WAYS.items():
        _check_axis(desk, bench, station, axis, plus, minus)
    heights = _touches(desk, bench, station, floor)
    if max(heights) - min(heights) > SPREAD_MM + 1e-9:
        raise CheckFailedError(
            f"the three heights {', '.join(f'{one:g}' for one in heights)} mm differ by "
            f"{max(heights) - min(heights):.3f} mm, limit {SPREAD_MM:g} mm; see that needle and "
            "dish are tight, and touch again",
            *("heights", "taken"),
        )
    (foil,) = desk.numbers("foil", "Thickness of the foil or paper under the tip, mm?", 1, "0")
    desk.once("floor", lambda: _set_floor(station, statistics.median(heights) - foil, floor))
    up = floor + LIFT_MM
    desk.once(
        "lifted",
        lambda: station.move_to(z=up).message,
        f"Move the tip straight to {LIFT_MM:g} mm above the floor?",
    )
    usual = f"{LIFT_MM:g}" if bench.simulated else ""
    text = "How high is the tip above the floor by a ruler, mm?"
    (height,) = desk.numbers("height", text, 1, usual)
    if abs(height - LIFT_MM) > LIFT_ERROR_MM:
        raise CheckFailedError(
            f"the tip is {height:g} mm above the floor after a move to {LIFT_MM:g} mm (limit "
            f"± {LIFT_ERROR_MM:g} mm): Z has wrong steps (steps_per_mm.z, M92 Z) or a place was "
            "given with the wrong sign; correct that and touch off again",
            *("heights", "taken", "floor", "lifted", "height", "tip"),
        )
    return f"axes move as they should; the dish's floor is Z {floor:g} mm in the printer's frame"


def _refuse_outside(parts: MountedParts, x: float, y: float) -> None:
    """Refuse a place of the tip that isn't above the dish, as its centre was entered."""
    dish, centre = load(Dish, parts.dish), parts.dish_centre_mm
    if centre is None:
        return
    off_x, off_y = abs(x - centre[0]), abs(y - centre[1])
    if off_x < dish.inner_x_mm / 2 and off_y < dish.inner_y_mm / 2:
        return
    raise CheckFailedError(
        f"{x:g},{y:g} isn't above the middle of {dish.name}, which was entered as "
        f"{centre[0]:g},{centre[1]:g} mm: with the tip there, give X,Y as {centre[0]:g},"
        f"{centre[1]:g}; or correct the dish's centre first (begin again at the step parts)",
        "tip",
    )


def _check_axis(
    desk: Desk, bench: Bench, station: Station, axis: str, plus: str, minus: str
) -> None:
    """Jog an axis by 1 mm and ask where the needle went; take it back."""
    desk.once(
        f"jogged_{axis}",
        lambda: station.jog(axis, 1.0).message,
        f"Move the needle by 1 mm along +{axis.upper()}? It should go {plus}.",
    )
    way = desk.ask(
        f"moved_{axis}",
        f"By 1 mm along +{axis.upper()}: which way did the needle move relative to the dish, seen "
        "from the front?",
        plus if bench.simulated else "",
        (plus, minus, "not"),
    )
    if way != plus:
        raise CheckFailedError(
            f"+{axis.upper()} moved the needle "
            + ("not at all: see its motor's cable and driver" if way == "not" else f"to the {minus}"
               if axis != "z" else "down")
            + f", and should have moved it {plus}: every part would be mirrored or driven into "
            f"the dish. Invert {axis.upper()} in the firmware (Marlin INVERT_{axis.upper()}_DIR, "
            "Klipper dir_pin, RepRapFirmware M569) before anything else moves",
            f"jogged_{axis}",
            f"moved_{axis}",
        )  # fmt: skip
    if axis != "z":
        desk.once(f"back_{axis}", lambda: station.jog(axis, -1.0).message)


def _touches(desk: Desk, bench: Bench, station: Station, floor: float) -> list[float]:
    """Return three heights of the tip on the floor, typed or taken while it is moved by steps."""
    usual = ",".join([f"{floor:g}"] * TOUCHES) if bench.simulated else ""
    if station.status.mounted.floor_mm is not None and "heights" not in desk.record.answers:
        usual = ",".join(
            [f"{station.status.mounted.floor_mm:g}"] * TOUCHES
        )  # as on the Printer page
    taken: list[float] = desk.record.facts.setdefault("taken", [])
    text = (
        "Lower the tip onto the foil until it just drags. Type steps such as z-0.1 (repeat), and "
        f"'touch' to take a height, {TOUCHES} times; or the {TOUCHES} heights with commas?"
    )
    while "heights" not in desk.record.answers:
        answer = desk.ask("heights", text, usual)
        text, usual = f"Step, 'touch', or the {TOUCHES} heights?", ""
        steps = re.findall(r"([xyz])\s*([+-]?\d+(?:\.\d+)?)", answer.lower())
        if answer == "touch" or steps:
            del desk.record.answers["heights"]
            desk.commission.save()
            try:
                if steps:
                    station.jog({axis: float(mm) for axis, mm in steps})
            except Refused as refused:
                desk.say(str(refused))
            at = station.status.position_mm
            if at is not None:
                taken += [at[2]] if answer == "touch" else []
                desk.say(f"tip at Z {at[2]:.3f} mm; {len(taken)} of {TOUCHES} heights")
            if len(taken) == TOUCHES:
                desk.record.answers["heights"] = ",".join(f"{one:g}" for one in taken)
    return desk.numbers("heights", text, TOUCHES)


def _set_floor(station: Station, touched: float, floor: float) -> float:
    """Count Z so that the dish's floor is the profile's lowest; the checks take it to be there."""
    at = station.status.position_mm
    if at is None:
        raise SafetyError("the printer doesn't tell its position (M114); reconnect it")
    if abs(touched - floor) > 1e-6:
        station.set_position(z=at[2] + floor - touched)
    station.touch_off(floor)
    return floor


def first_lines(desk: Desk, bench: Bench) -> str:
    """Print lines in the bath, read their widths, write the ink's factors."""
    path, parts = desk.commission.folder / "lines.gcode", parts_of(desk)

    def print_lines() -> dict[str, Any]:
        station = bench.station()
        mount_on(station, parts)
        bench.move_above(station, job.at_mm)
        return bench.print(path, path.with_suffix(".print"), parts.syringe, parts.ink)

    if "printed" not in desk.record.facts:
        x, y = parts.dish_centre_mm or bench.middle_mm()[:2]
        depth = parts.depth_mm or 0.0
        at = (x, y, round(bench.profile.z_mm.low + depth / 2, 3))
        machine = PatternMachine(bench.printer, parts.syringe, parts.ink, parts.needle)
        names = ProfileNames(parts.needle, parts.bath, parts.dish, f"{x!r},{y!r}", depth)
        job = pattern_job(path, "lines", PatternOptions(), LineShape(), machine, names, at)
        _, seconds, notes = write_pattern_job(job)
        for note in notes:
            desk.say(note)
        desk.once(
            "printed",
            print_lines,
            f"Print lines.gcode ({seconds / 60:.0f} min) in the bath? The tip goes up, above the "
            f"middle of the dish, down to Z {at[2]:g}, and prints.",
        )
    sheet = path.with_suffix(".csv")
    found = desk.once("fitted", lambda: _read_widths(desk, bench, sheet, parts))
    if found["ink"] != parts.ink:
        parts = replace(parts, ink=found["ink"])
        desk.commission.step("parts").facts["mounted"]["ink"] = found["ink"]
        mount_parts(load_mounting(bench.printer), bench.profile, {"ink": found["ink"]}, None)
    return found["words"]


def _read_widths(desk: Desk, bench: Bench, sheet: Path, parts: MountedParts) -> dict[str, Any]:
    written = read_pattern(sheet.with_suffix(".json"))
    expected = EXPECTED if bench.simulated else ""
    text = (
        f"Fill in the last column of {sheet} (drawing: .svg) and give its name, or give a picture "
        "of the lines"
        + ("; 'expected' takes the widths that the simulated ink should have?" if expected else "?")
    )
    answer = desk.ask("widths", text, expected or str(sheet))
    if answer == EXPECTED:
        answer = str(_as_expected(sheet))
    file = Path(answer)
    try:
        if not file.is_file():
            raise UsageError(f"{file} doesn't exist")
        if file.suffix.lower() == ".csv":
            measured = measuring.read_sheet(file, written)
        else:
            seen = measuring.measure_picture(
                file, written, measuring.PictureFacts(None, None, None)
            )
            seen.save(file)
            measured = seen.measured
        assert isinstance(measured, Widths)  # of lines
        _refuse_dips(written, measured)
        result = measuring.fit_measured(written, measured, measuring.GivenValues(None))
    except UsageError as exc:
        raise CheckFailedError(f"the widths can't be used: {exc}", "widths") from exc
    for note in result.notes:
        desk.say(note)
    said = "; ".join(f"{name} {one.text()}" for name, one in list(result.lines.items())[:2])
    if not result.measured:
        return {"ink": parts.ink, "words": f"{said}; nothing is written, for it isn't sure enough"}
    own = desk.commission.folder / f"{Path(parts.ink).stem}.yaml"
    if own.exists() and str(own) != parts.ink:
        own.unlink()  # of a commissioning begun again
    accepted = desk.record.answers.get("accept_change") == "yes"
    try:
        result.save(own, load(Ink, parts.ink), accept_change=accepted)
    except SafetyError as exc:
        if desk.ask("accept_change", f"{exc}. Accept?", "no", YES_NO) == "no":
            forget = "accept_change", "widths", "printed"
            raise CheckFailedError(str(exc), *forget) from exc
        result.save(own, load(Ink, parts.ink), accept_change=True)
    return {"ink": str(own), "words": f"{said}; written into {own}"}


def _as_expected(sheet: Path) -> Path:
    """Fill the sheet in with the widths that it expects."""
    filled, rows = sheet.with_name("lines_expected.csv"), []
    for line in sheet.read_text(encoding="utf-8").splitlines():
        cells = line.split(",")
        number = not line.startswith("#") and cells[0].isdecimal()
        rows.append(line + cells[-2] if number else line)
    filled.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return filled


def _refuse_dips(written: WrittenPattern, measured: Widths) -> None:
    """Raise `CheckFailedError` where a line with more ink at the same speed is narrower."""
    series: dict[float, list[tuple[float, float, int]]] = defaultdict(list)
    for stroke in written.pattern.of_role("line"):
        _, read = measured.of(stroke.number)
        if len(read):
            middle = float(statistics.median(read.tolist()))
            series[float(stroke.speed_mm_s[0])].append((stroke.flow, middle, stroke.number))
    for speed, lines in series.items():
        ordered = sorted(lines)
        for (flow, width, number), (more, wider, other) in pairwise(ordered):
            if more > flow and wider < width * (1 - DIPS):
                raise CheckFailedError(
                    f"at {speed:g} mm/s line {other} (flow {more:g}) is {wider:.3f} mm wide, and "
                    f"line {number} with less ink (flow {flow:g}) {width:.3f} mm: the widths don't "
                    "rise with the ink. Read these lines again; if they are so, prime the needle "
                    "and look for air or a clog, then print again: printctl commission --from "
                    "lines",
                    "widths",
                )
