"""Tolerances in a recipe, a file and on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from printctl.cli.tolerance_options import tolerances_of
from printctl.errors import UsageError
from printctl.recipe.making import RegistrationPart

WHOLE = """
diameter_percent: +8/-4
mean_um: 12
narrowest_um: 20
leak_um: 50
vessels:
  - {vessels: [3], diameter_um: 30, open: false}
  - {kinds: [artery], offset_um: 40}
"""


def file(folder: Path, text: str) -> Path:
    path = folder / "tolerance.yaml"
    path.write_text(text)
    return path


def test_the_old_names_still_set_the_limits() -> None:
    part = RegistrationPart(tolerance_um=80, diameter_tolerance_percent=12)
    found = part.all_tolerances()
    assert found.rms_um == 80
    assert (found.limits.diameter.minus_percent, found.limits.diameter.plus_percent) == (12, 12)


def test_a_file_sets_sides_features_and_vessels(tmp_path: Path) -> None:
    found = tolerances_of(file(tmp_path, WHOLE), 50.0, None)
    limits = found.of(0, "channel")
    assert found.rms_um == 50
    assert (limits.diameter.minus_percent, limits.diameter.plus_percent) == (4, 8)
    assert limits.mean is not None
    assert limits.mean.plus_um == 12
    assert limits.leak_um == 50
    assert found.of(3, "channel").diameter.minus_um == 30
    assert not found.of(3, "channel").open
    assert found.of(1, "artery").offset_um == 40


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("diameter_prcent: 3", "diameter_prcent: .*remove it or mend its spelling"),
        ("offset_um: -3", r"offset_um: must be above 0 .is -3"),
        ("diameter_percent: ten", "like 10, or both sides, like .10/-5 .is 'ten'"),
        ("diameter_percent: +0/-0", "one above 0"),
        ("vessels: [{open: true}]", "vessels.0: names no vessel; give either vessels"),
        ("vessels: [{vessels: [0], kinds: [vein]}]", "names both vessels and kinds; give either"),
        ("diameter_percent:", "diameter_percent has no value; give one, or leave"),
        ("diameter_percent: true", "like 10, or both sides, like .10/-5 .is True"),
        ("vessels: [{vessels: [true], open: true}]", "must be a whole number .is True"),
        ("offset_um: '40'", "offset_um: must be a number .is '40'"),
        ("leak_um: yes", "leak_um: must be a number .is True"),
        ("open: 1", "open: must be true or false .is 1"),
        ("offset_um: " + 70_000 * "a", r"must be a number .is 'a{59} \.\.\. .70002 characters"),
    ],
)
def test_a_wrong_limit_is_named_with_its_remedy(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        tolerances_of(file(tmp_path, text), None, None)
