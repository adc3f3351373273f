"""`printctl pause`, `resume`, `reload`, `status`, `alive` over a real pseudo-terminal."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner, Result

from benchmarks.checkers.dish_camera import photograph
from firmware_profiles import Printer, load
from gcode.dry_run.run import dry_run
from printctl.calibration.patterns import Pattern, PatternSetUp, WrittenPattern, read_pattern
from printctl.cli.machine import print_job, running_print
from printctl.cli.machine.running_print import (
    cancel,
    emergency_stop,
    pause,
    recover,
    reload,
    resume,
    status,
)
from printctl.cli.machine.running_print import confirm_presence as alive
from printctl.cli.main import app
from printctl.errors import PrintctlError, SafetyError, UsageError
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.care import Care
from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.clients.starting import start_print
from printctl.machine.process.orders import Order
from printctl.machine.records.states import LinkState, Status
from registration.devices.camera_frame import read_frame, write_insert
from registration.devices.lens import write_lens
from registration.devices.lens.lens import write_model
from registration.errors import PictureError
from tests.printctl.cli.shell import Shell
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer, zigzag
from tests.printctl.machine.link.layered import layered
from tests.registration.devices.camera_frame import scene
from tests.waiting import wait_for


def until(client: PrintClient, state: LinkState) -> None:
    wait_for(lambda: client.status.state is state, told=lambda: client.status)


def begun(folder: Path, profile: str, port: str) -> PrintClient:
    """A print of ``folder``/job.gcode, as a user's recipe would run it."""
    job = folder / "job.gcode"
    job.write_bytes(layered(4, 60))
    care = Care(checkpoint_s=0.0, syringe="hamilton_1ml", capacity_mm=58.0, deadman_s=600.0)
    return start_print(Order(job, profile, port, folder / "job.gcode.print", care=care))


def test_the_only_print_that_goes_on_needs_no_name(tmp_path, profile, capsys, monkeypatch):
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    shell = Shell(monkeypatch, capsys)
    shell.refuses("no print of yours is going on; name the RUN that is meant", "emergency-stop")
    with pty_printer(FakeMarlin(), hold_at=40) as served:
        client = begun(tmp_path, profile, served.name)
        assert served.held.wait(10)
        wait_for((tmp_path / "data" / "journals.txt").exists)
        assert shell.json("status")["state"] == "printing"
        with pytest.MonkeyPatch.context() as patch:
            two = [tmp_path / "job.gcode.print"] * 2
            patch.setattr("printctl.machine.prints.state.known_folders", lambda data: two)
            shell.refuses("2 prints are going on", "cancel")
        assert shell("pause")[0] == 0
        served.gate.set()
        until(client, LinkState.PAUSED)
        code, out, err = shell("stop")
        assert (code, out.startswith("cancelled")) == (0, True), out
        assert "`printctl emergency-stop`" in err
        client.detach()


def test_print_is_held_at_a_layer_then_gets_a_new_syringe(tmp_path, profile, capsys):
    with pty_printer(FakeMarlin(), hold_at=40) as served:
        client = begun(tmp_path, profile, served.name)
        run = tmp_path / "job.gcode"
        assert served.held.wait(10)
        with pytest.raises(PrintctlError, match=r"isn't paused \(printing"):
            resume(run)
        pause(run, "layer")
        with pytest.raises(LinkError, match="has no end of a vessel"):
            pause(run, "vessel")
        alive(run)
        served.gate.set()
        until(client, LinkState.PAUSED)
        pause(run)
        status(run)
        said = capsys.readouterr().out
        assert "already paused" in said
        assert "will pause at the end of this layer" in said
        assert "confirm again within 10.0 min" in said
        assert "paused: paused at the end of layer 1, reload point" in said
        reload(run)
        while client.status.waits_for != "syringe":
            time.sleep(0.02)
        with pytest.raises(LinkError, match="paused for a syringe change"):
            resume(run)
        with pytest.raises(UsageError, match=r"bore of 7\.28 mm"):
            resume(run, syringe="hamilton_2_5ml")
        with pytest.raises(Refused, match=r"not resumed: lines .* the syringe has -2\.00 mm left"):
            resume(run, plunger_mm=60.0)
        assert client.status.waits_for == "syringe"
        resume(run, plunger_mm=1.5)
        assert client.wait(300).state is LinkState.DONE
        sent = served.printer.numbered
    assert any(line.startswith("G92 E") for line in sent[40:])
    with pytest.raises(PrintctlError, match=r"has ended \(done"):
        pause(run)
    with pytest.raises(PrintctlError, match=r"was done; there is nothing to recover"):
        recover(run)


@pytest.mark.parametrize("after", [None, "layer"])
def test_pause_of_a_print_that_is_pausing_says_so(monkeypatch, capsys, after):
    client = MagicMock()
    client.__enter__.return_value = client
    client.status = Status(LinkState.PAUSING)
    monkeypatch.setattr(running_print, "running_print", lambda run: client)
    pause(Path("run"), after)
    assert capsys.readouterr().out.startswith("already pausing; `printctl status run`")
    client.pause.assert_not_called()


def test_status_of_a_print_that_waits_for_a_layer_is_json(tmp_path, profile, capsys):
    with pty_printer(FakeMarlin(), hold_at=40) as served:
        client = begun(tmp_path, profile, served.name)
        assert served.held.wait(10)
        pause(tmp_path / "job.gcode.print", "layer")
        capsys.readouterr()
        status(tmp_path / "job.gcode.print", as_json=True)
        found = yaml.safe_load(capsys.readouterr().out)
        assert found["waits_for"] == "pause after layer"
        assert 590 < found["deadman_left_s"] <= 600
        client.stop()
        served.gate.set()
        assert client.wait(300).state is LinkState.STOPPED


@pytest.mark.parametrize(
    ("end", "state", "told"),
    [
        (cancel, LinkState.STOPPED, "cancelled: "),
        (emergency_stop, LinkState.KILLED, "halted: emergency stop by"),
    ],
)
def test_print_is_ended_from_another_terminal(tmp_path, profile, capsys, end, state, told):
    with pty_printer(FakeMarlin(), hold_at=40) as served:
        client = begun(tmp_path, profile, served.name)
        assert served.held.wait(10)
        served.gate.set()
        end(tmp_path / "job.gcode")
        assert client.wait(300).state is state
    assert told in capsys.readouterr().out


def test_a_cancel_that_takes_long_says_that_it_is_requested(tmp_path, profile, capsys, monkeypatch):
    monkeypatch.setattr("printctl.cli.machine.running_print.STOP_S", 0.1)
    with pty_printer(FakeMarlin(), hold_at=40) as served:
        client = begun(tmp_path, profile, served.name)
        assert served.held.wait(10)
        cancel(tmp_path / "job.gcode")
        served.gate.set()
        assert client.wait(300).state is LinkState.STOPPED
    said = capsys.readouterr().out
    assert "cancelling is requested" in said
    assert "reports the end" in said


def test_file_that_was_never_printed_is_told(tmp_path):
    (tmp_path / "job.gcode").write_text("G90")
    for place in (tmp_path / "job.gcode", tmp_path, tmp_path / "nowhere"):
        with pytest.raises(LinkError, match="no print was started in"):
            status(place)


def test_rest_of_a_print_that_lost_its_position_is_written_when_confirmed(
    tmp_path, profile, capsys
):
    printer = FakeMarlin()
    printer.reset_at = 190
    job, rest = tmp_path / "job.gcode", tmp_path / "job.rest.gcode"
    with pty_printer(printer, hold_at=40) as served:
        client = begun(tmp_path, profile, served.name)
        assert served.held.wait(10)
        with pytest.raises(PrintctlError, match="nothing to recover"):
            recover(job, yes=True)
        served.gate.set()
        assert client.wait(300).state is LinkState.POSITION_UNKNOWN
    with pytest.raises(SafetyError, match="wasn't written"):
        recover(job)
    assert not rest.exists()
    recover(job, yes=True)
    said = capsys.readouterr()
    assert "1. Lift the needle out before anything else moves" in said.err
    assert f"printctl print {rest} --printer {profile}" in said.out
    assert "--start 50,50,10" in said.out
    assert rest.read_bytes().endswith(b";LAYER_END:3\n;RELOAD\nM400\n")
    job.write_bytes(job.read_bytes() + b"M105\n")
    with pytest.raises(PrintctlError, match="has changed since it was printed"):
        recover(job, yes=True)


def test_request_that_cant_be_granted_is_the_users_mistake_not_the_printers(profile, shell: Shell):
    job = Path("job.gcode")
    job.write_bytes(b"\n".join([b"G92 E0", *zigzag(300)]) + b"\n")
    with pty_printer(FakeMarlin(), hold_at=40) as served:
        client = start_print(Order(job, profile, served.name, Path("job.gcode.print")))
        assert served.held.wait(10)
        for words, why in (
            (("pause", "job.gcode", "--after", "vessel"), "has no end of a vessel"),
            (("reload", "job.gcode"), ("has no safe reload point", "then `printctl reload RUN`")),
            (("resume", "job.gcode", "--plunger-mm", "0"), "isn't paused for a syringe change"),
        ):
            shell.refuses(why, *words, code=1)
        served.gate.set()
        assert client.wait(300).state is LinkState.DONE
    shell.refuses("has ended (done", "resume", "job.gcode", code=1)


# --- print disturbed by another program's commands: not reported as proven complete
JOB = "M85 S600\nM302 P1\nG90\nM82\nG1 X1 Y5 E0.1 F600\nG1 X2 Y5 E0.2 F600\nG0 Z5 F200\n"


@pytest.mark.parametrize(("known", "code"), [(True, 0), (False, 1)])
def test_exit_code_tells_it(shell: Shell, known: bool, code: int) -> None:
    ended = Status(LinkState.DONE, 6, 6, message="all 6 lines done", position_known=known)
    shell.monkeypatch.setattr(print_job, "_print", lambda *given: ended)
    Path("job.gcode").write_text(JOB)
    words = ("print", "job.gcode", "--printer", "generic_marlin", "--port", "simulated", "--json")
    found, out, _ = shell(*words)
    told = json.loads(out)
    assert (found, told["state"], told["proved"]) == (code, "done", known)


@pytest.mark.parametrize("state", [LinkState.FAILED, LinkState.STOPPED])
def test_only_a_print_that_is_done_is_proved(state: LinkState) -> None:
    assert not Status(state, 6, 6).proved


# --- `printctl observe` from insert to check, by painted pictures
def observe(*words: str | Path) -> Result:
    return CliRunner().invoke(app, ["observe", *map(str, words)], catch_exceptions=False)


def test_an_insert_is_written_with_drawings_and_bodies(tmp_path: Path) -> None:
    out = tmp_path / "insert"
    done = observe("insert", "--dish", "petri_35mm", "--out", out, "--json")
    assert json.loads(done.stdout)["marks"] == 12
    assert sorted(path.name for path in out.iterdir()) == [
        "insert.pdf", "insert.png", "insert.svg", "insert.yaml", "insert_black.stl",
        "insert_white.stl",
    ]  # fmt: skip
    assert yaml.safe_load((out / "insert.yaml").read_text())["process"] == "fdm"
    with pytest.raises(UsageError, match="isn't one of fdm, resin, paper, engraved"):
        observe("insert", "--dish", "petri_35mm", "--made", "clay", "--out", out)


def test_a_frame_is_fitted_and_checked(tmp_path: Path) -> None:
    seen, lens, insert, out = (tmp_path / n for n in ("s.png", "l.yaml", "i.yaml", "f.yaml"))
    assert cv2.imwrite(str(seen), scene.picture())
    write_lens(lens, scene.lens())
    write_insert(insert, scene.insert())
    drawn = {cross.name: (cross.x_mm, cross.y_mm) for cross in scene.insert().crosses}
    x, y, z = scene.TARGET
    touched = [
        word
        for name in ("left", "right", "back")
        for word in ("--touched", f"{name}={drawn[name][0] + x},{drawn[name][1] + y},{z}")
    ]
    words = ("frame", seen, "--lens", lens, "--insert", insert, "-o", out)
    told = json.loads(observe(*words, *touched, "--json").stdout)
    assert told["tied"] == "touched"
    assert told["u_um"] < 60
    off = read_frame(out).to_printer(scene.optics().pixels(scene.TARGET[None]), z) - [x, y]
    assert abs(off).max() < 0.05
    assert observe("check", seen, "--frame", out).exit_code == 0
    half = tmp_path / "half.png"
    assert cv2.imwrite(str(half), scene.picture()[::2, ::2])
    done = observe("check", half, "--frame", out, "--json")
    assert done.exit_code == 3
    assert not json.loads(done.stdout)["holds"]
    with pytest.raises(UsageError, match="isn't CROSS=X,Y or CROSS=X,Y,Z"):
        observe(*words, "--touched", "left")


@pytest.mark.parametrize("pattern", ["squares", "lines"])
def test_a_camera_is_tied_to_a_print_as_its_files_say(pattern: str, tmp_path: Path) -> None:
    x, y, z = scene.TARGET
    job = tmp_path / "job.gcode"
    words = f"--needle 22g --width 0.4 --dish petri_35mm --at {x},{y},{z} -o {job}".split()
    words += ["--printer", "generic_marlin", "--syringe", "hamilton_1ml", "--ink", "collagen_fresh"]
    if pattern == "lines":
        words += ["--length", "12", "--speeds", "4", "--flow-factors", "1"]
    done = CliRunner().invoke(app, ["calibrate", "pattern", pattern, *words])
    assert done.exit_code == 0, done.output
    lines = [(a - scene.TARGET[:2], b - scene.TARGET[:2], 0.4) for a, b in _written(job)]
    seen, lens, insert, out = (tmp_path / n for n in ("s.png", "l.yaml", "i.yaml", "f.yaml"))
    inked = replace(scene.SCENE, lines=lines)
    assert cv2.imwrite(str(seen), photograph(scene.optics(), scene.made(), inked, 1))
    write_lens(lens, scene.lens())
    write_insert(insert, scene.insert())
    given = ("--lens", lens, "--insert", insert, "-o", out)
    print_of = ("--printed", job.with_suffix(".json"), "--json")
    told = json.loads(observe("frame", seen, *given, *print_of).stdout)
    assert told["tied"] == "printed"
    off = read_frame(out).to_printer(scene.optics().pixels(scene.TARGET[None]), z) - [x, y]
    assert abs(off).max() < 0.02
    low = observe("frame", seen, *given, *print_of, "--at", f"{x + 0.5},{y - 0.4},{z - 1.5}")
    doubted = any("from --at's Z" in note for note in json.loads(low.stdout)["notes"])
    assert doubted == (pattern == "squares")  # a small frame tells no height
    old = tmp_path / "old.json"
    old.write_text(WrittenPattern(*_parts(job.with_suffix(".json"))).as_text())
    with pytest.raises(UsageError, match="doesn't say where it was printed"):
        observe("frame", seen, *given, "--printed", old)


def _written(job: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ends of all straight lines that a job writes."""
    run = dry_run(job.read_bytes(), load(Printer, "generic_marlin"), tuple(scene.TARGET))
    ends = np.vstack([run.program.start[None, :3], run.program.target[:, :3]])
    pushed = np.diff(run.program.plunger, prepend=0) > 0
    rows = np.flatnonzero(pushed & (np.linalg.norm(np.diff(ends, axis=0), axis=1) > 0))
    return [(ends[row, :2], ends[row + 1, :2]) for row in rows]


def _parts(path: Path) -> tuple[Pattern, PatternSetUp]:
    written = read_pattern(path)
    return written.pattern, written.mounted


def test_a_tip_that_isnt_there_is_not_found(tmp_path: Path) -> None:
    seen, frame = tmp_path / "s.png", tmp_path / "f.yaml"
    assert cv2.imwrite(str(seen), scene.picture())
    write_model(frame, scene.frame())
    words = ("tip", seen, "--frame", frame, "--needle", "18g", "--reach-mm", "1")
    with pytest.raises(PictureError, match="tip is not found in any picture"):
        observe(*words, "--at", "100,90,12")
    with pytest.raises(UsageError, match="1 pictures and 2 places"):
        observe(*words, "--at", "100,90,12", "--at", "90,90,12")
