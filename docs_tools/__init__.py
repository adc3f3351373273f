"""Generators of documentation pages; not part of the product.

Goes in: the command line's help and the examples. Comes out: pages below `docs/`. Begin with
`commands.py`.
"""
