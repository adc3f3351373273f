"""`printctl register --datums` and `--tolerance`: wrong values reported before any scan is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from design.network_files.csv_format import read_network_csv, write_network_csv
from design.solids import write_stl
from printctl.cli.register_work import read_design
from printctl.errors import UsageError
from printctl.run_folder.artefacts import LUMEN, NETWORK, SOLID
from printctl.run_folder.manifest import Manifest
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


# --- `printctl register --model RUN`: holds a scan against what the run's print leaves to be seen
@pytest.mark.parametrize(
    ("method", "lumens", "whole"),
    [
        ("embedded", None, False),
        ("fresh", None, True),
        (None, None, True),
        ("embedded", False, True),
        ("fresh", True, False),
    ],
)
def test_of_an_embedded_print_the_lumens_are_scanned(
    tmp_path: Path, method: str | None, lumens: bool | None, whole: bool
) -> None:
    part, inside = construct(), construct()
    inside = type(inside)(inside.vertices / 2, inside.faces)
    write_stl(tmp_path / SOLID, part)
    write_stl(tmp_path / LUMEN, inside)
    write_network_csv(tmp_path / NETWORK, network())
    if method is not None:
        Manifest(tmp_path, {"recipe": {"toolpath": {"method": method}}}).save()
    surface = read_design(tmp_path, None, lumens, "mm", None, tmp_path, print).surface
    wanted = part if whole else inside
    assert surface.vertices.max() == pytest.approx(wanted.vertices.max(), abs=1e-3)


def test_lumens_of_an_stl_without_a_network_are_found_and_kept(tmp_path: Path) -> None:
    said: list[str] = []
    model = tmp_path / "models" / "part.stl"
    model.parent.mkdir()
    write_stl(model, construct())
    out = tmp_path / "report"
    design = read_design(model, None, None, "mm", None, out, said.append)
    assert design.vessels.vessel_count == network().vessel_count
    assert sorted(design.vessels.mean_radius()) == pytest.approx(
        sorted(network().mean_radius()), rel=0.03
    )
    assert design.network == out / NETWORK
    assert read_network_csv(out / NETWORK, unit="mm").vessel_count == network().vessel_count
    assert "lumens were found in the model" in said[0]
    with pytest.raises(UsageError, match="no network at"):
        read_design(model, tmp_path / "none.csv", None, "mm", None, out, said.append)
