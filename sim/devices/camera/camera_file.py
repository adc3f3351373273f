"""Read a simulated camera's YAML file: camera, scene, and how the record becomes ink."""

from __future__ import annotations

from pathlib import Path

from pydantic import BaseModel, ConfigDict

from sim.devices.camera.optics import Camera
from sim.devices.camera.scene import Scene
from sim.devices.recorded_ink import InkSource
from sim.errors import CameraError
from sim.model_file import read_model


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
    return read_model(path, CameraFile, "camera file", CameraError)
