"""Several pneumatic heads, each with a valve, a pressure and a vertical axis of its own."""

import re
from itertools import pairwise

import numpy as np
import pytest

from design.network import VesselKind, VesselNetwork
from design.toolpath.embedded import EmbeddedHeads, EmbeddedOptions, plan_embedded
from design.toolpath.fresh import Filling, FreshOptions, Region, plan_fresh
from design.toolpath.gcode import GcodeOptions, HeadLoad, write_gcode
from firmware_profiles import Printer, Syringe, load
from gcode.deposit.lay import valves_as_plungers
from gcode.dry_run.run import dry_run
from gcode.heads import flowing_s
from gcode.program.modal import MOVE
from printctl.checks.preflight import Check, gcode_checks, head_checks
from tests.design.toolpath.shapes import as_solid, block

RIG = load(Printer, "stanford_two_heads")
AUTOMATION1 = load(Printer, "stanford_two_heads_automation1")
DUET = load(Printer, "two_valves_duet3")
START = (0.0, 0.0, 60.0)
PLACE = np.array([-10.0, -5.0, 4.0])
FLOW_UL_S = 0.2
APART_MM = 103.0


def three_tubes() -> VesselNetwork:
    """Return an artery below, a vein above and another artery on top, side by side."""
    height = np.array([2.0, 4.0, 6.0])
    begin = np.column_stack([np.full(3, 2.0), [2.0, 6.0, 10.0], height])
    nodes = np.concatenate([begin, begin + [12.0, 0, 0]])
    ends = np.column_stack([np.arange(3), np.arange(3, 6)])
    kind = np.array([VesselKind.ARTERY, VesselKind.VEIN, VesselKind.ARTERY], dtype=np.int64)
    return VesselNetwork.from_segments(nodes, ends, np.full(3, 0.25), kind, np.arange(3))


def job(printer: Printer, place: np.ndarray = PLACE) -> bytes:
    network = three_tubes()
    options = EmbeddedOptions(needle_inner_mm=0.2, needle_outer_mm=0.4)
    heads = EmbeddedHeads((options, options), (network.kind == VesselKind.VEIN).astype(np.int64))
    load_of = HeadLoad(load(Syringe, "hamilton_1ml"), flow_ul_s=FLOW_UL_S)
    given = GcodeOptions(start_mm=START, heads=(load_of, load_of))
    plan = plan_embedded(network, heads)
    return write_gcode(plan.toolpath, printer, load_of.syringe, place, given).data


def strokes_of(text: str) -> list[tuple[str, np.ndarray]]:
    """Interpret the file by the controller's words alone; each valve's path while it is open."""
    at = dict.fromkeys("XYAB", 0.0)
    open_valve, pressure, port = "", {1: 0.0, 2: 0.0}, 0
    strokes: list[tuple[str, list[list[float]]]] = []
    for line in text.splitlines():
        valve = re.fullmatch(r"BRAKE A(.) ([01])|DriveBrakeO(n|ff)\(A(.)\)", line)
        if valve:
            head = (valve[1] or valve[4]).upper()
            if valve[2] == "0" or valve[3] == "ff":
                assert not open_valve
                assert not port or pressure[2 if head == "A" else 1] == pytest.approx(10)
                open_valve = head
                strokes.append((head, [[at["X"], at["Y"], at[head]]]))
            else:
                open_valve = "" if open_valve == head else open_valve
        elif line.startswith("$COM="):
            port = int(line[5:])
        elif line.startswith("$AP="):
            pressure[port] = float(line[4:])
        elif line.startswith(("G1 ", "G92 ")):
            before = dict(at)
            at |= {word[0]: float(word[1:]) for word in line.split()[1:] if word[0] in at}
            if line.startswith("G1") and (at["X"], at["Y"]) != (before["X"], before["Y"]):
                lowest = {"A": at["A"], "B": at["B"]}
                lowest.pop(open_valve, None)
                idle = min(lowest.values()) if open_valve else max(lowest.values())
                assert idle > PLACE[2] + 6.25  # no idle tip among what is written
            if open_valve:
                assert not {"A", "B"} - {open_valve} & {word[0] for word in line.split()}
                strokes[-1][1].append([at["X"], at["Y"], at[open_valve]])
    assert not open_valve
    assert not port or pressure == pytest.approx({1: 5.0, 2: 5.0})
    return [(head, np.array(path)) for head, path in strokes]


@pytest.mark.parametrize("printer", [RIG, AUTOMATION1], ids=["a3200", "automation1"])
def test_each_valve_writes_its_own_vessels_with_its_own_axis(printer):
    strokes = strokes_of(job(printer).decode())
    by_height = sorted((path[:, 2].mean() - PLACE[2], head, path) for head, path in strokes)
    assert [head for _, head, _ in by_height] == ["A", "B", "A"]
    for number, (height, head, path) in enumerate(by_height):
        tip = path + [APART_MM if head == "B" else 0.0, 0, 0] - PLACE
        assert height == pytest.approx(2.0 * (number + 1), abs=1e-3)
        assert np.abs(tip[:, 1] - (2.0 + 4.0 * number)).max() < 1e-3
        assert sorted(tip[[0, -1], 0].tolist()) == pytest.approx([2.0, 14.0], abs=0.3)


@pytest.mark.parametrize("printer", [RIG, AUTOMATION1], ids=["a3200", "automation1"])
def test_dry_run_finds_heads_by_their_valves(printer):
    gcode = job(printer)
    run = dry_run(gcode, printer, START)
    assert not run.unknown
    failed = [one for one in [*gcode_checks(run, printer), *head_checks(run, printer)]
              if one.refuses]  # fmt: skip
    assert not failed
    assert np.count_nonzero(np.diff(run.program.tool)) in (1, 2)  # the vein is one of three
    written = np.pi * 0.25**2 * 12
    for number, vessels in ((0, 2), (1, 1)):
        view, head = run.of_head(number), printer.airs[number]
        open_s = flowing_s(view.executed, view.program, view.valve, head)
        assert open_s * FLOW_UL_S == pytest.approx(vessels * written, rel=0.15)


def test_pressure_that_the_profile_does_not_write_at_is_refused():
    gcode = job(RIG).replace(b"$COM=1\n$AP=10", b"$COM=1\n$AP=8", 1)
    run = dry_run(gcode, RIG, START)
    failed = {one.check for one in gcode_checks(run, RIG) if one.refuses}
    assert failed == {"head 1: pressure at valve opening"}
    rests = job(RIG).replace(b"$COM=2\n$AP=5", b"$COM=2\n$AP=10")
    failed = {one.check for one in gcode_checks(dry_run(rests, RIG, START), RIG) if one.refuses}
    assert failed == {"head 0: not at resting pressure while idle or at the end"}
    lower = b"$COM=2\n$AP=5\nCall setPress P$COM Q$AP\n"
    during = job(RIG).replace(b"BRAKE Aa 0\n", b"BRAKE Aa 0\n" + lower)
    failed = {one.check for one in refused(during, RIG)}
    assert "head 0: pressure changed with the valve open" in failed
    rest = b"$COM=1\n$AP=5\nCall setPress P$COM Q$AP\n"
    failed = {one.check for one in refused(job(RIG).replace(rest, b"", 1), RIG)}
    assert failed == {"head 1: not at resting pressure while idle or at the end"}
    stray = job(RIG).replace(b"$COM=1\n$AP=5", b"$AP=5", 1)
    assert any(name == "$AP=5" for _, name in dry_run(stray, RIG, START).unknown)


def test_line_that_one_axis_alone_refuses_is_refused():
    gcode = job(RIG).replace(b"\nG1 B", b"\nG1 B3.3000000000000001\nG1 B", 1)
    run = dry_run(gcode, RIG, START)
    assert any("digits" in one.message for one in run.findings)


def test_axis_that_moves_beside_the_head_in_use_takes_its_time():
    gcode = job(RIG)
    whole = dry_run(gcode, RIG, START).duration_s
    lone = gcode.replace(b"\nWAIT", b"\nG1 B61 F2\nG1 B60\nWAIT", 1)
    assert dry_run(lone, RIG, START).duration_s - whole == pytest.approx(1.0, abs=0.05)
    row = gcode.index(b"\nG1 X")  # the first move across has A or B at rest
    end = gcode.index(b"\n", row + 1)
    beside = gcode[:end].rpartition(b" F")[0] or gcode[:end]
    assert dry_run(beside + b" B160 F5" + gcode[end:], RIG, START).duration_s > whole + 10


def test_head_not_in_use_stays_within_its_travel():
    gcode = job(RIG).replace(b"\nWAIT", b"\nG1 B500 F2\nG1 B60\nWAIT", 1)
    (found,) = (one for one in dry_run(gcode, RIG, START).findings if one.code == "outside_z")
    assert "B, the axis of head 1, goes to 500 mm" in found.message


@pytest.mark.parametrize("moved_to", [b"\nG92 B60", b"\nDISABLED", b"\nG1 X"])
def test_axis_of_a_valve_is_enabled_right_before_its_opening_alone(moved_to):
    gcode = job(RIG)
    assert gcode.count(b"\nEnable Aa\nBRAKE Aa 0\n") == gcode.count(b"BRAKE Aa 0") == 2
    assert not refused(gcode, RIG)
    if moved_to == b"\nDISABLED":  # its opening alone is missing
        gcode = gcode.replace(b"\nBRAKE Aa 0", b"", 1)
    else:
        gcode = gcode.replace(moved_to, b"\nEnable Aa" + moved_to, 1)
    (found,) = (one for one in refused(gcode, RIG) if one.check == AMBIGUOUS)
    assert "'BRAKE Aa 0' isn't the next line" in found.remedy


AMBIGUOUS = "words that firmwares interpret differently"


def refused(gcode: bytes, printer: Printer) -> list[Check]:
    run = dry_run(gcode, printer, START)
    return [one for one in [*gcode_checks(run, printer), *head_checks(run, printer)] if one.refuses]


def lines_with(gcode: bytes, words: str) -> list[int]:
    """Return which lines begin with any of some words, apart by a stroke."""
    lines = gcode.decode().splitlines()
    return [at for at, line in enumerate(lines) if re.match(words, line)]


def without(gcode: bytes, at: int) -> bytes:
    lines = gcode.splitlines(keepends=True)
    return b"".join(lines[:at] + lines[at + 1 :])


OPENS, CLOSES = r"BRAKE \w+ 0|DriveBrakeOff", r"BRAKE \w+ 1|DriveBrakeOn"


@pytest.mark.parametrize("printer", [RIG, AUTOMATION1, DUET], ids=["a3200", "automation1", "duet"])
@pytest.mark.parametrize("opens", [True, False], ids=["opening", "closing"])
def test_file_without_one_of_its_openings_or_closings_is_refused(printer, opens):
    place = PLACE if printer is not DUET else np.array([60.0, 60.0, 4.0])
    gcode = job(printer, place)
    words = r"M42 P[01] S1|" + OPENS if opens else r"M42 P[01] S0|" + CLOSES
    places = lines_with(gcode, words)
    assert len(places) == (3 if opens else 5)
    for at in places:  # the header's closings too
        one = without(gcode, at)
        if opens and b"Enable" in gcode:
            one = without(one, at - 1)
        assert refused(one, printer), f"without line {at + 1}"


@pytest.mark.parametrize("printer", [RIG, AUTOMATION1], ids=["a3200", "automation1"])
def test_valve_switched_without_a_wait_is_refused_and_the_remedy_passes(printer):
    gcode = job(printer)
    text = gcode.decode().splitlines()
    waits = "WAIT MOVEDONE X Y A B" if printer is RIG else "WaitForMotionDone([X, Y, A, B])"
    switches = lines_with(gcode, f"{OPENS}|{CLOSES}")[2:]
    for switch in switches:
        at = switch - 1 - text[switch - 1].startswith("Enable")
        assert text[at] == waits
        lone = without(gcode, at)
        (found,) = refused(lone, printer)
        assert found.check.endswith("valve switched while the head is moving")
        enables = ", for opening before 'Enable " if printer is RIG else ""
        assert found.remedy.startswith(f"add {waits} before it{enables}")
        line = int(found.place.split()[1]) - 1
        lines = lone.decode().splitlines(keepends=True)
        enabled = lines[line - 1].startswith("Enable")
        mended = [*lines[: line - enabled], waits + "\n", *lines[line - enabled :]]
        assert not refused("".join(mended).encode(), printer)
        dwelt = "".join([*lines[: line - enabled], "G4 P1\n", *lines[line - enabled :]])
        assert refused(dwelt.encode(), printer)  # the controller looks ahead past it


def test_closing_again_before_the_first_and_after_the_last_move_is_no_fault():
    gcode = job(RIG)
    again = b"BRAKE Aa 1\nBRAKE Ab 1\n"
    assert not refused(gcode.replace(b"G71\n", again + b"G71\n", 1) + again, RIG)
    (found,) = refused(gcode.replace(b"BRAKE Ab 1\nG4 P0.08\n", again + b"G4 P0.08\n"), RIG)
    assert "add WAIT MOVEDONE X Y A B and 'Enable Aa' and 'BRAKE Aa 0'" in found.remedy


@pytest.mark.parametrize("printer", [RIG, AUTOMATION1], ids=["a3200", "automation1"])
def test_head_lowered_before_its_way_across_is_refused(printer):
    away = PLACE + [0.0, 10.0, 0.0]  # of the start, so that the way in leads through gel
    lines = job(printer, away).decode().splitlines(keepends=True)
    count = 0
    for at, (across, down) in enumerate(pairwise(lines)):
        if re.match(r"G1 X.*", across) and re.match(r"G1 [AB]", down):
            swapped = [*lines[:at], down, across, *lines[at + 2 :]]
            names = [one.check for one in refused("".join(swapped).encode(), printer)]
            assert any("lowest idle tip" in name for name in names)
            count += 1
    assert count >= 2


@pytest.mark.parametrize(("seconds", "passes"), [(1.0, True), (1.09, False), (40, False)])
def test_long_dwell_with_a_valve_open_is_refused(seconds, passes):
    gcode = job(RIG).replace(b"BRAKE Ab 0\n", b"BRAKE Ab 0\nG4 P%g\n" % seconds, 1)
    names = [one.check for one in refused(gcode, RIG)]
    wanted = "head 1 (venous): dwells with the valve open beyond its delay + 1 s"
    assert names == ([] if passes else [wanted])


def test_pressure_s_function_is_asked_for_unless_the_file_defines_it():
    def asked(printer):
        checks = gcode_checks(dry_run(job(printer), printer, START), printer)
        assert not any(one.refuses for one in checks)
        return [one for one in checks if "setPress" in one.remedy]

    assert len(asked(RIG)) == 1
    data = RIG.model_dump()
    body = ["M2", "DFS setPress", 'FILEWRITE $hFile "{#H}"', "ENDDFS"]
    data["file_controller"]["ends"] = body
    assert not asked(Printer.model_validate(data))
    data["file_controller"]["ends"] = [*body, "G1 X5"]
    with pytest.raises(ValueError, match="no word that is known to move nothing"):
        Printer.model_validate(data)


def test_line_that_ends_the_program_is_refused_before_the_last_move():
    data = RIG.model_dump()
    data["file_controller"] |= {"begins": ["ROUNDING ON"], "ends": ["ROUNDING ON", "M2"]}
    printer = Printer.model_validate(data)
    gcode = job(printer)
    assert not refused(gcode, printer)
    assert not refused(gcode.replace(b"\n//RELOAD", b"\nROUNDING ON", 1), printer)
    (found,) = refused(gcode.replace(b"\n//RELOAD", b"\nM2", 1), printer)
    assert "'M2': stands behind the last move alone" in found.remedy


def test_head_that_writes_nothing_stays_up():
    network = three_tubes()
    options = EmbeddedOptions(needle_inner_mm=0.2, needle_outer_mm=0.4)
    heads = EmbeddedHeads((options, options), np.zeros(3, dtype=np.int64))
    held = HeadLoad(load(Syringe, "hamilton_1ml"), flow_ul_s=FLOW_UL_S)
    given = GcodeOptions(start_mm=(0.0, 0.0, 9.0), heads=(held, held))
    path = plan_embedded(network, heads).toolpath
    gcode = write_gcode(path, RIG, held.syringe, PLACE, given).data
    lines = gcode.decode().splitlines()
    moves = [line for line in lines if line.startswith(("G1", "G92"))]
    assert [line.split()[0] for line in moves[:3]] == ["G92", "G92", "G1"]
    assert moves[2].startswith("G1 B")
    run = dry_run(gcode, RIG, (0.0, 0.0, 9.0))
    assert not [one for one in [*gcode_checks(run, RIG), *head_checks(run, RIG)] if one.refuses]
    assert not run.of_head(1).valve.is_open.any()


def test_head_that_changes_between_two_heights_is_refused():
    gcode = job(RIG).replace(b"G1 A60", b"G1 A50")
    run = dry_run(gcode, RIG, START)
    assert any("never stood at one height" in one.message for one in run.findings)


def of_pins() -> Printer:
    """Return the Duet's heads on output pins that have names, with a scale in kPa."""
    data = DUET.model_dump() | {"firmware": "klipper"}
    for number, one in enumerate((data, data["heads"][1])):
        one["dispenser"] |= {
            "opens": f"SET_PIN PIN=valve{number} VALUE=1",
            "closes": f"SET_PIN PIN=valve{number} VALUE=0",
            "sets_pressure": (f"SET_PIN PIN=air{number} VALUE={{kpa}}",),
        }
    for number, head in enumerate(data["heads"]):
        head["raises"] = f"SET_PIN PIN=lift{number} VALUE=1"
        head["lowers"] = f"SET_PIN PIN=lift{number} VALUE=0"
    return Printer.model_validate(data | {"idle_timeout_s": 600})


def duet_job(printer: Printer = DUET) -> bytes:
    """Return the same job for a printer that takes lines, whose two heads share one Z."""
    return job(printer, np.array([60.0, 60.0, 4.0]))


@pytest.mark.parametrize("printer", [DUET, of_pins()], ids=["by number", "by name"])
def test_valves_and_pressures_on_a_printer_that_takes_lines(printer):
    gcode = duet_job(printer)
    run = dry_run(gcode, printer, START)
    checks = [*gcode_checks(run, printer), *head_checks(run, printer)]
    assert not run.unknown
    assert not [one for one in checks if one.refuses]
    assert [one.value for one in checks if "pressure at valve" in one.check] == [60, 80]
    assert all(np.isfinite([one.value, one.limit]).all() for one in checks)  # a report is JSON
    assert np.count_nonzero(np.diff(run.program.tool)) in (1, 2)
    lines = gcode.decode().splitlines()
    assert not any(line.startswith(("T", "G10", "ACTIVATE")) for line in lines)
    tips = run.of_head(1)
    writes = tips.valve.is_open & (tips.program.kind == MOVE)
    ends = tips.program.target[writes, 0]  # of the vein, by a tip that stands 40 mm aside
    assert np.minimum(abs(ends - 62), abs(ends - 74)).max() < 0.01


def layered_job(printer: Printer) -> bytes:
    """Return layers of a block of which the right head writes one half."""
    sides = [Region(as_solid(block(6, 6, 3).translate([4, -1, -1])), Filling(), 1)]
    options = FreshOptions(layer_height_mm=0.3, line_width_mm=0.4)
    path = plan_fresh(as_solid(block(8, 4, 0.9)), options, sides, [options]).toolpath
    held = HeadLoad(load(Syringe, "hamilton_1ml"), flow_ul_s=1.0)
    given = GcodeOptions(start_mm=START, heads=(held, held))
    return write_gcode(path, printer, held.syringe, np.array([60.0, 60.0, 4.0]), given).data


def fixed() -> Printer:
    """Return the Duet's heads without their lifts."""
    data = DUET.model_dump()
    data["heads"] = [
        {key: value for key, value in head.items() if key in ("name", "offset_mm", "dispenser")}
        for head in data["heads"]
    ]
    return Printer.model_validate(data)


@pytest.mark.parametrize("printer", [DUET, fixed()], ids=["lifted", "fixed"])
def test_way_across_is_of_the_head_that_makes_it(printer):
    gcode = layered_job(printer)
    run = dry_run(gcode, printer, START)
    refused = [one for one in [*gcode_checks(run, printer), *head_checks(run, printer)]
               if one.refuses]  # fmt: skip
    beside = [one for one in refused if "vs. the print" in one.check]
    assert beside == refused  # a fixed tip stands beside what the other one writes
    assert bool(beside) is (printer.heads[0].raises is None)
    assert np.count_nonzero(np.diff(run.program.tool)) == 3  # three layers: 01 10 01
    for number in (0, 1):
        head = run.of_head(number)
        low, high = 60.0 + 4.0 * number, 64.0 + 4.0 * number
        at = head.program.target[(head.program.kind == MOVE), 0][2:]  # the first ones come in
        assert low - 0.5 < at.min() < at.max() < high + 0.5


def test_ink_of_each_valve_lies_below_its_own_tip():
    gcode = layered_job(DUET)
    motions = valves_as_plungers(dry_run(gcode, DUET, START).executed, gcode, DUET, [1.0, 1.0])
    whole = 8 * 4 * 0.9
    for number, motion in enumerate(motions):
        writes = (motion.plunger_end > motion.plunger_start) & (motion.end != motion.start).any(1)
        at = motion.end[writes, 0]
        assert 60.0 + 4.0 * number < at.min() < at.max() < 64.0 + 4.0 * number
        dose = (motion.plunger_end - motion.plunger_start)[writes].sum()
        assert dose == pytest.approx(whole / 2, rel=0.15)


def test_valve_waits_for_its_pressure():
    def hasty(gcode: bytes) -> list[str]:
        checks = gcode_checks(dry_run(gcode, DUET, START), DUET)
        return [one.check for one in checks if "settled" in one.check and not one.passed]

    gcode = duet_job()
    assert not hasty(gcode)
    late = gcode.replace(b"M42 P1 S1", b"M42 P3 S0.14\nM42 P3 S0.16\nM42 P1 S1")
    assert hasty(late) == ["head 1: valve opened before the pressure settled"]
    assert not hasty(gcode.replace(b"M42 P1 S1", b"M42 P3 S0.16\nM42 P1 S1"))


@pytest.mark.parametrize(
    ("old", "new", "refused"),
    [
        (b"P3 S0.16", b"P3 S0.14", "head 1: pressure at valve opening"),
        (b"P2 S0.02", b"P2 S0.03", "head 0: not at resting pressure while idle"),
        (b"P3 S0.16", b"P3 S0.16 F100", "head 1: pressure at valve opening"),
        (b"M42 P1 S1", b"M42 P3 S0.9\nM42 P1 S1", "head 1: highest pressure set"),
        (b"M42 P1 S1", b"M42 P0 S1\nM42 P1 S1", "head 0 (left): valve open at the end"),
    ],
)
def test_air_that_is_not_the_profile_s_is_refused_there_too(old, new, refused):
    run = dry_run(duet_job().replace(old, new), DUET, START)
    checks = [*gcode_checks(run, DUET), *head_checks(run, DUET)]
    assert any(one.check.startswith(refused) for one in checks if one.refuses)


@pytest.mark.parametrize(
    ("firmware", "own", "message"),
    [
        ("reprapfirmware", {"sets_pressure": ("M42 P1 S{output}",)}, "switches a valve"),
        ("reprapfirmware", {"sets_pressure": ("M42 P3 S{kpa}", "M42 P5 S1")}, "sends one line"),
        ("reprapfirmware", {"sets_pressure": ("G1 Z{kpa}",)}, "only switches"),
        ("reprapfirmware", {"sets_pressure": ("M42 P2 S{psi}",)}, "same output"),
        ("reprapfirmware", {"sets_pressure": ("M042 p02 S{psi}",)}, "same output"),
        ("reprapfirmware", {"sets_pressure": ("M42 P3 S1{psi}",)}, "write the value alone"),
        ("reprapfirmware", {"sets_pressure": ("M112 P{psi}",)}, "only switches"),
        ("reprapfirmware", {"closes": "M42 P1"}, "two values"),
        ("reprapfirmware", {"opens": "M106 P1 S255", "closes": "M106 P0 S255"}, "differ in P"),
        ("reprapfirmware", {"opens": "M106 S255", "closes": "M107"}, "two values"),
        ("reprapfirmware", {"opens": "M42 P1 P3 S1", "closes": "M42 P1 P3 S0"}, "two values"),
        ("reprapfirmware", {"opens": "M42 P4 S1", "closes": "M42 P4 S0"}, "same output"),
        ("marlin", {}, "60 would be set as 60.78 kPa"),
    ],
)
def test_pressure_that_no_host_can_set_is_refused(firmware, own, message):
    data = DUET.model_dump() | {"firmware": firmware}
    data["heads"][1]["dispenser"] |= own
    with pytest.raises(ValueError, match=message):
        Printer.model_validate(data)


def test_pressure_is_set_by_a_lab_s_call_or_an_analogue_output():
    data = AUTOMATION1.model_dump()
    data["file_controller"] |= {"own_words": ["setPress"], "begins": ["WaitForMotionDone([X, Y])"]}
    for number, head in enumerate((data, data["heads"][1]), start=1):
        own = {"sets_pressure": (f"setPress({number}, {{psi}})",), "resting_kpa": 5}
        head["dispenser"] |= own
    assert Printer.model_validate(data).airs[0].port != Printer.model_validate(data).airs[1].port
    data["heads"][1]["dispenser"]["sets_pressure"] = ("setPress(1, {psi})",)
    with pytest.raises(ValueError, match="set the same output"):
        Printer.model_validate(data)
    data["heads"][1]["dispenser"]["sets_pressure"] = ("AnalogOutputSet(X, 0, {bar})",)
    assert Printer.model_validate(data)
    data = RIG.model_dump()
    data["dispenser"]["sets_pressure"] = ("$AO[0].X={bar}",)
    data["file_controller"]["begins"] = ["WAIT MOVEDONE X Y"]
    assert Printer.model_validate(data)


def test_stop_s_commands_leave_valves_and_pressures_alone():
    for command in ("M42 P2 S1", "M42 P00 S1", "M42 P4 S0"):
        with pytest.raises(ValueError, match="which a stop leaves safe by itself"):
            Printer.model_validate(DUET.model_dump() | {"safe_state_off": (command,)})
    assert Printer.model_validate(DUET.model_dump() | {"safe_state_off": ("M42 P0 S0",)})
    fan = DUET.model_dump() | {"safe_state_off": ("M107 P2",)}
    fan["dispenser"] |= {"opens": "M106 P2 S255", "closes": "M106 P2 S0"}
    with pytest.raises(ValueError, match="which a stop leaves safe by itself"):
        Printer.model_validate(fan)


@pytest.mark.parametrize(
    ("own", "message"), [({"z_axis": "U"}, "z_axis is for"), ({"select": "T1"}, "select is for")]
)
def test_head_with_a_valve_has_no_tool_and_shares_the_vertical_axis(own, message):
    data = DUET.model_dump()
    data["heads"][1].update(own)
    with pytest.raises(ValueError, match=message):
        Printer.model_validate(data)


CALL = "Call setPress P$COM Q$AP"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"heads": [{"z_axis": "A"}, {}]}, "another letter"),
        ({"heads": [{}, {"z_axis": "A"}]}, "another letter"),
        ({"heads": [{"select": "T0"}, {}]}, "select is for plungers"),
        ({"heads": [{}, {"dispenser": None}]}, "same output"),
        ({"file_controller": {"begins": ["G1 X5"]}}, "no word that is known to move nothing"),
        ({"file_controller": {"begins": ["Enable Aa ; G1"]}}, "holds a comment"),
        ({"file_controller": {"begins": ["Enable X Aa"]}}, "may let the brake go"),
        ({"dispenser": {"enables": "G1 X5"}}, "no word that is known to move nothing"),
        ({"file_controller": {"begins": ["ROUNDING ON G1 X5"]}}, "a second command, 'G1'"),
        ({"file_controller": {"ends": ["$X=1 BRAKE Ab 0"]}}, "a second command, 'BRAKE'"),
        ({"dispenser": {"enables": "Enable Aa BRAKE Ab 0"}}, "a second command, 'BRAKE'"),
        ({"dispenser": {"sets_pressure": ["$AP={mmhg}"]}}, "another value than it may have"),
        ({"dispenser": {"sets_pressure": ["$AP={psi}{psi}"]}}, "the value alone"),
        ({"dispenser": {"sets_pressure": ["$AP={psi}", "BRAKE Ab 0"]}}, "to move nothing"),
        ({"file_controller": {"begins": ["Call moveEverything"]}}, "to move nothing"),
        ({"file_controller": {"ends": ["BRAKE Ab 0"]}}, "to move nothing"),
        ({"heads": [{}, {"offset_mm": {"x": 103.0, "z": 2.0}}]}, "leave z out"),
        (
            {"dispenser": {"opens": "BRAKE Ab 1", "closes": "BRAKE Ab 0", "enables": None}},
            "same output",
        ),
        ({"dispenser": {"resting_kpa": None}}, "belong together"),
        ({"dispenser": {"resting_kpa": 90.0}}, "above pressure_kpa"),
        ({"heads": [{}, {"offset_mm": {}}]}, "would stand on each other"),
        ({"dispenser": {"sets_pressure": ["$AP={psi}", CALL]}}, r"takes \$COM, which no line"),
        ({"dispenser": {"sets_pressure": ["$COM=2", CALL, "$AP={psi}"]}}, r"takes \$AP, which no"),
        ({"dispenser": {"sets_pressure": ["$AP={psi}", "M2"]}}, "ends the program"),
        ({"dispenser": {"enables": "Enable Ab"}}, "more or else than the axis"),
        ({"dispenser": {"enables": "Enable Aa Ab"}}, "more or else than the axis"),
        ({"dispenser": {"opens": "$DO[0].X=1", "closes": "$DO[0].X=0"}}, "a valve on an output"),
        ({"file_controller": {"begins": ["Call setPress P2 Q40"]}}, "that nobody checks"),
        ({"file_controller": {"ends": ["setPress(2, 40)"]}}, "that nobody checks"),
        ({"dispenser": {"sets_pressure": ["Enable Aa", "$AP={psi}"]}}, "may let the brake go"),
        ({"file_controller": {"begins": ["ENABLE ALL"]}}, "may let the brake go"),
        ({"file_controller": {"begins": ["ENABLE @$AX"]}}, "may let the brake go"),
        ({"dispenser": {"opens": "BRAKE B 0", "closes": "BRAKE B 1"}}, "an axis that moves"),
        ({"dispenser": {"sets_pressure": ["$AP=1{psi}"]}}, "the value alone"),
        ({"dispenser": {"sets_pressure": ["$AP={psi} * 10"]}}, "the value alone"),
        ({"file_controller": {"begins": ["M2"]}}, "ends the program; write it in ends alone"),
        ({"file_controller": {"ends": ["DFS setPress", "ENDDFS"]}}, "program would run into"),
        ({"file_controller": {"ends": ["M2", "DFS setPress"]}}, "program would run into"),
        ({"file_controller": {"ends": ["M2", "DFS other", "ENDDFS"]}}, "program would run into"),
        *(
            ({"file_controller": {"own_words": ["setPress", word]}}, f"own_words: '{word}' is or")
            for word in ("BRAKE", "HOME", "G91", "M2", "Wait", "MoveLinear")
        ),
    ],
)
def test_profile_of_heads_that_contradict_each_other_is_refused(change, message):
    data = RIG.model_dump()
    for key, value in change.items():
        if key == "heads":
            for head, own in zip(data["heads"], value, strict=True):
                head |= own
        else:
            data[key] |= value
    if change.get("heads", [{}])[0].get("z_axis") == "A":
        data["heads"][1]["z_axis"] = "A"
    with pytest.raises(ValueError, match=message):
        Printer.model_validate(data)
