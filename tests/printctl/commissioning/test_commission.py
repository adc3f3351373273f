"""`printctl commission`: the whole path on simulated printers, resumed, and its checks."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from firmware_profiles import Ink, Printer, load
from printctl.commissioning.state import Commission
from printctl.commissioning.steps import KEYS
from printctl.machine.errors import LinkError
from printctl.machine.process.clients.client import attach_station
from printctl.machine.process.contact import usual_folder
from printctl.machine.records.mounting import load_mounting
from printctl.recipe import load_recipe
from tests.sim_process import printer_process
from tests.system.cli import called

DOSES_UL = (20.0, 40.0, 60.0) * 4


@dataclass
class Lab:
    """A folder with an empty store, in which a person works by the command line."""

    folder: Path

    def commission(self, *words: str, fails: str = "", code: int = 0) -> Any:
        """Run it; it must end with the code, and a message that has the words of ``fails``."""
        done = called("commission", "--json", *words, cwd=self.folder)
        assert done.returncode == code, done.stdout + done.stderr
        told = json.loads(done.stdout)
        message = told.get("error", {}).get("message", "")
        assert fails in " ".join(message.split()), done.stdout
        return told

    def fails(self, words: str, *options: str, code: int = 1) -> None:
        """Have a check fail with these words."""
        self.commission(*options, fails=words, code=code)

    def waits(self, words: str, *options: str) -> None:
        """Have it wait for an answer to this question."""
        self.commission(*options, fails=words, code=2)

    @property
    def mine(self) -> Printer:
        """The printer's own profile."""
        return load(Printer, str(self.folder / "my_printer.yaml"))

    def facts(self, step: str) -> dict[str, Any]:
        """What a step has recorded."""
        return Commission.load(str(self.folder / "my_printer.yaml")).step(step).facts


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    yield Lab(tmp_path)
    with suppress(LinkError):
        attach_station(usual_folder()).close()


def masses(times: float) -> str:
    """Masses of the doses, mg, when so many times the commanded volume comes; 0.4 µL stay."""
    noise = (0.02, -0.02, 0.0)
    rows = (times * ul * 0.998 - 0.4 + noise[k % 3] for k, ul in enumerate(DOSES_UL))
    return "masses=" + ",".join(f"{mass:.2f}" for mass in rows)


def with_thin_lines(sheet: Path) -> Path:
    """Fill a sheet in; the lines with most ink are half as wide as expected."""
    filled = sheet.parent / "typed.csv"
    rows = []
    for row in sheet.read_text().splitlines():
        cells = row.split(",")
        if cells[0].isdecimal():
            row += f"{float(cells[-2]) * (0.5 if cells[3] == '1.2' else 1.0):.4f}"
        rows.append(row)
    filled.write_text("\n".join(rows) + "\n")
    return filled


def test_the_whole_path_goes_on_after_aborts_and_catches_each_mistake(lab: Lab) -> None:
    work = lab.folder / "my_printer_commission"
    told = lab.commission("--port", "simulated", "--yes", "--until", "parts")
    assert "moves get at most one plunger step" in told["steps"][3]["message"]
    assert told["next"] == "touch-off"
    lab.fails("Invert Z in the firmware", "--yes", "--answer", "moved_z=down")
    assert "jogged_z" not in lab.facts("touch-off")  # it jogs again, once that is corrected
    lab.fails("differ by 0.100 mm, limit 0.05", "--yes", "--answer", "heights=0,0,0.1")
    lab.fails("given with the wrong sign", "--yes", "--answer", "height=-5")
    told = lab.commission("--status")
    states = {one["key"]: one["state"] for one in told["steps"]}
    assert states == dict.fromkeys(KEYS, "open") | dict.fromkeys(KEYS[:4], "done") | {
        "touch-off": "failed"
    }
    lab.fails("none.csv doesn't exist", "--yes", "--answer", "widths=none.csv")
    journal = work / "lines.print" / "journal.log"
    printed = journal.stat().st_mtime_ns
    typed = with_thin_lines(work / "lines.csv")
    lab.fails("the widths don't rise with the ink", "--yes", "--answer", f"widths={typed}")
    told = lab.commission("--yes")
    assert journal.stat().st_mtime_ns == printed  # it was read again, not printed again
    assert told["done"]
    # What it leaves behind: a profile, an ink, what is mounted, a correction that a recipe takes.
    assert lab.mine.steps_per_mm.e == 6400
    mounted = load_mounting(str(lab.folder / "my_printer.yaml")).parts
    assert (mounted.needle, mounted.dish) == ("fresh_150um", "petri_60mm")
    assert load(Ink, mounted.ink).flow_factor == pytest.approx(1.0, abs=0.01)
    assert lab.facts("scan")["passed"]
    corrected = load_recipe(Path(lab.facts("correction")["recipe"]))
    assert corrected.toolpath.compensation == "compensation.yaml"
    assert corrected.solid.fiducials
    lab.fails("there is no step 'colour'; the steps are", "--from", "colour", code=2)
    told = lab.commission("--from", "scan", "--status")
    assert told["next"] == "scan"


def test_steps_are_weighed_sent_stored_and_read_back(lab: Lab) -> None:
    values = load(Printer, "generic_marlin").model_dump(mode="json", exclude_unset=True)
    values["steps_per_mm"]["e"], values["max_speed_mm_s"]["x"] = 6300.0, 90.0
    (lab.folder / "board.yaml").write_text(yaml.safe_dump(values))
    with printer_process(lab.folder, "--printer", str(lab.folder / "board.yaml")) as port:
        begin = ("--port", port, "--yes", "--until", "steps")
        # The firmware's reply proposes the profile; of a real printer a person names the syringe.
        lab.waits("Which syringe is mounted", *begin)
        assert (lab.mine.steps_per_mm.e, lab.mine.max_speed_mm_s.x) == (6300, 90)
        begin += ("--answer", "syringe=hamilton_1ml")
        lab.waits("Which way did the plunger move", *begin)
        lab.fails("E has the wrong sign", *begin, "--answer", "plunger_moved=backward")
        lab.waits("Masses of the 12 doses", *begin, "--answer", "plunger_moved=forward")
        lab.fails("isn't accepted (limit 20%)", *begin, "--answer", masses(2.0))
        lab.fails("the masses can't be used", *begin, "--answer", masses(-1.0))
        assert lab.mine.steps_per_mm.e == 6300
        told = lab.commission(*begin, "--answer", masses(1.05))
        steps = lab.mine.steps_per_mm.e
        assert steps == pytest.approx(6300 / 1.05, rel=2e-3)
        assert f"6300.00 to {steps:.2f} steps/mm (-4.7%)" in told["steps"][2]["message"]
        # Asked by another door, the board has them, and its G92 isn't taken for other limits.
        told = lab.commission("--yes", "--from", "connection", "--until", "connection")
        assert "0 differed" in told["steps"][1]["message"]
        assert lab.mine.x_mm == load(Printer, "generic_marlin").x_mm
        assert lab.mine.steps_per_mm.e == steps


def test_nothing_moves_unasked_and_nothing_hangs(lab: Lab) -> None:
    lab.waits("Port: a device", "--answer", "profile=generic_marlin")
    chosen = ("--answer", "profile=generic_marlin", "--answer", "syringe=hamilton_1ml")
    lab.waits("Push 10 µL? The plunger moves 0.60 mm", "--port", "simulated", *chosen)
    lab.fails("isn't KEY=VALUE", "--answer", "needle", code=2)
    lab.fails("neither a .yaml file nor a shipped profile", "--printer", "mine", code=2)


def test_what_cannot_be_commissioned_is_told_where_to_go(lab: Lab) -> None:
    lab.fails("runs files by itself", "--port", "moonraker://x:1")
    lab.fails("is no answer", "--port", "simulated", "--answer", "profile=pneumatic_marlin", code=2)


def test_an_answer_that_cannot_be_used_is_asked_for_again(lab: Lab) -> None:
    begin = ("--port", "simulated", "--yes", "--until", "parts")
    lab.fails("no syringe profile 'BD 5 ml'", *begin, "--answer", "syringe=BD 5 ml")
    full = ("--answer", "syringe=bd_1ml", "--answer", "fill_ul=9000")
    lab.fails("BD Plastipak 1 mL holds 1000", *begin, *full)
    deep = ("--answer", "fill_ul=900", "--answer", "bath_depth=80")
    lab.fails("bath depth 80 mm isn't between 0 and 12 mm", *begin, *deep)
    lab.commission(*begin)
    mounted = load_mounting(str(lab.folder / "my_printer.yaml")).parts
    assert (mounted.syringe, mounted.bath_depth_mm) == ("bd_1ml", 8.0)


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
def test_on_a_terminal_it_is_asked_for_at_once(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    chosen = ("--port", "simulated", "--answer", "profile=generic_marlin")
    main, terminal = os.openpty()
    os.write(main, b"BD 5 ml\nbd_5ml\nno\n")
    with os.fdopen(terminal) as typed:
        monkeypatch.setattr(sys, "stdin", typed)
        done = called("commission", *chosen, cwd=lab.folder)
    os.close(main)
    assert done.stderr.count("Which syringe is mounted") == 2
    assert "no syringe profile 'BD 5 ml'; shipped: bd_10ml" in done.stderr
    assert "not confirmed, and nothing was done: Push 20 µL?" in " ".join(done.stderr.split())


def test_another_port_is_taken_and_its_firmware_compared(lab: Lab) -> None:
    begin = ("--yes", "--until", "steps", "--answer", "profile=generic_marlin")
    with printer_process(lab.folder) as port:
        lab.waits("Which syringe is mounted", "--port", port, *begin)
    (lab.folder / "socket").mkdir()
    with printer_process(lab.folder / "socket") as other:
        told = lab.commission("--port", other, "--yes", "--until", "connection")
        assert told["port"] == other
        assert told["steps"][1]["state"] == "done"


def test_a_tip_outside_the_dish_is_refused(lab: Lab) -> None:
    lab.commission("--port", "simulated", "--yes", "--until", "parts")
    attach_station(usual_folder()).close()
    with printer_process(lab.folder) as port:
        begin = ("--port", port, "--yes", "--until", "touch-off")
        away = (*begin, "--answer", "tip=0,0,15")
        lab.fails("0,0 isn't above the middle of Round dish, 60 mm, which was entered as", *away)
        lab.waits("Where is it, X,Y,Z in mm", *begin)
