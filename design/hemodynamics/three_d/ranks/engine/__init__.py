"""Steady flow in a lumen on MPI ranks, by FEniCSx and PETSc.

::

    cd CASE_FOLDER
    mpirun -n 8 python3 -m engine . [options of PETSc]

It imports nothing of printctl, so that it can be copied to a cluster with the case, which
`write_case` does (`case.json`, and arrays that every rank reads its share of). It leaves
`ranks.json`, `velocity.npy` (a row a node) and `pressure.npy` (a value a corner) there.

Find u (quadratic) and p (linear, both on quadratic tetrahedra), with u given at the wall and at
ports of kind ``flow``, so that for all v and q, v vanishing where u is given,

    ∫ μ ∇u:∇v + ϱ (∇u u)·v - p ∇·v - q ∇·u dx + Σ_k (p_k + R_k Q_k) ∫_k v·n ds = 0,

the sum over the other ports, Q_k = ∫_k u·n ds out of port k, R_k = 0 where a pressure alone is
given; the convective term for ``navier_stokes`` alone. So nothing but -p n acts where a port is
open: Poiseuille's flow leaves it undisturbed.

FEniCSx 0.5 to 0.9; what differs is in `partition` (`elements`, `rows`, `distributed`) and in the
name of the function that makes a space (`problem`).
"""
