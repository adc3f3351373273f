"""Build a network's lumen as one closed surface with rounded junctions.

Goes in: a network. Comes out: its lumen as one closed surface with rounded junctions. Begin with
`assemble.py`.
"""
