"""Subcommand discovery: only the requested subcommand is imported."""

from __future__ import annotations

import errno
import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from design.solids import block_solid, write_stl
from firmware_profiles import Ink, Needle, Printer, Syringe, load, shipped
from kernels import ahead as listing
from printctl import doctor as places
from printctl.cli import commands, kernels_ready
from printctl.cli.commands import COMMANDS, LazyGroup
from printctl.cli.kernels_ready import have_kernels
from printctl.cli.main import app
from printctl.doctor import extras, permission_findings, udev_rule
from printctl.machine.ports.detection import PortInfo
from printctl.progress_file import ProgressFile
from printctl.system_errors import explain
from printctl.web.detached_runs import read_progress
from tests.printctl.cli.shell import Shell

LOADED = """
import sys
from printctl.cli.main import app
app(["pause", "--help"], standalone_mode=False)
print("registration" in sys.modules)
"""


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_can_be_asked_for_help(name):
    result = CliRunner().invoke(app, [name, "--help"])
    assert result.exit_code == 0, result.output
    assert f" {name} " in result.output


@pytest.mark.parametrize("name", ["flow", "oxygen", "register"])
def test_names_of_options_are_whole_in_a_terminal_of_80_columns(name: str) -> None:
    """--outlet-resistance-mmhg-min… was what the help told."""
    narrow = {"COLUMNS": "80", "TERMINAL_WIDTH": "80"}
    said = CliRunner().invoke(app, [name, "--help"], env=narrow).output
    for param in LazyGroup().get_command(None, name).params:
        names = [*param.opts, *param.secondary_opts]
        assert all(name in said for name in names if name.startswith("-"))
    assert max(map(len, said.splitlines())) <= 80


def test_a_slip_of_the_pen_is_answered_with_what_may_have_been_meant():
    result = CliRunner().invoke(app, ["pauze"])
    assert result.exit_code == 2
    assert "pause" in result.output


def test_pausing_waits_for_no_library_of_another_command():
    done = subprocess.run(
        [sys.executable, "-c", LOADED], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "False"


@pytest.mark.skipif(os.name != "posix", reason="a shell of POSIX closes the streams")
@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_end_no_command_in_a_traceback(closed: str) -> None:
    script = f'"$0" -m printctl doctor --json {closed}; echo "code $?"'
    done = subprocess.run(
        ["sh", "-c", script, sys.executable], capture_output=True, text=True, check=True
    )
    assert "Traceback" not in done.stderr
    assert done.stdout.splitlines()[-1] == "code 0"


# --- bash completion of words, asked as bash asks
ROOT = Path(__file__).parents[3]
IN_BASH = """
eval "$(_PRINTCTL_COMPLETE=source_bash printctl)"
COMP_WORDS=(printctl recipe mi); COMP_CWORD=2
_printctl_completion printctl
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def ask(monkeypatch, capsys):
    """Words that bash would be offered after these; the last, maybe empty, is being typed."""

    def words_after(words: str, variable: str = "complete_bash") -> list[str]:
        monkeypatch.setenv("_PRINTCTL_COMPLETE", variable)
        monkeypatch.setenv("COMP_WORDS", words.replace(" ", "\n"))
        monkeypatch.setenv("COMP_CWORD", str(words.count(" ")))
        capsys.readouterr()
        with pytest.raises(SystemExit):
            app(prog_name="printctl")
        return [line for line in capsys.readouterr().out.splitlines() if line]

    return words_after


def test_commands_are_offered_by_what_they_begin_with(ask):
    assert ask("printctl re") == [name for name in COMMANDS if name.startswith("re")]


@pytest.mark.parametrize(
    ("option", "kind"),
    [("--printer", Printer), ("--syringe", Syringe), ("--ink", Ink), ("--needle", Needle)],
)
def test_shipped_profiles_are_offered(ask, option, kind):
    assert ask(f"printctl slice part.stl {option} ") == list(shipped(kind))


def test_a_file_is_left_to_the_shell(ask):
    assert ask("printctl run exam") == []
    assert ask("printctl slice part.stl --printer ./mi") == []


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash here")
def test_bash_itself_completes(tmp_path: Path):
    command = tmp_path / "printctl"
    script = "from printctl.cli.main import app; app(prog_name='printctl')"
    command.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -c "{script}"\n')
    command.chmod(0o755)
    done = subprocess.run(
        ["bash", "-c", IN_BASH],
        env={**os.environ, "PATH": f"{tmp_path}:/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["migrate"], done.stderr


# --- one JSON object on stdout for a failure of any kind, beside the text on stderr


@pytest.mark.parametrize(
    ("words", "code", "why"),
    [
        (["simulate", "--json"], 2, "file"),
        (["run", "a.yaml", "--jsno", "--json"], 2, "jsno"),
        (["nope", "--json"], 2, "nope"),
        (["simulate", "nix.gcode", "--json"], 2, "nix.gcode can't be read"),
        (["simulate", "a", "--ink", "x", "--ink", "y", "--json"], 2, "twice"),
        (["station", "status", "--folder", "nix", "--json"], 1, "no printer was ever connected"),
        (
            ["print", "a.gcode", "--printer", "generic_marlin", "--port", "/dev/null", "--json"],
            3,
            "syringe: neither named nor mounted on generic_marlin",
        ),
    ],
)
def test_a_failure_is_one_object_with_code_and_message(
    shell: Shell, words: list[str], code: int, why: str
) -> None:
    Path("a.gcode").write_text("G21\nG90\nG1 X1 F600\n")
    ended, out, err = shell(*words)
    error = json.loads(out)["error"]
    assert (ended, error["code"]) == (code, code)
    assert why in error["message"]
    assert err


def test_a_refused_simulation_is_one_object_with_its_checks_and_the_error(shell: Shell) -> None:
    Path("a.gcode").write_text("G21\nG90\nG1 X1000 F600\n")
    ended, out, _ = shell("simulate", "a.gcode", "--json")
    told = json.loads(out)
    assert ended == told["error"]["code"] == 3
    assert "x, highest" in told["error"]["message"]
    assert not told["passed"]


@pytest.mark.parametrize(("raised", "code"), [(KeyboardInterrupt, 130), (ZeroDivisionError, None)])
def test_ctrl_c_and_faults_of_our_own_are_told_too(
    shell: Shell,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    raised: type[BaseException],
    code: int | None,
) -> None:
    def fails(*words: object) -> None:
        raise raised

    monkeypatch.setattr(commands, "import_module", fails)
    if code is None:
        with pytest.raises(ZeroDivisionError):
            shell("doctor", "--json")
        assert json.loads(capsys.readouterr().out)["error"]["code"] == 1
    else:
        ended, out, _ = shell("doctor", "--json")
        assert ended == json.loads(out)["error"]["code"] == code


# --- command-line error messages
def test_full_disk_is_named_with_the_remedy() -> None:
    text = explain(OSError(errno.ENOSPC, "No space left on device", "/runs/a/scan.tif")).message
    assert "disk is full" in text
    assert "/runs/a/scan.tif" in text
    assert "free some space" in text


# --- `printctl profiles show`: copies a shipped profile to a file of one's own
def test_a_shipped_profile_is_copied_to_a_new_file_of_ones_own(shell: Shell) -> None:
    for model, name in ((Printer, "generic_marlin"), (Ink, "collagen_fresh")):
        words = ("profiles", name, "--write", f"{name}.yaml")
        assert shell(*words)[0] == 0
        assert load(model, f"{name}.yaml") == load(model, name)
        shell.refuses("there already", *words)


# --- wrong command-line input: one message, the right exit code, no traceback
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ("pause nothing", 1, "no print was started in nothing"),
        ("pause . --now --after layer", 2, "exclude each other"),
        ("resume .", 1, "no print was started in ."),
        ("status .", 1, "no print was started in ."),
        ("recover nothing", 1, "no print was started in nothing"),
        ("recover .", 1, "no print was started in ."),
        ("history rebuild nowhere", 2, "nowhere is no folder"),
        (
            "calibrate weigh none.csv --printer generic_marlin --syringe bd_1ml",
            2,
            "can't be read: No such file",
        ),
        (
            "calibrate weigh bin.yaml --printer generic_marlin --syringe bd_1ml",
            2,
            "isn't a text file",
        ),
        (
            "calibrate weigh bad.csv --printer generic_marlin --syringe bd_1ml",
            2,
            "line 2: mass_mg is 'abc'",
        ),
        ("profiles check bin.yaml", 2, "isn't YAML"),
        ("profiles check foreign.yaml", 2, "no key of any sort of profile"),
        ("profiles check list.yaml", 2, "holds no keys"),
        ("profiles check needle.yaml", 2, "needle.yaml: name is missing"),
        ("profiles check bad.csv", 2, "ends in .yaml"),
        ("slice nothing.stl --unit mm --out a.gcode", 1, "No such file"),
        ("slice cube.stl --out a.gcode", 2, "doesn't say the unit of its coordinates; give --unit"),
        ("slice cube.stl --unit mm --out .", 2, "is a folder"),
        ("slice cube.stl --unit m --out a.gcode", 2, "2000 mm long in x, more than the 200 mm"),
        ("slice cube.stl --unit um --out a.gcode", 1, "check the part's unit"),
        ("slice bin.yaml --unit mm --out a.gcode", 1, ".yaml isn't one of .stl"),
        ("slice cube.stl --unit mm --out a.gcode --infill gyroid", 1, "meet above 0.7"),
        ("simulate /dev/zero --printer generic_marlin", 2, "it is a device and no regular file"),
        ("simulate . --printer generic_marlin", 2, "it is a folder and no regular file"),
        ("simulate pipe.gcode --printer generic_marlin", 2, "it is a pipe and no regular file"),
        ("lumens pipe.gcode --printer generic_marlin --line-um 400", 2, "it is a pipe and no"),
        ("view pipe.gcode --printer generic_marlin", 2, "it is a pipe and no regular file"),
        ("print pipe.gcode --printer generic_marlin --port simulated", 2, "it is a pipe and no"),
        ("print . --printer generic_marlin --port simulated", 2, ". can't be read: it is a folder"),
        ("simulate nul.gcode --printer generic_marlin", 2, "nul.gcode: line 2 of the G-code has"),
        ("print nul.gcode --printer generic_marlin --port simulated", 2, "nul.gcode: line 2 of"),
        ("view nul.gcode --printer generic_marlin", 2, "nul.gcode: line 2 of the G-code has a NUL"),
        ("print text.gcode --printer generic_marlin --port simulated", 3, "line 1: 'D"),
        ("run r.yaml --out cube.stl", 2, "--out cube.stl: cube.stl is a file; give a folder's"),
        ("simulate a.gcode --out cube.stl/x", 2, "--out cube.stl/x: cube.stl is a file"),
        ("slice cube.stl --unit mm --out cube.stl/a.gcode", 2, "is a file, or lies in one"),
        ("flow cube.stl --unit mm --svzerod --one-d", 2, "--one-d follows it, which is an option"),
        ("slice --unit mm cube.stl --place --out a.gcode", 2, "--place takes a value, and --out"),
        ("slice cube.stl --unit mm --unit um --out a.gcode", 2, "--unit is given twice, and"),
        ("calibrate weigh bad.csv --write a --write a --write b", 2, "--write is given 3 times"),
        ("ports --printer nope", 2, "no printer profile 'nope'"),
    ],
)
def test_one_message_and_the_right_exit_code(
    words: str, code: int, message: str, shell: Shell, tmp_path: Path
) -> None:
    (tmp_path / "bin.yaml").write_bytes(bytes(range(128, 256)))
    (tmp_path / "nul.gcode").write_bytes(b"G1 X1\nG1 X\0 Y2\n")
    (tmp_path / "text.gcode").write_text("Dear all,\nthis is no code.\n")
    (tmp_path / "foreign.yaml").write_text("foo: 1\n")
    (tmp_path / "list.yaml").write_text("- 1\n")
    (tmp_path / "needle.yaml").write_text("inner_mm: 0.2\nouter_mm: 0.4\n")
    (tmp_path / "bad.csv").write_text("travel_mm,mass_mg\n1,abc\n")
    write_stl(tmp_path / "cube.stl", block_solid(np.full(3, 2.0)))
    os.mkfifo(tmp_path / "pipe.gcode")
    before = sorted(tmp_path.iterdir())
    data = str(tmp_path.with_name(tmp_path.name + "_data"))
    shell.monkeypatch.setenv("PRINTCTL_DATA", data)
    shell.refuses(message, *words.split(), code=code)
    assert sorted(tmp_path.iterdir()) == before


# --- kernel compilation before a command, with a message
@pytest.fixture
def empty_store(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PRINTCTL_CACHE", str(tmp_path))
    everything = listing.needed_kernels
    monkeypatch.setattr(listing, "needed_kernels", lambda *works: everything(*works)[:2])


@pytest.mark.usefixtures("empty_store")
def test_few_are_left_to_their_first_call(capsys, tmp_path) -> None:
    have_kernels("simulate")
    assert capsys.readouterr().err == ""
    assert not list(tmp_path.rglob("*.nbc"))


@pytest.mark.usefixtures("empty_store")
def test_many_are_compiled_and_told_once(monkeypatch, capsys, tmp_path) -> None:
    monkeypatch.setattr(kernels_ready, "MIN_KERNELS", 1)
    told = ProgressFile(tmp_path / "progress.jsonl")
    have_kernels("simulate", listener=told)
    said = capsys.readouterr().err
    assert "2 to compile, once for this version" in said
    assert f"2 ready, kept in {tmp_path}" in said.replace("\n", "")
    (stage,) = read_progress("one", told.path).stages
    assert (stage.name, stage.state, stage.fraction) == ("kernels", "done", 1.0)
    have_kernels("simulate")
    assert capsys.readouterr().err == ""


def test_interrupt_inside_a_kernel_is_no_failure(tmp_path) -> None:
    told = ProgressFile(tmp_path / "progress.jsonl")
    with pytest.raises(KeyboardInterrupt), told.whole(lambda _: None):
        raise SystemError("a result with an exception set") from KeyboardInterrupt()
    assert read_progress("one", told.path).state == "interrupted"


@pytest.mark.slow
@pytest.mark.usefixtures("empty_store")
def test_doctor_compiles_the_list(tmp_path) -> None:
    done = CliRunner().invoke(app, ["doctor", "--warm"])
    assert "2 ready" in done.output
    assert len(list(tmp_path.rglob("*.nbc"))) >= 2


# --- findings of `printctl doctor`, and its exit code
USB = PortInfo("/dev/ttyACM0", "Marlin", "2a03:0042", "x")


def doctor(*words: str):
    return CliRunner().invoke(app, ["doctor", *words])


def nobody_may(device: str) -> bool:
    return False


def test_a_machine_that_can_run_the_tests_is_fit():
    done = doctor()
    assert done.exit_code == 0, done.output
    assert "OpenGL               not needed" in done.output
    assert sys.executable in done.output


def test_a_data_folder_that_cannot_be_written_blocks(monkeypatch):
    monkeypatch.setattr("printctl.doctor.is_writable", lambda folder: False)
    done = doctor()
    assert done.exit_code == 1
    assert "BLOCKS: no file can be written in" in done.output
    assert "PRINTCTL_DATA" in done.output


def test_a_full_disk_blocks_and_a_nearly_full_one_is_told():
    (full,) = places.disk_findings("here", Path("/x"), 0.1)
    (low,) = places.disk_findings("here", Path("/x"), 3.0)
    assert full.blocks
    assert not low.blocks
    assert "0.10 GB left" in full.text
    assert places.disk_findings("here", Path("/x"), 300.0) == []


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="root writes anywhere")
def test_a_folder_without_rights_is_not_writable(tmp_path: Path):
    tmp_path.chmod(0o500)
    assert not places.is_writable(tmp_path)


def test_a_taken_port_is_seen():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert not places.is_port_free(port)
    assert places.is_port_free(port)


def test_a_port_that_may_not_be_opened_comes_with_group_and_udev_rule(monkeypatch):
    monkeypatch.setattr("sys.platform", "linux")
    (found,) = permission_findings([USB], lambda device: "dialout", nobody_may)
    assert "sudo usermod -aG dialout $USER" in found.text
    assert 'ATTRS{idVendor}=="2a03", ATTRS{idProduct}=="0042"' in found.text
    assert "ID_MM_DEVICE_IGNORE" in udev_rule(USB.usb_id)
    assert not found.blocks


def test_a_missing_extra_comes_with_its_command(monkeypatch):
    wanted = ["numpy>=2", 'h5py>=3 ; extra == "scans"', "no-such-thing>=1; extra == 'scans'"]
    monkeypatch.setattr("printctl.doctor.metadata.requires", lambda name: wanted)
    assert extras() == {"scans": "missing no-such-thing; pip install 'printctl[scans]'"}


def test_two_homes_of_our_packages_block(monkeypatch):
    monkeypatch.setattr("printctl.doctor.OURS", ("design", "json"))
    done = doctor()
    assert done.exit_code == 1
    assert "come from 2 places" in done.output


def test_kernels_that_are_not_compiled_are_told(monkeypatch, tmp_path: Path):
    monkeypatch.setattr("printctl.doctor.cache_dir", lambda: tmp_path / "none")
    done = doctor()
    assert done.exit_code == 0
    assert "printctl doctor --warm" in done.output


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "M600",
            "line 4: M600: unknown to marlin; it changes filament: the firmware parks the head",
        ),
        ("M4321", "line 4: M4321: unknown to marlin; remove it, or list it in the printer"),
    ],
)
def test_simulate_and_print_refuse_a_command_for_one_reason(
    line: str, said: str, shell: Shell
) -> None:
    text = f"M302 P1\nG1 Z5 F200\nG1 X10 Y10 E0.1 F600\n{line}\nG1 Z20 F200\n"
    Path("a.gcode").write_text(text)
    for command in (["simulate", "a.gcode"], ["print", "a.gcode", "--port", "simulated"]):
        code, _, err = shell(*command, "--printer", "generic_marlin")
        told = " ".join(err.split())
        assert code == 3
        assert said in told
