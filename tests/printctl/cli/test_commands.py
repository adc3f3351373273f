"""Subcommand discovery: only the requested subcommand is imported."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from firmware_profiles import Ink, Needle, Printer, Syringe, load, shipped
from printctl.cli import commands
from printctl.cli.commands import COMMANDS, LazyGroup
from printctl.cli.main import app
from printctl.errors import UsageError
from printctl.system_errors import explain
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


# --- options made from the fields of a recipe's section
# --- one JSON object on stdout for a failure of any kind, beside the text on stderr
@pytest.fixture
def shell(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Shell:
    monkeypatch.chdir(tmp_path)
    return Shell(monkeypatch, capsys)


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
            "--yes",
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
def test_a_shipped_profile_is_copied_to_a_new_file_of_ones_own(tmp_path: Path) -> None:
    for model, name in ((Printer, "generic_marlin"), (Ink, "collagen_fresh")):
        out = tmp_path / f"{name}.yaml"
        words = ["profiles", name, "--write", str(out)]
        assert CliRunner().invoke(app, words).exit_code == 0
        assert load(model, str(out)) == load(model, name)
        with pytest.raises(UsageError, match="there already"):
            CliRunner().invoke(app, words, catch_exceptions=False)
