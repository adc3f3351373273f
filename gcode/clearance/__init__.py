"""Check embedded G-code for needle shaft contact with written ink, independently of the planner.

Goes in: an embedded job, its network, its needles. Comes out: contacts by line and vessel. Begin
with `check.py`.
"""
