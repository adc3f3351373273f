"""One print from its first line to its end: pauses, inspections, stops.

Goes in: a job. Comes out: its outcome. Begin with `streamer.py`.
"""
