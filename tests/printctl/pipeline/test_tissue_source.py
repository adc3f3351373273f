"""Tissue built from a recipe's section, with files beside the recipe."""

from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter

from design.tissue import block
from printctl.pipeline.tissue_source import make_tissue
from printctl.recipe.tissue import TissuePart

PART: TypeAdapter[Any] = TypeAdapter(TissuePart)


def made(folder: Path, **tissue: Any) -> Any:
    """The tissue of this section."""
    return make_tissue(PART.validate_python(tissue), folder)


def box_file(path: Path, keep: slice = slice(None)) -> None:
    """A box of 10 mm as STL, or what is left of it."""
    shape = block((10.0, 10.0, 10.0))
    trimesh.Trimesh(shape.vertices, shape.faces[keep], process=False).export(path)


def test_needle_and_port_are_cut_out_of_a_shape(tmp_path: Path) -> None:
    port = trimesh.creation.box(extents=(2, 2, 2))
    port.export(tmp_path / "port.stl")
    needle = {"shape": "cylinder", "from_mm": [5, 5, -1], "to_mm": [5, 5, 11], "radius_mm": 0.5}
    tissue = made(
        tmp_path,
        shape="block",
        size_mm=[10, 10, 10],
        keep_out=[
            needle,
            {"mesh": "port.stl", "unit": "mm"},
            {**needle, "from_mm": [5, 5, 50], "to_mm": [5, 5, 60]},
        ],
    )
    assert tissue.volume_mm3 == pytest.approx(1000 - 1 - np.pi * 2.5, rel=1e-3)
    assert len(tissue.notes) == 1
    assert "keep_out 3 (cylinder) doesn't meet the tissue" in tissue.notes[0]


def test_small_piece_of_a_large_mesh_may_be_kept(tmp_path: Path) -> None:
    box_file(tmp_path / "box.stl")
    within = [{"shape": "sphere", "centre_mm": [5, 5, 5], "radius_mm": 2}]
    tissue = made(tmp_path, mesh="box.stl", unit="mm", keep_within=within)
    assert tissue.volume_mm3 == pytest.approx(32 * np.pi / 3, rel=0.02)


def test_label_image_with_demand_from_another_image(tmp_path: Path) -> None:
    voxels = np.zeros((20, 20, 20), np.uint8)
    voxels[4:16, 4:16, 4:16] = 2
    affine = np.diag([0.5, 0.5, 0.5, 1.0])
    image = nibabel.Nifti1Image(voxels, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "seg.nii.gz")
    cells = np.broadcast_to(np.arange(20.0)[:, None, None], (20, 20, 20)).astype(np.float32)
    nibabel.save(nibabel.Nifti1Image(cells, affine), tmp_path / "cells.nii")
    tissue = made(
        tmp_path, labels="seg.nii.gz", value=2, demand={"image": "cells.nii", "unit": "mm"}
    )
    assert tissue.volume_mm3 == pytest.approx(216.0, rel=0.01)
    assert tissue.demand.mean_weight == pytest.approx(0.5, rel=0.01)
    low, high = tissue.demand.weight(np.array([[2.5, 4.75, 4.75], [7.0, 4.75, 4.75]]))
    assert (low, high) == (pytest.approx(5 / 19), pytest.approx(14 / 19))


def test_demand_by_depth(tmp_path: Path) -> None:
    tissue = made(
        tmp_path,
        shape="block",
        size_mm=[10, 10, 10],
        demand={"depth_mm": [0, 5], "relative": [0, 3]},
    )
    # At depth d the shell is 6 (10 - 2 d)² large: the mean depth is 10/8.
    assert tissue.demand.mean_weight == pytest.approx(0.25, rel=0.01)
