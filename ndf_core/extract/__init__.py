"""From an asset to a triangle mesh, without torch: subdivide the base mesh, map it, check it.

`subdivision.py` holds the triangulation that all computing is done on; a remesher of intrinsic triangulations takes
its place there, and the rest of this package stays.
"""
