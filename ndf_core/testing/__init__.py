"""The conformance kit for authors of representations: laws that every plugin keeps, each a small named check.

    from ndf_core.testing import check_representation

    check_representation("heightmap", "terrain.asc")

or, with pytest, a class that has one test per law (`ndf_core.testing.suite`); on the command
line ``ndf plugins --check heightmap terrain.asc``.

To add a check: write a function in `checks/`, name it in `CHECKS` there, and add a toy plugin that it alone catches
to tests/unit/test_conformance_kit.py.
"""

from __future__ import annotations

from ndf_core.testing.check import NotAsked, Outcome
from ndf_core.testing.motion import Motion
from ndf_core.testing.run import check_representation, run_checks

__all__ = ["Motion", "NotAsked", "Outcome", "check_representation", "run_checks"]
