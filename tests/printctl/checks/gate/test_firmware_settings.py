"""Settings that a firmware tells before a start, against those that a job counts on."""

import pytest

from firmware_profiles import load
from firmware_profiles.printers import Printer
from printctl.checks.gate.firmware import differences

DUET = load(Printer, "two_valves_duet3")
SPEEDS = "Max speeds (mm/min): X: 3600.0, Y: 3600.0, Z: 600.0, E:1500.0, min. speed 30.00"
RAMPS = "Accelerations (mm/sec^2): X: 500.0, Y: 500.0, Z: 100.0, E:1000.0"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("X: 3600.0", "X: 300.0", r"top speed of X (M203) is 5 mm/s, slower than the profile's 60"),
        ("speed 30.00", "speed 240.00", "the slowest move (M203 I) is 4 mm/s, faster than the"),
        ("Y: 500.0", "Y: 50.0", "top acceleration of Y (M201) is 50 mm/s², slower than"),
    ],
)
def test_board_whose_limits_would_change_a_line_of_air_is_refused(old, new, words):
    def refused(speeds: str, ramps: str) -> list[str]:
        found = differences({"M203": [speeds], "M201": [ramps]}, DUET)
        return [one.what for one in found if not one.tolerated]

    assert not refused(SPEEDS, RAMPS)
    if "M203 I" in words:  # a plunger's push would be faster, too
        plunger = load(Printer, "ender5_duet3_replistruder5")
        (one,) = [one for one in differences({"M203": [SPEEDS]}, plunger) if not one.tolerated]
        assert "M203 I0.6 in config.g" in one.remedy
    (what,) = refused(SPEEDS.replace(old, new), RAMPS.replace(old, new))
    assert what.startswith(words)
