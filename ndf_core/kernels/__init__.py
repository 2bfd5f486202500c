"""Hot loops in C over contiguous numpy arrays: `bvh`, `codes`, `decimate`, `field`, `mesh_check`, `subdivide`.

Each Python module here is the whole interface of its compiled twin in `src/`; `reference/` holds the readable
numpy versions that the tests compare them with. Nothing here knows about assets, plugins or torch.
"""
