"""Widths of beads by profiles that are summed up here cell by cell, blurred in light."""

import numpy as np
import pytest

from registration.layer_images.in_light import LightMix
from registration.layer_images.optics import Optics, fit_optics

PX = 0.02
ACROSS = np.linspace(0.0, 0.36, 25)


def seen(
    width: float, densities: tuple[float, ...], blur_px: float, gamma: float, opaque: bool
) -> np.ndarray:
    """Logarithms of what a camera shows of a bead's half, (25, c)."""
    fine = np.arange(-0.8, 0.8, 0.0005) + 0.00025
    chord = np.sqrt(np.maximum(1.0 - (2.0 * fine / width) ** 2, 0.0))
    channels = []
    for density in densities:
        light = np.exp(-density * ((chord > 0) if opaque else chord))
        weight = np.exp(-0.5 * ((fine[None] - ACROSS[:, None]) / (blur_px * PX)) ** 2)
        channels.append(np.log((weight * light).sum(axis=1) / weight.sum(axis=1)) / gamma)
    return np.column_stack(channels)


def fitted(logs: np.ndarray, noise: float = 0.002) -> Optics:
    rng = np.random.default_rng(1)
    logs = logs + rng.normal(0.0, 0.3 * noise, logs.shape)
    ink = logs[0]
    return fit_optics(ACROSS, logs, LightMix.of(ink, ink, True), 0.3, PX, noise)


@pytest.mark.parametrize("gamma", [1.0, 2.2])
@pytest.mark.parametrize("density", [0.2, 0.8, 1.8, -0.6])
@pytest.mark.parametrize("blur_px", [0.6, 1.2])
def test_a_clear_dye_is_as_wide_as_it_is(density: float, blur_px: float, gamma: float) -> None:
    optics = fitted(seen(0.3, (density,), blur_px, gamma, False))
    assert optics.diameter_mm == pytest.approx(0.3, rel=0.03)
    assert abs(optics.diameter_mm / 0.3 - 1.0) < 2.0 * optics.shade.spread + 0.005
    assert optics.shade.spread < 0.06


@pytest.mark.parametrize("density", [0.2, 0.8, 1.8, -0.6])
def test_an_opaque_ink_is_as_wide_as_it_is(density: float) -> None:
    optics = fitted(seen(0.3, (density,), 1.0, 1.0, True))
    assert optics.diameter_mm == pytest.approx(0.3, rel=0.03)
    assert abs(optics.diameter_mm / 0.3 - 1.0) < 2.0 * optics.shade.spread


@pytest.mark.parametrize("opaque", [False, True])
def test_blur_that_hides_which_ink_it_is_widens_the_interval(opaque: bool) -> None:
    sharp, soft = (fitted(seen(0.24, (0.8,), blur, 1.0, opaque), 0.01) for blur in (0.6, 3.5))
    assert soft.shade.spread > 0.05 > sharp.shade.spread
    for one in (sharp, soft):
        assert abs(one.diameter_mm / 0.24 - 1.0) < 2.0 * one.shade.spread


def test_colours_tell_a_dye_from_an_opaque_ink_where_blur_hides_it() -> None:
    # A dye is wider in the channel that it darkens more; an opaque ink isn't.
    dye = fitted(seen(0.3, (0.3, 1.8), 2.5, 1.0, False))
    opaque = fitted(seen(0.3, (0.3, 1.8), 2.5, 1.0, True))
    for one in (dye, opaque):
        assert one.diameter_mm == pytest.approx(0.3, rel=0.03)
