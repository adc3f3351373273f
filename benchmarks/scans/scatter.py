"""Scatterers along a B-scan's A-scans, summed in fine depth cells.

Equivalent formulation: scatterers have circular Gaussian complex reflectivities, Poisson numbers
and random phases. Their places are rounded to a fine cell (an eighth of a voxel, far below the
resolution); the phase that the rest of the place would give is in the random phase. Within one
medium the sum of n of them is drawn at once as sqrt(n) times one; beside a wall each is placed.
Speckle of N scatterers in a resolution volume has a contrast of sqrt(1 + 2 / N): 1.15 at the
default of 1.2 in a cell (N about 6), 1.02 at 12.
"""

# numba knows the legacy generator only for seeds of its own.
# ruff: noqa: NPY002

from __future__ import annotations

import math

import numba as nb
import numpy as np

GEL, LUMEN, BATH = 0, 1, 2


@nb.njit(cache=True)
def medium(lumen, body):
    """Return the medium at given distances to the lumens' walls and beyond the body."""
    if body > 0:
        return BATH
    return LUMEN if lumen < 0 else GEL


@nb.njit(cache=True)
def at_depth(column, z, dz):
    """Interpolate a column of samples every `dz`."""
    place = z / dz
    k = min(int(place), len(column) - 2)
    return column[k] + (place - k) * (column[k + 1] - column[k])


@nb.njit(cache=True)
def facing(cosine, specular):
    """Return the share of a wall's reflection that the lens takes, by the wall's slope."""
    slope2 = 1 / max(cosine * cosine, 1e-3) - 1
    return math.exp(-slope2 / specular[1] ** 2) + specular[2] * math.exp(-slope2 / 0.2)


@nb.njit(cache=True)
def reflection(wall, z, dz_field, delta, specular, carrier):
    """Return the phased amplitude of a wall crossed between z - delta and z."""
    here = at_depth(wall[0], z, dz_field)
    step = abs(here - at_depth(wall[0], z - delta, dz_field))
    along, aside = at_depth(wall[1], z, dz_field), at_depth(wall[2], z, dz_field)
    # A rough wall's distance grows faster than the way: its gradient isn't a unit.
    cosine = step / math.sqrt(step * step + delta * delta * (along**2 + aside**2))
    phase = carrier * (z - min(abs(here) / max(step, 1e-9), 1.0) * delta)
    return complex(math.cos(phase), math.sin(phase)) * specular[0] * facing(cosine, specular)


@nb.njit(cache=True)
def cast(
    field, dz_field, delta, count, density, power, loss, beam, index, specular, carrier, seed,
    amplitude, mean,
):  # fmt: skip
    """Add the light of single scattering to amplitude (nx, m); its mean power goes to mean (nx, m).

    Parameters
    ----------
    field : (2, 3, nx, nz)
        Distances and lateral gradients of `geometry.bscan`, every `dz_field` mm.
    delta : float, mm
        Depth of a fine cell.
    count : float
        Mean number of scatterers of the densest medium in a cell of the beam.
    density, power, loss, index : (3,) float
        Of gel, lumen, bath: density relative to the densest; mean power per cell; attenuation of
        the intensity, 1/mm, one way; group index over the file's.
    beam : (3,) float, mm
        Radius of the waist (1/e2 of intensity; by light's way in and out
        scatterers seen spread by 1/sqrt(8) of it, one sd), depth of the focus, Rayleigh range.
    specular : (3,) float
        Amplitude of a wall's reflection at normal incidence, its width in slope, diffuse share.
    carrier : float, 1/mm
        2 k0, for the phase of reflections.
    """
    np.random.seed(seed)
    nx, m = amplitude.shape
    for x in range(nx):
        path, depth, before = 0.0, 0.0, BATH
        for c in range(m):
            z = c * delta
            if z > (field.shape[3] - 1) * dz_field:
                break
            lumen = at_depth(field[0, 0, x], z, dz_field)
            body = at_depth(field[1, 0, x], z, dz_field)
            now = medium(lumen, body)
            # Amplitude; two ways of intensity's loss are one way's square.
            light = math.exp(-path)
            u = (z - beam[1]) / beam[2]
            focus = 1.0 / math.sqrt(1.0 + u * u)
            wide = beam[0] * math.sqrt((1.0 + u * u) / 8)
            cell = int(depth / delta)
            if cell >= m:
                break
            if min(abs(lumen), abs(body)) > 4 * wide:
                n = np.random.poisson(count * density[now])
                size = math.sqrt(n * power[now] / (2 * count * density[now])) * light * focus
                amplitude[x, cell] += complex(np.random.normal() * size, np.random.normal() * size)
                mean[x, cell] += power[now] * (light * focus) ** 2
            else:
                column, seen = field[:, :, x], light * focus
                rows = (amplitude[x], mean[x])
                edge(column, z, dz_field, count, density, power, seen, wide, rows, cell)
            if now != before and c > 0 and now + before != LUMEN + BATH:
                which = 0 if now + before == GEL + LUMEN else 1
                wall = field[which, :, x]
                phased = reflection(wall, z, dz_field, delta, specular, carrier)
                amplitude[x, cell] += phased * light * focus
            before = now
            path += loss[now] * delta
            depth += index[now] * delta


@nb.njit(cache=True)
def edge(column, z, dz, count, density, power, light, wide, rows, cell):
    """Place the scatterers of a cell beside a wall one by one, in an A-scan's two rows."""
    amplitude, mean = rows
    d = np.empty(6)
    for k in range(6):
        d[k] = at_depth(column[k // 3, k % 3], z, dz)
    n = np.random.poisson(count)
    for _ in range(n):
        across, down = np.random.normal() * wide, np.random.normal() * wide
        kind = medium(d[0] + d[1] * across + d[2] * down, d[3] + d[4] * across + d[5] * down)
        mean[cell] += power[kind] * light * light / count
        if np.random.random() < density[kind]:
            size = math.sqrt(power[kind] / (2 * count * density[kind])) * light
            amplitude[cell] += complex(np.random.normal() * size, np.random.normal() * size)


@nb.njit(cache=True)
def tail(mean, delta, share, length, blur, seed, amplitude):
    """Add multiply scattered light, delayed by `length` (mm, exponential), blurred over A-scans."""
    np.random.seed(seed)
    nx, m = mean.shape
    keep = math.exp(-delta / length)
    late = np.zeros((nx, m))
    for x in range(nx):
        held = 0.0
        for c in range(m):
            held = keep * held + (1 - keep) * mean[x, c]
            late[x, c] = held
    for c in range(m):
        for x in range(nx):
            total, n = 0.0, 0
            for other in range(max(0, x - blur), min(nx, x + blur + 1)):
                total += late[other, c]
                n += 1
            size = math.sqrt(share * total / n / 2)
            amplitude[x, c] += complex(np.random.normal() * size, np.random.normal() * size)
