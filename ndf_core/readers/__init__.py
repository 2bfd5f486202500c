"""Triangle mesh files to arrays.

Own readers instead of those of trimesh 4, which resolve relative OBJ indices against the whole file, return what is
left of a PLY or OFF file that is cut off, and nothing at all of a cut-off text STL or of PLY strips, without a word,
and allocate whatever the description of a GLB file announces. Each of ours is checked against trimesh on good files.
"""
