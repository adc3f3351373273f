"""Camera lens class: undistort pictures and pixels; YAML files of data models."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from design.files import write_text
from firmware_profiles.yaml_file import read_yaml
from kernels.arrays import FloatArray
from registration.errors import PictureError

Model = TypeVar("Model", bound=BaseModel)


def read_model(path: Path, model: type[Model], option: str, writer: str) -> Model:
    """Read a file.

    Parameters
    ----------
    path : Path
    model : type
        What it holds.
    option : str
        How the user named it.
    writer : str
        Command that writes such files.

    Raises
    ------
    PictureError
        When the file is missing, or isn't one.
    """
    remedy = f"`{writer}` writes one"
    try:
        return model.model_validate(read_yaml(path.read_text(encoding="utf-8")))
    except OSError as exc:
        raise PictureError(f"{option} {path} can't be read: {exc.strerror}; {remedy}") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise PictureError(f"{option} {path} isn't YAML ({exc}); {remedy}") from exc
    except ValidationError as exc:
        first = exc.errors()[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise PictureError(f"{option} {path}: {place}: {first['msg']}; {remedy}") from exc


def write_model(path: Path, held: BaseModel) -> None:
    """Write a file that `read_model` reads back exactly, without what is None.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    data = held.model_dump(mode="json", exclude_none=True)
    write_text(path, yaml.safe_dump(data, sort_keys=False, default_flow_style=None, width=100))


Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Lens(BaseModel):
    """A camera at one distance, by a board (`fit_lens`).

    A place x, y (over the focal length, from the optical axis) is seen at
    x (1 + k₁r² + k₂r⁴ + k₃r⁶) + 2p₁xy + p₂(r² + 2x²) and, for y, with p₁ and p₂ exchanged,
    r² = x² + y² (Brown 1971, Photogramm. Eng. 37, 855).

    Attributes
    ----------
    size_px : (width, height)
        Of its pictures.
    focal_px : float
    centre_px : (float, float)
        The optical axis.
    distortion : tuple of 2 or 5 floats
        k₁, k₂; of a lens that was fitted whole also p₁, p₂, k₃.
    um_per_px : float
        In the middle, at the distance at which the board lay.
    um_per_px_95 : (float, float)
        95 % of it, the board's sizes taken as exact.
    off_px : float
        RMS of the board's corners about the fit.
    covariance : (8, 8) floats, or None
        Of focal_px, centre_px and k₁, k₂, p₁, p₂, k₃ (`numbers`); None where they weren't all
        fitted.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    printctl_camera: Literal[1] = 1
    size_px: tuple[Annotated[int, Field(gt=0)], Annotated[int, Field(gt=0)]]
    focal_px: Positive
    centre_px: tuple[Number, Number]
    distortion: tuple[Number, Number] | tuple[Number, Number, Number, Number, Number]
    um_per_px: Positive
    um_per_px_95: tuple[Positive, Positive]
    off_px: Number
    covariance: Annotated[
        tuple[Annotated[tuple[Number, ...], Field(min_length=8, max_length=8)], ...] | None,
        Field(min_length=8, max_length=8),
    ] = None

    @property
    def coefficients(self) -> FloatArray:
        """OpenCV's k₁, k₂, p₁, p₂, k₃, (5,)."""
        return np.array([*self.distortion, 0.0, 0.0, 0.0][:5])

    @property
    def numbers(self) -> FloatArray:
        """Focal length, centre and `coefficients`, (8,)."""
        return np.array([self.focal_px, *self.centre_px, *self.coefficients])

    @property
    def matrix(self) -> FloatArray:
        """OpenCV's camera matrix, (3, 3)."""
        (u, v), f = self.centre_px, self.focal_px
        return np.array([[f, 0.0, u], [0.0, f, v], [0.0, 0.0, 1.0]])

    def straight_pixels(self, pixels: FloatArray) -> FloatArray:
        """Pixels (n, 2) of a picture as the same places lie without distortion."""
        seen = np.asarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
        bent = self.coefficients
        return np.asarray(cv2.undistortPoints(seen, self.matrix, bent, P=self.matrix))[:, 0]

    def straighten(self, image: NDArray[Any], source: Path) -> NDArray[Any]:
        """Picture without distortion, of its own size.

        Raises
        ------
        PictureError
            When it is of another size than the board's pictures were.
        """
        if image.shape[1::-1] != self.size_px:
            wide, high = self.size_px
            raise PictureError(
                f"{source} has {image.shape[1]} x {image.shape[0]} px, and the camera was "
                f"calibrated at {wide} x {high}; take pictures as those of the board, not cropped "
                "or resized"
            )
        across, down = _sources(self)
        border = cv2.BORDER_REPLICATE  # a black one would look like ink
        return np.asarray(cv2.remap(image, across, down, cv2.INTER_CUBIC, borderMode=border))

    @property
    def bends_px(self) -> float:
        """Farthest that the distortion moves a place of the picture's border."""
        wide, high = self.size_px
        u, v = np.meshgrid(np.linspace(0, wide - 1, 9), np.linspace(0, high - 1, 9))
        places = np.column_stack([u.ravel(), v.ravel()])
        return float(np.hypot(*(self.straight_pixels(places) - places).T).max())


@lru_cache(maxsize=1)
def _sources(lens: Lens) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Columns and rows of the picture that each pixel without distortion is taken from."""
    matrix = lens.matrix
    across, down = cv2.initUndistortRectifyMap(
        matrix, lens.coefficients, np.eye(3), matrix, lens.size_px, cv2.CV_32FC1
    )
    return np.asarray(across, dtype=np.float32), np.asarray(down, dtype=np.float32)


def write_lens(path: Path, lens: Lens) -> None:
    """Write a lens that `read_lens` reads back exactly.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    held = lens.model_dump(mode="json", exclude_none=True)
    write_text(path, yaml.safe_dump(held, sort_keys=False))


def read_lens(path: Path, option: str = "--camera") -> Lens:
    """Read a lens that the user named by an option.

    Raises
    ------
    PictureError
        When the file is missing, or isn't one.
    """
    return read_model(path, Lens, option, "printctl calibrate camera")
