"""A print's job: its lines, marks, coordinates, limits, syringe changes and inserts.

Goes in: a G-code file and a profile. Comes out: the lines to send and what is known of them. Begin
with `job.py`.
"""
