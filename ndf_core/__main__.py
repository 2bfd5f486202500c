"""``python -m ndf_core`` is ``ndf``."""

import sys

from ndf_core.cli import main

sys.exit(main())
