"""Largest sizes that an ``.ndf`` file may state. A reader allocates nothing before it has compared with these."""

from __future__ import annotations

FILE_BYTES = 1 << 28
"""256 MiB: nothing larger is opened."""
HEADER_BYTES = 1 << 20
"""The header's JSON, after decompression."""
VERTICES = 1 << 22
FACES = 1 << 23
FIELDS = 64
FEATURE_DIM = 256
LAYERS = 32
LABEL = 64
"""Characters of a column's or a class's name."""
WIDTH = 4096
"""Inputs and outputs of a layer."""
LEVELS = 24
FREQUENCY = 2.0**24
"""Highest angular frequency of an encoding, in radians per unit of the box frame."""
REACH = 1e3
"""Farthest placed vertex from the middle of the box frame, whose side is 3."""
NUMBERS = 1 << 26
"""Stored numbers of all fields together: 128 MiB of codes."""
STEP = (1e-30, 1e30)
"""Smallest and largest step of a quantised array, so that float32 holds every value."""
