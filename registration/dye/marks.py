"""Read the user's marks file of a dye video: design points with their pixels, and the inlet."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from design.network import VesselNetwork
from firmware_profiles.errors import wording
from firmware_profiles.yaml_file import read_yaml
from kernels.arrays import FloatArray
from registration.devices.lens import Lens
from registration.errors import DyeError

Finite = Annotated[float, Field(allow_inf_nan=False)]
Side = Literal["z", "-z", "x", "-x", "y", "-y"]


class Mark(BaseModel):
    """A point of the design, by node or in mm, and the pixel it is seen at."""

    model_config = ConfigDict(extra="forbid")

    node: Annotated[int, Field(ge=0)] | None = None
    at_mm: tuple[Finite, Finite, Finite] | None = None
    pixel: tuple[Finite, Finite]


class Marks(BaseModel):
    """Contents of a marks file.

    Attributes
    ----------
    marks : list of Mark
        At least two.
    side : str
        The camera's side of the part: z (from above), -z, x, -x, y or -y.
    mirrored : bool
        Whether the film was taken by way of a mirror.
    inlet : int or None
        Node the dye enters at; else the network's own inlets.
    """

    model_config = ConfigDict(extra="forbid")

    marks: Annotated[list[Mark], Field(min_length=2)]
    side: Side = "z"
    mirrored: bool = False
    inlet: Annotated[int, Field(ge=0)] | None = None


def read_marks(path: Path) -> Marks:
    """Read a marks file (docs/dye.md).

    Raises
    ------
    DyeError
        When it isn't there, isn't YAML, or doesn't hold what it should.
    """
    try:
        plain = read_yaml(path.read_text(encoding="utf-8"))
    except FileNotFoundError as exc:
        raise DyeError(f"{path} doesn't exist; docs/dye.md says what marks are") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise DyeError(f"{path}: not YAML ({exc}); mend it") from exc
    try:
        return Marks.model_validate(plain if plain is not None else {})
    except ValidationError as exc:
        first = exc.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise DyeError(
            f"{path}: {place}: {wording(first)}; write marks: [{{node: 0, pixel: [u, v]}}, ...], "
            "two at least (docs/dye.md)"
        ) from exc


def straight_marks(marks: Marks, lens: Lens) -> Marks:
    """The same marks in pictures without the lens' distortion."""
    pixels = lens.straight_pixels(np.array([mark.pixel for mark in marks.marks]))
    moved = [
        mark.model_copy(update={"pixel": (float(u), float(v))})
        for mark, (u, v) in zip(marks.marks, pixels, strict=True)
    ]
    return marks.model_copy(update={"marks": moved})


def marked_points(marks: Marks, network: VesselNetwork) -> tuple[FloatArray, FloatArray]:
    """Points of the design (n, 3), mm, and their pixels (n, 2).

    Raises
    ------
    DyeError
        When a mark names no point, two, or a node that isn't there.
    """
    points = []
    for index, mark in enumerate(marks.marks):
        if (mark.node is None) == (mark.at_mm is None):
            raise DyeError(f"marks.{index}: give either node or at_mm, and not both")
        if mark.node is not None:
            points.append(network.nodes[checked_node(mark.node, network, f"marks.{index}")])
        else:
            points.append(np.array(mark.at_mm))
    return np.array(points), np.array([mark.pixel for mark in marks.marks])


def checked_node(node: int, network: VesselNetwork, place: str) -> int:
    """The node, if the network has it.

    Raises
    ------
    DyeError
        When it hasn't.
    """
    if node >= len(network.nodes):
        raise DyeError(
            f"{place}: node {node} isn't one of the network's 0 to {len(network.nodes) - 1} "
            "(network.csv: node0, node1)"
        )
    return node
