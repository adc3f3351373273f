"""`printctl profiles new`: questions, their checks, and the profile that the answers give."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from firmware_profiles import Printer, load, profile_doubts
from printctl.cli.machine.new_profile import AIR, PLUNGER, QUESTIONS, Sheet
from tests.printctl.cli.shell import Shell

FAMILIES = ["klipper", "marlin", "prusa", "reprapfirmware"]


def answers(**given: object) -> None:
    Path("answers.yaml").write_text(yaml.safe_dump(given))


def typed(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


@pytest.mark.parametrize("head", [PLUNGER, AIR])
@pytest.mark.parametrize("firmware", FAMILIES)
def test_defaults_make_a_sound_profile_of_every_firmware(shell: Shell, firmware, head) -> None:
    answers(firmware=firmware, head=head)
    made = shell.json("profiles", "new", "mine.yaml", "--answers", "answers.yaml")
    mine = load(Printer, "mine.yaml")
    assert mine.firmware == firmware
    assert (mine.pneumatic is not None) == (head == AIR)
    assert not [doubt for doubt in profile_doubts(mine) if doubt.grave]
    assert made["starting_values"] == list(mine.starting_values)
    assert "firmware" not in mine.starting_values
    assert {"x_mm", "acceleration_mm_s2", "baud"} <= set(mine.starting_values)
    assert shell("profiles", "check", "mine.yaml")[0] == 0


@pytest.mark.parametrize("head", [PLUNGER, AIR])
def test_no_head_is_asked_more_than_twelve_questions(head) -> None:
    sheet = Sheet("test")
    for question in sheet.questions():
        sheet.take(question, head if question.key == "head" else "")
        assert question.text.endswith((")?", "?"))
        assert "\n" not in question.hint
    assert len(sheet.answers) <= 12


def test_what_was_answered_is_no_starting_value(shell: Shell) -> None:
    answers(name="Rig 2", travel=[120, 110, 90], steps="100 100 1600", plunger_steps=3200)
    shell.json("profiles", "new", "mine.yaml", "--answers", "answers.yaml")
    mine = load(Printer, "mine.yaml")
    assert (mine.name, mine.x_mm.high, mine.steps_per_mm.z) == ("Rig 2", 120, 1600)
    assert mine.steps_per_mm.e == 3200
    assert not {"x_mm", "steps_per_mm"} & {one.partition(".")[0] for one in mine.starting_values}


def test_a_valve_that_opens_without_current_has_the_other_value_to_close(shell: Shell) -> None:
    answers(head=AIR, opens="M106 P0 S0", closes="M106 P0 S255")
    shell.json("profiles", "new", "mine.yaml", "--answers", "answers.yaml")
    assert load(Printer, "mine.yaml").pneumatic.closes == "M106 P0 S255"


@pytest.mark.skipif(sys.platform == "win32", reason="a limit of the shell's")
def test_a_full_disk_leaves_no_profile(tmp_path: Path) -> None:
    Path(tmp_path / "answers.yaml").write_text("{}")
    new = f"{sys.executable} -m printctl profiles new mine.yaml --answers answers.yaml"
    ended = subprocess.run(
        ["bash", "-c", f"ulimit -f 0; {new}"], cwd=tmp_path, capture_output=True, text=True
    )
    assert ended.returncode == 1
    assert "grew too large for this disk" in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not (tmp_path / "mine.yaml").exists()


def test_a_wrong_answer_is_refused_at_once_and_asked_again(shell: Shell, monkeypatch) -> None:
    typed(monkeypatch, "Rig", "marlyn", "", "20 x", "100 100 100", *[""] * 20)
    code, _, err = shell("profiles", "new", "mine.yaml")
    assert code == 0, err
    assert "'marlyn' is none of klipper" in err
    assert "'20 x' isn't three numbers" in err
    assert err.count("How far do X, Y and Z go") == 2
    assert load(Printer, "mine.yaml").x_mm.high == 100


def test_a_speed_beyond_the_board_is_refused_with_the_reason(shell: Shell) -> None:
    answers(steps="3200 3200 3200", speed="50 50 5")
    words = ("profiles", "new", "mine.yaml", "--answers", "answers.yaml")
    shell.refuses(("speed: max_speed_mm_s.x", "160000 steps/s"), *words)
    answers(steps="3200 3200 3200")  # its default is what the board can
    assert shell(*words)[0] == 0
    assert load(Printer, "mine.yaml").max_speed_mm_s.x == 12.5


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"colour": "red"}, "colour; it has `key: answer` of name, firmware"),
        ({"head": AIR, "syringe": "bd_1ml"}, "not for this head: syringe"),
        ({"head": AIR, "pressure": 900, "max_pressure": 700}, "above what the regulator gives"),
        ({"head": AIR, "opens": "G1 X5"}, "opens"),
        ({"travel": "-1 2 3"}, "must be above 0"),
        ({"syringe": "a bottle"}, "'a bottle' is none of bd_10ml"),
    ],
)
def test_answers_that_dont_fit_write_nothing(shell: Shell, given, words) -> None:
    answers(**given)
    shell.refuses(words, "profiles", "new", "mine.yaml", "--answers", "answers.yaml")
    assert not Path("mine.yaml").exists()


def test_no_file_is_replaced(shell: Shell) -> None:
    Path("mine.yaml").write_text("kept")
    shell.refuses("there already", "profiles", "new", "mine.yaml")
    shell.refuses("ends in .yaml", "profiles", "new", "mine.txt")
    assert Path("mine.yaml").read_text() == "kept"


def test_an_end_of_input_writes_nothing(shell: Shell, monkeypatch) -> None:
    typed(monkeypatch, "Rig", "marlin")  # and no more
    shell.refuses("nothing was written", "profiles", "new", "mine.yaml")
    assert not Path("mine.yaml").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX's")
def test_ctrl_c_writes_nothing(tmp_path: Path) -> None:
    # A test run in the background of a shell inherits an ignored Ctrl-C.
    heard = (
        "import runpy, signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "runpy.run_module('printctl', run_name='__main__')"
    )
    command = [sys.executable, "-c", heard, "profiles", "new", str(tmp_path / "mine.yaml")]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        process.stdin.write(b"Rig\n")
        process.stdin.flush()
        seen = b""
        while b"Which firmware" not in seen:
            seen += process.stderr.read(1)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode != 0
    assert err.endswith(b"printctl: interrupted\n")
    assert not list(tmp_path.iterdir())


def test_each_question_has_a_key_of_its_own() -> None:
    assert len({question.key for question in QUESTIONS}) == len(QUESTIONS)
