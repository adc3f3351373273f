"""Smooth surfaces of vessel junctions: single ones, and groups of overlapping ones.

Goes in: a network. Comes out: its lumen as one closed surface with rounded junctions. Begin with
`assemble.py`.
"""
