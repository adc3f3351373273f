"""Pictures of a layer from volumes (OCT) and height maps (laser profiler).

Begin with `height.py`.
"""
