"""Read a TIFF stack's voxel values, with the voxel size if the file states it."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError

Size = tuple[float, float, float]


def read_tiff(path: Path) -> tuple[NDArray[Any], Size | None, str | None]:
    """Values (x, y, z), voxel size along x, y, z and its unit's name, as far as the file says.

    ImageJ and OME files say; plain TIFF has no size along z.

    Raises
    ------
    TissueError
        When it isn't one stack of one channel.
    """
    import tifffile  # a tenth of a second that runs without such images don't pay

    with tifffile.TiffFile(path) as file:
        series = file.series[0]
        values = series.asarray()
        axes = [axis for axis, size in zip(series.axes, values.shape, strict=True) if size > 1]
        size, unit = _size(file)
    stack = np.squeeze(values)
    if stack.ndim != 3 or "".join(axes)[1:] != "YX":
        raise TissueError(
            f"{path}: has axes {series.axes} of {values.shape}; give one stack of pictures of one "
            "channel"
        )
    return np.ascontiguousarray(stack.transpose(2, 1, 0)), size, unit


def _size(file: Any) -> tuple[Size | None, str | None]:
    if file.ome_metadata:
        return _ome_size(file.ome_metadata)
    metadata = file.imagej_metadata or {}
    tags = file.pages[0].tags
    if "spacing" not in metadata or "unit" not in metadata or "XResolution" not in tags:
        return None, None
    names = {str(metadata.get(key, metadata["unit"])) for key in ("unit", "yunit", "zunit")}
    units = {name.replace("\\u00B5", "µ") for name in names}
    if len(units) > 1:
        raise TissueError(
            f"{file.filename}: counts its axes in {' and '.join(sorted(units))}; export it with "
            "one unit, or take the units out and give voxel_mm"
        )
    # Pixels per unit, as a fraction.
    across = [tags[name].value for name in ("XResolution", "YResolution")]
    x, y = (bottom / top for top, bottom in across)
    return (x, y, abs(float(metadata["spacing"]))), units.pop()


def _ome_size(text: str) -> tuple[Size | None, str | None]:
    for element in ElementTree.fromstring(text).iter():
        if element.tag.endswith("}Pixels"):
            sizes = [element.get(f"PhysicalSize{axis}") for axis in "XYZ"]
            units = {element.get(f"PhysicalSize{axis}Unit", "µm") for axis in "XYZ"}
            if None in sizes or len(units) != 1:
                return None, None
            x, y, z = (float(str(value)) for value in sizes)
            return (x, y, z), units.pop()
    return None, None
