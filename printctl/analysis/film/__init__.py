"""Make films of a network: its growth, or a pressure or flow pulse through it.

Goes in: a run folder or a network. Comes out: frames, and a film file. Begin with `growth.py`.
"""

from printctl.analysis.film.film_file import SUFFIXES, write_film
from printctl.analysis.film.growth import GrowthFilm, growth_frames
from printctl.analysis.film.pulse import PulseFilm, pulse_frames

__all__ = [
    "SUFFIXES",
    "GrowthFilm",
    "PulseFilm",
    "growth_frames",
    "pulse_frames",
    "write_film",
]
