"""Networks in colour: what vessels can be coloured by, and pictures drawn without a browser."""

from registration.picture.camera import DIRECTIONS, Camera, View, fitted_camera
from registration.picture.compose import PictureOptions, draw_picture
from registration.picture.quantities import FLOW, GAUGED, Colour, Known, quantities
from registration.picture.quantity import Quantity
from registration.picture.shade import Surface

__all__ = [
    "DIRECTIONS",
    "FLOW",
    "GAUGED",
    "Camera",
    "Colour",
    "Known",
    "PictureOptions",
    "Quantity",
    "Surface",
    "View",
    "draw_picture",
    "fitted_camera",
    "quantities",
]
