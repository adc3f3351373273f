"""Test pictures through a known lens, ray-traced independently of the product."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from registration.devices.lens import Board, board_picture

FINE = 2


@dataclass(frozen=True)
class Rig:
    """A camera over a plane: the plane's middle at a distance, tilted by degrees about x, y, z."""

    size_px: tuple[int, int] = (600, 460)
    focal_px: float = 1800.0
    distortion: tuple[float, float] = (0.0, 0.0)
    um_per_px: float = 37.0
    tilt_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def middle_px(self) -> np.ndarray:
        return (np.array(self.size_px) - 1) / 2

    def ideal(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) as a lens without distortion would show the same places."""
        seen = (pixels - self.middle_px) / self.focal_px
        place = seen.copy()
        for _ in range(12):
            square = (place**2).sum(axis=1, keepdims=True)
            place = seen / (1 + self.distortion[0] * square + self.distortion[1] * square**2)
        return place * self.focal_px + self.middle_px

    def places(self, pixels: np.ndarray) -> np.ndarray:
        """Places of the plane, (n, 2) mm from its middle, that pixels (n, 2) show."""
        flat = (self.ideal(pixels) - self.middle_px) / self.focal_px
        rays = np.column_stack([flat, np.ones(len(flat))])
        turn = Rotation.from_euler("xyz", self.tilt_deg, degrees=True).as_matrix()
        middle = np.array([0.0, 0.0, self.um_per_px * 1e-3 * self.focal_px])
        reach = (turn[:, 2] @ middle) / (rays @ turn[:, 2])
        return ((rays * reach[:, None] - middle) @ turn)[:, :2]

    @property
    def true_um_per_px(self) -> float:
        """In the picture's middle, the root of a pixel's area."""
        a, b, c = self.places(self.middle_px + np.array([[0, 0], [1, 0], [0, 1]]))
        (x0, y0), (x1, y1) = b - a, c - a
        return 1e3 * float(np.sqrt(abs(x0 * y1 - y0 * x1)))

    def picture(self, bright: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Mean of what lies under each pixel, (h, w); ``bright`` of places (n, 2)."""
        wide, high = self.size_px
        u, v = np.meshgrid(*((np.arange(n * FINE) + 0.5) / FINE - 0.5 for n in (wide, high)))
        seen = bright(self.places(np.column_stack([u.ravel(), v.ravel()])))
        return seen.reshape(high, FINE, wide, FINE).mean(axis=(1, 3))


def photographed(board: Board, rig: Rig, seed: int = 0, noise: float = 2.0) -> np.ndarray:
    """Picture of a board, its middle in the picture's, blurred, noisy and unevenly lit, 8 bits."""
    dots = 40.0
    printed = board_picture(board, dots * 25.4).astype(np.float32)
    middle = (np.array(printed.shape[::-1]) - 1) / 2

    def bright(places: np.ndarray) -> np.ndarray:
        u, v = (places * dots + middle).astype(np.float32).T.reshape(2, -1, 1200)
        ink = cv2.remap(printed, u, v, cv2.INTER_LINEAR, borderValue=255.0)
        return ink.ravel()

    image = cv2.GaussianBlur(40 + 0.7 * rig.picture(bright), (0, 0), 0.8)
    image *= np.linspace(1, 0.8, image.shape[1])
    image += np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)
