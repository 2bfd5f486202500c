"""Parts that most representations are made of: implicit fields and their projection, closed meshes, fingerprints.

A plugin may import all of it; with `ndf_core.api`, `interfaces`, `errors` and `readers` it is what plugins build on.
"""
