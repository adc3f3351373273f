"""Render a simulated camera's picture of the dish from laid ink, camera and scene.

Modelled
--------
- Camera: pinhole, lens distortion, tilt, turn, any place; refraction at the bath's flat surface.
- Ink: each line as wide as its dose makes it, thick in its middle, translucent, with a colour of
  its own; rims darker or brighter; ridges lit from one side; what was laid before below it, fading
  with the bath's turbidity; ink that is missing by faults (`sim.gcode.deposit.lay`).
- Bath: granules of several sizes, which lie still from look to look; light of its own over deep
  ink. Uneven light.
- Sensor: blur, vignetting, shot and read noise, gamma.

Not modelled
------------
Glints, bubbles and dirt, markers, the dish's rim, the needle in the view (`benchmarks/checkers`
paint them, to judge the inspection); shadows, ink that a needle drags, crevices it leaves in the
bath, focus that changes with depth, scattering from line to line, a bath that dries, rolling
shutter, the sensor's colour mosaic, saturation that blooms. Deep ink hides no other deep ink: their
thicknesses add up. Refraction moves places, and its scale is that straight below the camera.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from sim.devices.camera.ink_map import ink_map
from sim.devices.camera.lighting import exposed, lit
from sim.devices.camera.optics import Camera
from sim.devices.camera.plan import Plan
from sim.devices.camera.scene import Scene
from sim.devices.recorded_ink import InkSource
from sim.errors import CameraError
from sim.gcode.deposit.lay import Laid
from sim.user_files import read_model


def paint(ink: Laid, camera: Camera, scene: Scene, seed: int) -> NDArray[np.uint8]:
    """Return a picture: (h, w, 3) in blue, green, red, or (h, w) of a sensor without colours.

    Same ink, camera, scene and seed, same bytes.

    Parameters
    ----------
    ink : Laid
    camera : Camera
    scene : Scene
        Its own seed is of what lies in the dish.
    seed : int
        Of the sensor's noise: another one for another look.

    Raises
    ------
    CameraError
        When the camera sees past the dish.
    """
    index = 1.0 if scene.bath.surface_z_mm is None else scene.bath.refractive_index
    plan = Plan.under(camera, _plane_z(ink, camera, scene), index)
    drawn_ink = ink_map(ink, plan, scene.ink, scene.bath)
    drawn = lit(drawn_ink, plan, scene, _ground(ink, plan, scene))
    return exposed(plan.photograph(drawn), scene.sensor, np.random.default_rng((seed, 11)))


def _ground(ink: Laid, plan: Plan, scene: Scene) -> Plan:
    """Where granules lie: without a surface below the ink, so that they don't rise with it."""
    if scene.bath.surface_z_mm is not None or not len(ink.strands):
        return plan
    tip = np.minimum(ink.strands.start[:, 2], ink.strands.end[:, 2])
    return plan.below(float((tip - ink.height_mm).min()))


def _plane_z(ink: Laid, camera: Camera, scene: Scene) -> float:
    """Height of the plane that is drawn, mm."""
    if scene.bath.surface_z_mm is not None:
        return scene.bath.surface_z_mm
    if not len(ink.strands):
        return camera.target_mm[2]
    return float(max(ink.strands.start[:, 2].max(), ink.strands.end[:, 2].max()))


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
