"""Origin of a scanned part in `printctl register`: its run, or none known."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from printctl.corrections.feedback import NO_ORIGIN, keep_origin, read_print
from printctl.errors import UsageError
from printctl.run_folder.artefacts import NETWORK, NUMBERS
from printctl.run_folder.manifest import MANIFEST, Manifest, StageRecord, digest_file, of_simulator
from tests.printctl.corrections.feedback.lab import Lab
from tests.printctl.corrections.feedback.small_run import TWO, registered, small_run


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


def test_a_folder_without_a_manifest_and_an_unfinished_run_are_told_apart(
    plain: Path, scan: Path, tmp_path: Path
) -> None:
    manifest = Manifest.load(plain)
    del manifest.stages["toolpath"]
    manifest.save()
    assert "its toolpath isn't made" in keep_origin(plain, scan, tmp_path)[NO_ORIGIN]
    (plain / MANIFEST).unlink()
    assert "has no manifest.json of a run" in keep_origin(plain, scan, tmp_path)[NO_ORIGIN]


def test_a_simulated_scan_is_known_where_it_lies(scan: Path) -> None:
    folder = Manifest(scan.parent)
    folder.stages["scan"] = StageRecord("key", {scan.name: "0"}, {}, 0.0, 0.0)
    folder.save()
    assert of_simulator(scan)
    assert not of_simulator(scan.with_name("mine.oct"))
