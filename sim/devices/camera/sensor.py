"""Blur, vignetting, noise, gamma and compression: from light on the sensor to a picture."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.devices.camera.scene import Sensor

SingleArray = NDArray[np.float32]
ByteArray = NDArray[np.uint8]

_WHITE: Final = 255.0


def exposed(light: SingleArray, sensor: Sensor, generator: np.random.Generator) -> ByteArray:
    """Take a picture: (h, w, 3), blue, green, red, or (h, w) of a sensor without colours.

    Parameters
    ----------
    light : (h, w, 3 or 1) float32
        Red, green, blue, or grey alone; grey levels.
    """
    blurred = _moved(light, sensor.motion_px)
    if sensor.blur_px > 0:
        blurred = cv2.GaussianBlur(blurred, (0, 0), sensor.blur_px)
    blurred = blurred.reshape(light.shape)[..., ::-1]
    blurred = blurred * _vignette(light.shape[:2], sensor.vignetting)
    picture = _counted(blurred, sensor, generator)
    if sensor.mono:
        picture = picture[..., 0]
    if sensor.jpeg_quality is not None:
        quality = [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg_quality]
        packed = cv2.imencode(".jpg", picture, quality)[1]
        picture = np.asarray(cv2.imdecode(packed, cv2.IMREAD_UNCHANGED), np.uint8)
    return picture


def _moved(light: SingleArray, way_px: tuple[float, float]) -> SingleArray:
    """Smeared evenly along a straight way."""
    long = float(np.hypot(*way_px))
    if long < 1e-6:
        return light
    steps = max(2, int(np.ceil(2 * long)) + 1)
    half = int(np.ceil(long / 2)) + 1
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for share in np.linspace(-0.5, 0.5, steps):
        x, y = half + share * way_px[0], half + share * way_px[1]
        i, j = int(np.floor(x)), int(np.floor(y))
        u, v = x - i, y - j
        kernel[j, i] += (1 - u) * (1 - v)
        kernel[j, i + 1] += u * (1 - v)
        kernel[j + 1, i] += (1 - u) * v
        kernel[j + 1, i + 1] += u * v
    return np.asarray(cv2.filter2D(light, -1, kernel / kernel.sum()))


def _vignette(shape: tuple[int, ...], fall: float) -> SingleArray:
    rows, columns = shape
    most = ((rows / 2) ** 2 + (columns / 2) ** 2) / fall if fall else np.inf
    y = ((np.arange(rows) - (rows - 1) / 2) ** 2 / most).astype(np.float32)
    x = ((np.arange(columns) - (columns - 1) / 2) ** 2 / most).astype(np.float32)
    factor = (1 - y)[:, None] - x[None, :]
    return factor[..., None]


def _counted(light: SingleArray, sensor: Sensor, generator: np.random.Generator) -> ByteArray:
    """Shot and read noise, the sensor's limit, gamma, 8 bits."""
    np.clip(light, 0, 4 * _WHITE, out=light)
    noise = light * np.float32(_WHITE / sensor.full_well)
    noise += np.float32(sensor.read_noise**2)
    np.sqrt(noise, out=noise)
    noise *= generator.standard_normal(light.shape, dtype=np.float32)
    light += noise
    np.clip(light, 0, _WHITE, out=light)
    if sensor.gamma != 1:
        light = _WHITE * (light / _WHITE) ** np.float32(1 / sensor.gamma)
    return np.ascontiguousarray(np.round(light, out=light).astype(np.uint8))
