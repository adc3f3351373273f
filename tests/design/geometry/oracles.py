"""Slow oracles for distances."""

import numpy as np


def point_segment(p, a, b):
    t = np.linspace(0.0, 1.0, 20_001)[:, None]
    return np.linalg.norm(a + t * (b - a) - p, axis=1).min()


def segment_segment(a, b, c, d):
    """Least distance over the interior optimum and the four ends, by plain algebra."""
    ends = [_exact(a, c, d), _exact(b, c, d), _exact(c, a, b), _exact(d, a, b)]
    u, v, w = b - a, d - c, a - c
    across = np.dot(u, u) * np.dot(v, v) - np.dot(u, v) ** 2
    if across > 1e-12:
        s = (np.dot(u, v) * np.dot(v, w) - np.dot(v, v) * np.dot(u, w)) / across
        t = (np.dot(u, u) * np.dot(v, w) - np.dot(u, v) * np.dot(u, w)) / across
        if 0 <= s <= 1 and 0 <= t <= 1:
            ends.append(np.linalg.norm(w + s * u - t * v))
    return min(ends)


def _exact(p, a, b):
    u = b - a
    length2 = np.dot(u, u)
    t = 0.0 if length2 == 0 else np.clip(np.dot(p - a, u) / length2, 0, 1)
    return np.linalg.norm(a + t * u - p)


def point_triangle(p, a, b, c):
    """Distance by the plane where the foot falls inside, else by the edges."""
    normal = np.cross(b - a, c - a)
    best = min(_exact(p, a, b), _exact(p, b, c), _exact(p, c, a))
    size = np.dot(normal, normal)
    if size > 0:
        foot = p - normal * np.dot(p - a, normal) / size
        sides = [np.dot(np.cross(y - x, foot - x), normal) for x, y in ((a, b), (b, c), (c, a))]
        if min(sides) >= 0:
            best = min(best, np.linalg.norm(foot - p))
    return best
