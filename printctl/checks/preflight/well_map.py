"""Read, or make, a plate job's map of wells: their positions, and the G-code lines of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Dish
from kernels.arrays import FloatArray
from printctl.checks.preflight.wells import Wells


def well_arrays(
    names: Sequence[str],
    centre_mm: FloatArray,
    dish: Dish,
    floor_mm: float,
    bath_mm: float | None,
    safe_z_mm: float,
) -> dict[str, NDArray[Any]]:
    """Return the map's arrays of all wells in one frame; parameters as in `Wells`."""
    return {
        "plate_wells": np.array(list(names)),
        "plate_centre_mm": np.asarray(centre_mm, dtype=np.float64),
        "plate_shape": np.array(dish.shape),
        "plate_name": np.array(dish.name),
        "plate_inner_mm": np.array([dish.inner_x_mm, dish.inner_y_mm, dish.wall_mm]),
        "plate_floor_mm": np.array(floor_mm),
        "plate_bath_mm": np.array(np.nan if bath_mm is None else bath_mm),
        "plate_safe_z_mm": np.array(safe_z_mm),
    }


def read_wells(path: Path, line: NDArray[np.int64], volume_ul: FloatArray) -> Wells | None:
    """Wells of a job, and what is written into each; None where the map is of no plate.

    Parameters
    ----------
    path : Path
        The map.
    line : (rows,) int64
        Line of the file that each row of its program is on, from 1.
    volume_ul : (rows,) float64, µL
        What comes out in each.
    """
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as arrays_file:
        if "plate_wells" not in arrays_file.files or len(arrays_file["well"]) < line.max(initial=0):
            return None
        data = {name: arrays_file[name] for name in arrays_file.files}
    well = data["well"][line - 1]
    ink = {str(name): float(volume_ul[well == k].sum()) for k, name in enumerate(data["wells"])}
    return _wells(data, ink)


def _wells(data: Mapping[str, NDArray[Any]], ink_ul: Mapping[str, float]) -> Wells:
    x, y, wall = data["plate_inner_mm"].tolist()
    bath = float(data["plate_bath_mm"])
    dish = Dish.model_validate(
        {
            "name": str(data["plate_name"]),
            "source": "map of the job",
            "licence": "facts, no licence needed",
            "shape": str(data["plate_shape"]),
            "inner_x_mm": x,
            "inner_y_mm": y,
            "wall_mm": wall,
        }
    )
    return Wells(
        [str(name) for name in data["plate_wells"]],
        data["plate_centre_mm"],
        dish,
        float(data["plate_floor_mm"]),
        None if np.isnan(bath) else bath,
        float(data["plate_safe_z_mm"]),
        ink_ul,
    )
