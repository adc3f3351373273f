"""G-code without a recipe: slicing, lumens, widths, views.

Goes in: G-code or a mesh. Comes out: a job and what is known of it. Begin with `slicing.py`.
"""
