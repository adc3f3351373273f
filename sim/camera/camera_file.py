"""Read a simulated camera's YAML file: camera, scene, and how the record becomes ink."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from firmware_profiles.wrong_values import wording
from firmware_profiles.yaml_file import read_yaml
from sim.camera.optics import Camera
from sim.camera.scene import Scene
from sim.errors import CameraError


class InkSource(BaseModel):
    """How executed motion becomes ink.

    Attributes
    ----------
    printer, syringe, ink : str
        Profiles: shipped name, or path of a .yaml. Without an ink as much comes out as is pushed.
    head : int
        Of a printer with several: whose ink is seen.
    style : "layered" or "embedded" or None
        None decides from the motion.
    layer_mm : float or None, mm
        Height of the lines while there is but one level.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    printer: str
    syringe: str
    ink: str | None = None
    head: Annotated[int, Field(ge=0, le=15)] = 0
    style: Literal["layered", "embedded"] | None = None
    layer_mm: Annotated[float, Field(gt=0, le=10)] | None = None


class CameraFile(BaseModel):
    """A simulated camera over a simulated printer."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: Camera
    scene: Scene = Scene()
    laid: InkSource


def load_camera(path: Path) -> CameraFile:
    """Read a camera's file.

    Raises
    ------
    CameraError
        When it can't be read, or has a key or value that means nothing.
    """
    try:
        return CameraFile.model_validate(read_yaml(path.read_text(encoding="utf-8")) or {})
    except OSError as exc:
        raise CameraError(f"camera file {path} can't be read: {exc.strerror}") from exc
    except yaml.YAMLError as exc:
        raise CameraError(f"camera file {path} isn't YAML: {exc}") from exc
    except ValidationError as exc:
        problems = "; ".join(
            f"{'.'.join(map(str, problem['loc'])) or 'file'}: {wording(problem)}"
            for problem in exc.errors()
        )
        raise CameraError(f"camera file {path}: {problems}") from exc
