"""`printctl register --model RUN`: holds a scan against what the run's print leaves to be seen."""

from __future__ import annotations

from pathlib import Path

import pytest

from design.network_files.csv_format import read_network_csv, write_network_csv
from design.solids import write_stl
from printctl.cli.register_design import read_design
from printctl.errors import UsageError
from printctl.run_folder.artefacts import LUMEN, NETWORK, SOLID
from printctl.run_folder.manifest import Manifest
from tests.registration.measuring.geometry.shapes import construct, network


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
