"""Bash completion of words, asked as bash asks."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_profiles import Ink, Needle, Printer, Syringe, shipped
from printctl.cli.commands import COMMANDS
from printctl.cli.main import app

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


def test_a_profile_is_offered_by_what_it_begins_with(ask):
    offered = ask("printctl print part.gcode --printer gen")
    assert offered
    assert all(name.startswith("gen") for name in offered)


def test_a_file_is_left_to_the_shell(ask):
    assert ask("printctl run exam") == []
    assert ask("printctl slice part.stl --printer ./mi") == []


def test_the_script_completes_files_itself_where_nothing_is_offered(ask):
    script = ask("printctl", "source_bash")
    assert any("complete -o default" in line for line in script)


def test_an_option_of_that_name_that_means_another_thing_offers_no_printer(ask):
    assert ask("printctl flow a.csv --profile gen") == []


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
