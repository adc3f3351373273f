"""Preparation of pictures: cropped, evenly lit, heights relative to the layer.

Begin with `picture.py`; `heights` makes pictures of volumes and height maps.
"""
