"""`printctl register --datums` and `--tolerance`: wrong values reported before any scan is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from design.network_files.csv_format import write_network_csv
from design.solids import write_stl
from tests.printctl.cli.shell import Shell
from tests.registration.measuring.geometry.shapes import construct, network


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(monkeypatch, capsys, "register")


@pytest.fixture
def design(tmp_path: Path) -> Path:
    write_stl(tmp_path / "part.stl", construct())
    write_network_csv(tmp_path / "network.csv", network())
    return tmp_path / "part.stl"


@pytest.mark.parametrize(
    ("datums", "said"),
    [
        ("", "--datums is empty"),
        (" , ", "--datums is empty"),
        ("face up", "'face up' isn't known"),
        ("face -z, face -z", "is given twice"),
        ("face -z, axis 7", "the design has vessels 0 to 2"),
        ("face -z, outlet 9", "no such mouth in the design"),
    ],
)
def test_wrong_datums_are_wrong_use_and_no_scan_is_read(
    run: Shell, design: Path, tmp_path: Path, datums: str, said: str
) -> None:
    # A file that is no scan: reading it would be refused in other words.
    scan = tmp_path / "scan.tif"
    scan.write_bytes(b"no scan")
    code, _, err = run(
        str(scan), "--model", str(design), "--out", str(tmp_path / "out"), "--datums", datums
    )
    assert code == 2, err
    assert said in " ".join(err.split())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("vessels: [{vessels: [9], open: false}]", "vessel 9 isn't in the network (it has vessels"),
        ("vessels: [{kinds: [vein], open: false}]", "no vessel of the network is of kind 'vein'"),
    ],
)
def test_tolerances_of_no_vessel_are_wrong_use_and_no_scan_is_read(
    run: Shell, design: Path, tmp_path: Path, text: str, said: str
) -> None:
    scan, limits = tmp_path / "scan.tif", tmp_path / "tolerances.yaml"
    scan.write_bytes(b"no scan")
    limits.write_text(text)
    code, _, err = run(str(scan), "--model", str(design), "--out", str(tmp_path / "out"),
                       "--tolerance", str(limits))  # fmt: skip
    assert code == 2, err
    assert said in " ".join(err.split())
