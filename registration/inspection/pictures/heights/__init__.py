"""Pictures of a layer made from volumes (OCT) and height maps (laser profiler).

Begin with `height.py`.
"""
