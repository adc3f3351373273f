"""Pictures of a layer as they are judged: cropped, in one light, heights as shares of the layer.

Begin with `picture.py`; `heights` makes pictures of volumes and height maps.
"""
