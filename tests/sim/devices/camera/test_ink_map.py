"""Kernel of the simulated camera, against plain NumPy."""

from __future__ import annotations

import numpy as np

from sim.devices.camera.ink_map import draw_lines


def naive(segments, radius, crest, height, weight, profile, shape):
    """Every pixel against every line."""
    thick, top = np.zeros(shape), np.full(shape, -np.inf)
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    for s, (x0, y0, x1, y1) in enumerate(segments):
        way = np.array([x1 - x0, y1 - y0])
        t = np.clip(((x - x0) * way[0] + (y - y0) * way[1]) / (way @ way), 0, 1)
        away = np.hypot(x - x0 - t * way[0], y - y0 - t * way[1])
        cover = np.clip(radius[s] - away + 0.5, 0, 1)
        last = len(profile) - 1
        place = np.minimum((away / radius[s]) ** 2 * last, last).astype(int)
        share = profile[place] * cover
        thick = np.maximum(thick, weight[s] * height[s] * share)
        line_top = crest[s, 0] + t * (crest[s, 1] - crest[s, 0]) - height[s] * (1 - share)
        top = np.where(cover > 0, np.maximum(top, line_top), top)
    return thick, top


def test_lines_are_drawn_as_by_every_pixel_against_every_line():
    generator = np.random.default_rng(1)
    shape, count = (60, 80), 15
    segments = generator.uniform(-10, 90, (count, 4))
    radius, height = generator.uniform(0.4, 8, count), generator.uniform(0.05, 0.3, count)
    crest, weight = generator.uniform(0, 2, (count, 2)), generator.uniform(0.2, 1, count)
    profile = np.maximum(np.linspace(1, 0, 1025) ** 0.25, 0.15)
    thick, top = np.zeros(shape, np.float32), np.full(shape, -np.inf, np.float32)
    above = np.zeros(shape, np.float32)
    above[:, 70:] = 2.0
    draw_lines(segments, radius, crest, height, weight, profile, above, 1.0, thick, top)
    wanted = naive(segments, radius, crest, height, weight, profile, shape)
    # A pixel may fall into the next step of the profile by rounding.
    np.testing.assert_allclose(thick[:, :70], wanted[0][:, :70], atol=1e-3)
    np.testing.assert_allclose(top[:, :70], wanted[1][:, :70], atol=1e-3)
    assert not thick[:, 70:].any()
