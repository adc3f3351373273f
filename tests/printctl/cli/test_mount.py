"""Numbers of `printctl mount`: what is left and why, and what no dish or machine has."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.printctl.cli.shell import Shell

PRINTER = ("--printer", "generic_marlin")


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PRINTCTL_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def test_ink_that_cannot_be_pushed_is_named(shell: Shell) -> None:
    code, out, _ = shell("mount", *PRINTER, "--syringe", "bd_1ml", "--fill-ul", "900")
    assert code == 0
    assert "830 µL left to push; 70 µL more stay in it (dead volume" in out
    mounted = shell.json("mount", *PRINTER)["mounted"][0]
    assert mounted["left_ul"] + mounted["reserved_ul"] == pytest.approx(900)


@pytest.mark.parametrize(
    ("given", "code", "said"),
    [
        (("--syringe", "bd_1ml", "--fill-ul", "1001"), 2, "holds 1000 µL"),
        (("--syringe", "bd_1ml", "--fill-ul", "inf"), 2, "holds 1000 µL"),
        (("--dish-centre", "nan,3"), 2, "isn't finite"),
        (("--dish-centre", "3,inf"), 2, "isn't finite"),
        (("--dish-centre", "1e5,0"), 1, "X 0 to 200 mm and Y 0 to 200 mm"),
        (("--dish-centre", "10,-1"), 1, "outside the travel of"),
        (("--dish", "petri_60mm", "--bath-depth", "800"), 1, "the wall of petri_60mm (wall_mm)"),
        (("--dish", "petri_60mm", "--bath-depth", "inf"), 1, "the wall of petri_60mm (wall_mm)"),
        (("--bath-depth", "5"), 1, "name the dish as well"),
        (("--dish", "none", "--bath-depth", "5"), 1, "name the dish as well"),
    ],
)
def test_lengths_that_nothing_has_are_refused_and_not_kept(
    shell: Shell, data: Path, given: tuple[str, ...], code: int, said: str
) -> None:
    shell.refuses(said, "mount", *PRINTER, *given, code=code)
    assert not list(data.rglob("*.json"))


@pytest.mark.parametrize("given", [("--fill-ul", "nan"), ("--bath-depth", "nan")])
def test_numbers_that_are_none_are_refused(
    shell: Shell, data: Path, given: tuple[str, ...]
) -> None:
    code, _, err = shell("mount", *PRINTER, "--syringe", "bd_1ml", *given)
    assert (code, "greater than or equal" in err) == (2, True)
    assert not list(data.rglob("*.json"))
