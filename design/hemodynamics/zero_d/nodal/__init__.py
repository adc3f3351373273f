"""Direct solver of network equations on any graph: trees folded, loops factorised.

Goes in: a graph's conductances and sources. Comes out: potentials of its nodes. Begin with
`conductance.py`.
"""
