"""Grid in the printer's plane on which a scene is drawn, and its map to the camera's pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from sim.devices.camera.optics import Camera, through_surface
from sim.errors import CameraError

SingleArray = NDArray[np.float32]

_COARSE: Final = 8
"""Pixels between those whose place is computed; the map is smooth between them."""
_MARGIN: Final = 4
_MOST_PIXELS: Final = 60_000_000


@dataclass(frozen=True)
class Plan:
    """Drawing plane: the bath's surface, or the top of the ink where there is none.

    Attributes
    ----------
    camera : Camera
    z_mm : float, mm
    index : float
        Refractive, of what lies below.
    origin_mm : (2,) float64, mm
        Centre of the first pixel; rows go to +y.
    pitch_mm : float, mm
        Of the pixels: one of the camera's at the target.
    shape : (rows, columns)
    """

    camera: Camera
    z_mm: float
    index: float
    origin_mm: FloatArray
    pitch_mm: float
    shape: tuple[int, int]

    @staticmethod
    def under(camera: Camera, z_mm: float, index: float) -> Plan:
        """All that the camera sees of a plane.

        Raises
        ------
        CameraError
            When it looks past it, or from below.
        """
        high = float(camera.eye_mm[2] - z_mm)
        if high <= 1.0:
            raise CameraError(
                f"the camera is {high:g} mm above the drawn plane (z {z_mm:g} mm); it must be more "
                "than 1 mm: raise distance_mm, or mend target_mm"
            )
        edge = camera.on_plane(_border(camera), z_mm)
        pitch = camera.um_per_px * 1e-3 * high / float(camera.eye_mm[2] - camera.target_mm[2])
        low = edge.min(axis=0) - _MARGIN * pitch
        columns, rows = np.ceil((edge.max(axis=0) - low) / pitch).astype(int) + _MARGIN + 1
        if rows * columns > _MOST_PIXELS:
            raise CameraError(
                f"the field of {columns} by {rows} pixels in the dish's plane is too large; lower "
                "tilt_deg or size_px"
            )
        return Plan(camera, z_mm, index, low, pitch, (int(rows), int(columns)))

    def seen_at(self, points_mm: FloatArray) -> FloatArray:
        """Pixels (n, 2) of the plane where places (n, 3), mm, are seen."""
        at = through_surface(points_mm, self.camera.eye_mm, self.z_mm, self.index)
        return np.asarray((at - self.origin_mm) / self.pitch_mm)

    def scale(self, z_mm: FloatArray) -> FloatArray:
        """Pixels of the plane in a mm at heights (n,); straight below the eye."""
        high = self.camera.eye_mm[2] - self.z_mm
        deep = self.z_mm - np.asarray(z_mm)
        apparent = np.where(deep > 0, deep / self.index, deep)
        return np.asarray(high / (high + apparent) / self.pitch_mm)

    def below(self, z_mm: float) -> Plan:
        """The same pixels on a lower plane, where the camera sees it through this one's in air."""
        eye = self.camera.eye_mm
        scale = float((eye[2] - z_mm) / (eye[2] - self.z_mm))
        origin = eye[:2] + scale * (self.origin_mm - eye[:2])
        return replace(self, z_mm=z_mm, origin_mm=origin, pitch_mm=self.pitch_mm * scale)

    def photograph(self, drawn: SingleArray) -> SingleArray:
        """The drawn plane (rows, columns, colours) as the camera's lens throws it."""
        width, height = self.camera.size_px
        coarse_u = np.arange(0, width + _COARSE, _COARSE, dtype=np.float64)
        coarse_v = np.arange(0, height + _COARSE, _COARSE, dtype=np.float64)
        u, v = np.meshgrid(coarse_u, coarse_v)
        at = self.camera.on_plane(np.column_stack([u.ravel(), v.ravel()]), self.z_mm)
        places = ((at - self.origin_mm) / self.pitch_mm).reshape(*u.shape, 2).astype(np.float32)
        # A pixel's share of the way between two coarse ones is an eighth: exact in OpenCV.
        fine = np.array([[1 / _COARSE, 0, 0], [0, 1 / _COARSE, 0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        maps = [
            cv2.warpAffine(np.ascontiguousarray(places[..., k]), fine, (width, height), flags=flags)
            for k in range(2)
        ]
        image = cv2.remap(
            drawn, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(image).reshape(height, width, -1)


def _border(camera: Camera) -> FloatArray:
    """Pixels along the picture's rim."""
    width, height = camera.size_px
    u, v = np.linspace(-1, width, 65), np.linspace(-1, height, 65)
    rim = [
        np.column_stack([u, np.full(65, -1.0)]),
        np.column_stack([u, np.full(65, float(height))]),
        np.column_stack([np.full(65, -1.0), v]),
        np.column_stack([np.full(65, float(width)), v]),
    ]
    return np.concatenate(rim)
