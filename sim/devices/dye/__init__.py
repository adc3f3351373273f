"""Simulated dye video: dye driven through a transparent print, filmed from one side.

Goes in: a network, its occlusions and flow. Comes out: a video whose answer is known. Begin with
`film.py`.
"""

from sim.devices.dye.film import Disturbance, Dye, DyeCamera, DyeFilm, film_frames, write_film
from sim.devices.dye.lumens import DyeFlow, DyeVessels, Occlusion, dye_flow

__all__ = [
    "Disturbance",
    "Dye",
    "DyeCamera",
    "DyeFilm",
    "DyeFlow",
    "DyeVessels",
    "Occlusion",
    "dye_flow",
    "film_frames",
    "write_film",
]
