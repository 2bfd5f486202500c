"""From an asset to a triangle mesh, without torch: remesh the base mesh under the field, and check it.

`extract.py` is the way in, `remeshing.py` the loop, `intrinsic_delaunay.py` what to compute on.
"""
