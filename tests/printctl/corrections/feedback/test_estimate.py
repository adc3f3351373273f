"""Compensation: repeated print-scan-correct cycles on a printer of known errors."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.errors import ToolpathError
from design.toolpath.correction import NEUTRAL
from printctl.corrections.compensation import CompensationFile, corrections_of_file
from printctl.corrections.feedback import (
    NO_ORIGIN,
    Choices,
    Mean,
    Print,
    estimate,
    keep_origin,
    read_print,
)
from printctl.corrections.feedback.local import repeating
from printctl.errors import UsageError
from printctl.run_folder.artefacts import NETWORK, NUMBERS
from printctl.run_folder.manifest import Manifest, StageRecord, digest_file, of_simulator
from tests.printctl.corrections.feedback.lab import TWO, Lab, registered, small_run

KNOWN = Mean(0.0, 1e-3)
"""A scanner whose bias was measured on a phantom."""
CALIBRATED = Choices(bias=KNOWN)


def designed(lab: Lab) -> np.ndarray:
    return 2 * np.array([radius.mean() for _, radius in lab.network.polylines()])


def off(lab: Lab, made: CompensationFile | None) -> float:
    """Largest error of a diameter as printed, mm."""
    written = NEUTRAL if made is None else corrections_of_file(made)
    return float(np.abs(lab.diameters(written) - designed(lab)).max())


def test_size_is_right_after_one_round_in_the_plane() -> None:
    lab = Lab(shrink=(0.975, 0.98, 0.96))
    made = estimate([lab.print()])
    np.testing.assert_allclose(np.array(made.stretch.factor[:2]) * lab.shrink[:2], 1.0, atol=8e-4)
    assert made.stretch.about_mm == (7.0, 2.0, 0.0)


def test_depth_is_never_corrected_without_a_standard_and_the_file_says_why() -> None:
    lab = Lab(push_mm={3: (0.0, 0.0, 0.05), 11: (0.0, 0.0, 0.05)})
    made = None
    for _ in range(2):
        made = estimate([lab.print(made), lab.print(made)])
        assert made.stretch.factor[2] == 1.0
        assert all(node.offset_um[2] == 0 for node in made.nodes)
        assert "no depth standard" in made.stretch.depth
        assert made.evidence["scale"]["z"]["corrected"] is False


def test_depth_is_corrected_with_a_standard_of_the_scan_or_by_word() -> None:
    lab = Lab(depth_standard=True)
    by_scan = estimate([lab.print()])
    by_word = estimate([Lab().print()], Choices(depth_standard="step of 1.000 mm"))
    for made in (by_scan, by_word):
        assert made.stretch.factor[2] * 0.975 == pytest.approx(1.0, abs=2e-3)
    assert "step of 1.000 mm" in by_word.stretch.depth


def test_a_radial_offset_falls_and_stays_down_over_rounds() -> None:
    lab = Lab(spread_mm=-0.04)
    errors, made = [off(lab, None)], None
    for _ in range(4):
        made = estimate([lab.print(made)], CALIBRATED)
        errors.append(off(lab, made))
    assert errors[0] > 0.05
    assert max(errors[1:]) < 0.012
    assert max(errors[2:]) < 0.008


def test_an_unknown_bias_of_the_scanner_is_not_printed_into_the_part() -> None:
    """10 um of 25 um voxels: as much as a segmentation may be off by itself."""
    made = estimate([Lab(shrink=(1, 1, 1), spread_mm=-0.010).print()])
    assert made.radial.offset_um == 0
    assert made.evidence["diameter"]["corrected"] is False
    seen = Lab(shrink=(1, 1, 1), spread_mm=-0.010).print()
    known = estimate([seen], CALIBRATED)
    assert known.radial.offset_um == pytest.approx(5.0, abs=1.0)
    # A reference has put the walls right, to within half a micrometre.
    lab = Lab(shrink=(1, 1, 1), spread_mm=-0.010)
    righted, not_righted = lab.print(), lab.print()
    righted.found["walls"] = {"offset_um": 5.0, "interval_um": 0.5}
    assert estimate([righted]).radial.offset_um == pytest.approx(5.0, abs=1.0)
    assert estimate([righted, not_righted]).radial.offset_um == 0
    all_bias = estimate([seen], Choices(bias=Mean(-0.010, 1e-3)))
    assert all_bias.radial.offset_um == 0


def test_one_vessel_that_is_always_too_narrow_is_found_among_noise() -> None:
    lab = Lab(noise_mm=0.004, faults_mm={16: -0.05})
    made = estimate([lab.print() for _ in range(4)], CALIBRATED)
    change = {vessel.vessel: vessel.diameter_um for vessel in made.vessels}
    assert change[16] == pytest.approx(0.7 * 50, abs=8)
    assert max((abs(um) for vessel, um in change.items() if vessel != 16), default=0) < 8
    again = estimate([lab.print(made) for _ in range(4)], CALIBRATED)
    once, twice = (off(lab, file) for file in (made, again))
    assert twice < once < off(lab, None)


@pytest.mark.parametrize(
    ("lab", "says"),
    [
        (Lab(shrink=(0.85, 0.85, 0.85)), "times as long along x, limit"),
        (Lab(spread_mm=-0.12), "vessel .*limit"),
        (Lab(push_mm={3: (0, 0.4, 0), 11: (0, 0.4, 0)}), "node 3: .*limit 150 um"),
    ],
)
def test_what_is_beyond_a_correction_is_refused(lab: Lab, says: str) -> None:
    with pytest.raises(ToolpathError, match=says):
        estimate([lab.print(), lab.print()], CALIBRATED)


def test_what_does_not_belong_together_is_not_pooled() -> None:
    lab = Lab()
    one, two = lab.print(), lab.print()
    other = replace(two, design=two.design.model_copy(update={"network_sha256": "1" * 64}))
    with pytest.raises(UsageError, match="isn't a print of run1's design"):
        estimate([one, other])
    inked = replace(two, made_with=two.made_with.model_copy(update={"ink": "other"}))
    with pytest.raises(UsageError, match="made otherwise"):
        estimate([one, inked])
    with pytest.raises(UsageError, match="hold the same scan"):
        estimate([one, one])


# --- compensation: errors of one print told from errors of all; incompatible prints refused
CALIBRATED_ACCIDENTS = Choices(bias=Mean(0.0, 1e-3))
ALWAYS = {17: -0.04, 20: 0.04}
LOCAL_GAIN = 0.7


def prints_with_an_accident(count: int, always: dict[int, float], noise_mm: float) -> list[Print]:
    """Vessel 15 is 60 um too narrow over all of its length, in the first print alone."""
    lab = Lab(shrink=(1, 1, 1), noise_mm=noise_mm)
    made = []
    for number in range(count):
        lab.faults_mm = always | ({15: -0.06} if number == 0 else {})
        made.append(lab.print())
    return made


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("noise_mm", [0.002, 0.006])
def test_one_prints_accident_neither_is_corrected_nor_hides_what_repeats(
    count: int, noise_mm: float
) -> None:
    made = estimate(prints_with_an_accident(count, ALWAYS, noise_mm), CALIBRATED_ACCIDENTS)
    change = {part.vessel: part.diameter_um for part in made.vessels}
    assert 15 not in change
    # Nearly all of the 40 um times the gain; the noise's mean is told in as many prints.
    slack = 2.5 + 3e3 * LOCAL_GAIN * noise_mm / count**0.5
    assert change[17] == pytest.approx(LOCAL_GAIN * 40, abs=slack)
    assert change[20] == pytest.approx(-LOCAL_GAIN * 40, abs=slack)
    assert made.radial.offset_um == 0
    assert made.radial.slope_um_per_mm == 0


def test_cochrans_test_finds_what_does_not_repeat() -> None:
    """Three of 3 prints each. Of variances 1, 1 and 30 the largest over the mean of the others is
    30; F(2, 4) exceeds 30 with a probability of (1 + 30 / 2)^-2 = 0.0039, times 3 vessels 0.012."""
    free = np.array([2, 2, 2])
    assert repeating(np.array([1.0, 1.0, 30.0]), free).all()
    # 40: (1 + 20)^-2 = 0.0023, times 3 is 0.0068.
    assert repeating(np.array([1.0, 1.0, 40.0]), free).tolist() == [True, True, False]
    assert repeating(np.zeros(4), np.zeros(4, dtype=np.int64)).all()
    assert repeating(np.zeros(3), free).all()


# --- origin of a scanned part in `printctl register`: its run, or none known
@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run as far as its G-code, registered."""
    folder = small_run(tmp_path_factory)
    registered(folder / "plain", Lab(network=TWO))
    return folder / "plain"


@pytest.fixture
def plain(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "plain"))


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    path = tmp_path / "lab" / "scan.oct"
    path.parent.mkdir()
    path.write_bytes(b"a scan")
    return path


def registration(out: Path, run_folder: Path, scan: Path) -> None:
    """What `register` writes, of the numbers that the run has."""
    out.mkdir(exist_ok=True)
    numbers = json.loads((run_folder / NUMBERS).read_text())
    kept = keep_origin(run_folder, scan, out)
    (out / NUMBERS).write_text(json.dumps({"registration": numbers, **kept}))


def test_a_whole_runs_origin_is_kept(plain: Path, scan: Path, tmp_path: Path) -> None:
    registration(tmp_path / "out", plain, scan)
    found = read_print(tmp_path / "out")
    assert found.facts.scan_sha256 == digest_file(scan)
    assert not found.simulated
    assert found.design == read_print(plain).design


def test_why_it_is_not_known_is_said_by_both_commands(
    plain: Path, scan: Path, tmp_path: Path
) -> None:
    """A network that was edited after the run: its vessels may have other numbers."""
    (plain / NETWORK).write_text((plain / NETWORK).read_text() + "\n")
    why = keep_origin(plain, scan, tmp_path / "out")
    assert set(why) == {NO_ORIGIN}
    assert "network.csv isn't as the run wrote it" in why[NO_ORIGIN]
    registration(tmp_path / "out", plain, scan)
    with pytest.raises(UsageError, match=r"network\.csv isn't as the run wrote it.*anew"):
        read_print(tmp_path / "out")


@pytest.mark.parametrize("change", ["registered against another", "changed since"])
def test_vessels_of_another_network_are_refused(
    plain: Path, scan: Path, tmp_path: Path, change: str
) -> None:
    """Vessels are known by their numbers: either half of the check is enough."""
    out = tmp_path / "out"
    registration(out, plain, scan)
    if change == "changed since":
        (out / NETWORK).write_text((out / NETWORK).read_text() + "\n")
    else:
        numbers = json.loads((out / NUMBERS).read_text())
        numbers["registration"]["design"] = {"network_sha256": "0" * 64}
        (out / NUMBERS).write_text(json.dumps(numbers))
    with pytest.raises(UsageError, match=r"another network than its run's.*register it anew"):
        read_print(out)


def test_a_simulated_scan_is_known_where_it_lies(scan: Path) -> None:
    folder = Manifest(scan.parent)
    folder.stages["scan"] = StageRecord("key", {scan.name: "0"}, {}, 0.0, 0.0)
    folder.save()
    assert of_simulator(scan)
    assert not of_simulator(scan.with_name("mine.oct"))


def withdrawn(print_: Print, vessels: range) -> Print:
    """A print of which some vessels' diameters have no interval."""
    rows = [
        row | {"interval_95_um": [None if row["vessel"] in vessels else 4.0] * len(row["along_mm"])}
        for row in print_.found["vessels"]
    ]
    return replace(print_, found=print_.found | {"vessels": rows})


def test_a_diameter_without_an_interval_corrects_nothing() -> None:
    lab = Lab(faults_mm={15: -0.06})
    told = estimate([withdrawn(lab.print(), range(0)) for _ in range(3)], CALIBRATED)
    assert 15 in {vessel.vessel for vessel in told.vessels}
    untold = estimate([withdrawn(lab.print(), range(15, 16)) for _ in range(3)], CALIBRATED)
    assert 15 not in {vessel.vessel for vessel in untold.vessels}
