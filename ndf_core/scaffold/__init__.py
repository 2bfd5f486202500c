"""``ndf new-plugin NAME``: a complete distribution with one representation, to be changed into the author's own.

The files under `template/` are written out with ``@name@`` and the like filled in, in their names too.
"""
