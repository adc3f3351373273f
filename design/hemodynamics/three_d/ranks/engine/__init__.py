"""Solve steady 3D flow in a lumen on MPI ranks, by FEniCSx and PETSc.

::

    cd CASE_FOLDER
    mpirun -n 8 python3 -m engine . [options of PETSc]

It imports nothing of printctl, so that it can be copied to a cluster with the case, which
`write_case` does (`case.json`, and arrays that every rank reads its share of). It leaves
`ranks.json`, `velocity.npy` (a row a node) and `pressure.npy` (a value a corner) there.

Find u (quadratic) and p (linear, both on quadratic tetrahedra), with u given at the wall and at
ports of kind ``profile``, so that for all v and q, v vanishing where u is given,

    ∫ μ ∇u:∇v + ϱ (∇u u)·v - p ∇·v - q ∇·u dx
        + Σ_k p_k ∫_k v·n ds - ½ ϱ Σ_o ∫_o min(u·n, 0) u·v ds = 0,

k the open ports, o those of them that are outlets; what has ϱ for ``navier_stokes`` alone. p_k is
given, or the unknown of a group of ports whose flow outward, Q = Σ ∫ u·n ds, obeys Q - D p = s
(a resistance: D = 1/R; a supply: D = 0). So nothing but -p n acts where a port is open:
Poiseuille's flow leaves it undisturbed. The last term keeps backflow from feeding energy in
(Bazilevs et al. 2009, doi 10.1016/j.cma.2009.04.015).

FEniCSx 0.5 to 0.9; what differs is in `partition` (`elements`, `rows`, `distributed`) and in the
name of the function that makes a space (`problem`).

Begin with `solve.py`.
"""
