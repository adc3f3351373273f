"""Programs that start a machine's process or talk to it.

Goes in: orders. Comes out: answers. Begin with `client.py`.
"""
