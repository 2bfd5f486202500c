"""Triangle mesh files to arrays.

Own readers rather than trimesh's: those wrap negative OBJ indices silently, stop at garbage without a word, return
nothing for PLY strips and for cut-off text STL, and allocate what a GLB header announces.
"""
