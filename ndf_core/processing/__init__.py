"""Geometry processing on extracted meshes, or any triangle meshes; no torch.

`operators.Operators` of a mesh holds what everything else shares: the intrinsic Delaunay triangulation, its Laplacian
and mass matrices, and their factors, each made once, when it is first needed. Needs ``ndf-core[processing]``.
"""
