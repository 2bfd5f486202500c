"""Representations: found by entry point, loaded under guard, chosen by looking at the file, opened on demand.

discovery   what distributions say they offer, from metadata alone
loading     import one entry module and check its `RepresentationSpec`
choosing    which representation a file is, when the user does not say
opening     from a source and a config to a `Surface`
checking    the whole of it in a process of its own, for ``ndf plugins --check``
"""
