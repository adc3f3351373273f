"""Read axis scale, translation and anatomical orientation (NGFF RFC-4) from OME-Zarr metadata."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import ScanFileError
from registration.files.readers.space import LPS, FileSpace, file_space
from registration.files.readers.units import millimetres

_SPACE = ("x", "y", "z")

_PLACES = {
    "left": (1.0, 0.0, 0.0), "right": (-1.0, 0.0, 0.0),
    "posterior": (0.0, 1.0, 0.0), "anterior": (0.0, -1.0, 0.0),
    "superior": (0.0, 0.0, 1.0), "inferior": (0.0, 0.0, -1.0),
}  # fmt: skip
"""Towards which an axis runs, in LPS."""


def transformed(image: Mapping[str, Any], path: Path) -> tuple[list[float], list[float]]:
    """Scale and translation of each axis, of the finest level and then of the whole image.

    Raises
    ------
    ScanFileError
        When an axis of space runs backwards, or another kind of transformation is asked for.
    """
    axes = [str(axis["name"]) for axis in image["axes"]]
    factors, shifts = [1.0] * len(axes), [0.0] * len(axes)
    for source in (image["datasets"][0], image):
        for step in source.get("coordinateTransformations", ()):
            kind = step.get("type")
            if kind not in ("identity", "scale", "translation"):
                raise ScanFileError(
                    f"{path}: its coordinateTransformations hold {kind!r}; only scale and "
                    "translation are read: resample it, or export it as OME-Zarr 0.4 or 0.5"
                )
            if kind == "scale":
                factors = [a * float(b) for a, b in zip(factors, step["scale"], strict=True)]
                shifts = [a * float(b) for a, b in zip(shifts, step["scale"], strict=True)]
            elif kind == "translation":
                shifts = [a + float(b) for a, b in zip(shifts, step["translation"], strict=True)]
    for name, factor in zip(axes, factors, strict=True):
        if name in _SPACE and not factor > 0:
            raise ScanFileError(
                f"{path}: its axis {name} has the scale {factor:g}, so that it runs backwards; "
                "reverse the array along it and write a scale above 0"
            )
    return factors, shifts


def anatomical(image: Mapping[str, Any], path: Path) -> FileSpace | None:
    """How the spatial axes run, from "left-to-right" and its like; None where nothing is said.

    Raises
    ------
    ScanFileError
        When only some axes say it, or by words that aren't the patient's six.
    """
    spatial = [axis for axis in image["axes"] if axis["name"] in _SPACE]
    orientations = [axis.get("orientation") for axis in spatial]
    if not any(orientations):
        return None
    steps = []
    for axis, orientation in zip(spatial, orientations, strict=True):
        value = orientation.get("value", "") if isinstance(orientation, dict) else ""
        start, _, end = str(value).partition("-to-")
        if end not in _PLACES or _PLACES.get(start) != tuple(-v for v in _PLACES[end]):
            raise ScanFileError(
                f"{path}: axis {axis['name']} has the orientation {value!r}; known are two of "
                f"{', '.join(_PLACES)} opposite each other, like left-to-right"
            )
        steps.append(_PLACES[end])
    _, shifts = transformed(image, path)
    origin = np.zeros(3)
    for axis, shift in zip(image["axes"], shifts, strict=True):
        if axis["name"] in _SPACE:
            unit = millimetres(axis.get("unit"), path) or 1.0
            origin += shift * unit * np.array(steps[spatial.index(axis)])
    return file_space(LPS, steps, origin, path)
