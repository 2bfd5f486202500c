"""The checks as pytest tests: subclass `RepresentationSuite`, say what to open, and each law is a test."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest

from ndf_core.testing.check import Check, NotAsked, Outcome, outcome_of
from ndf_core.testing.checks import CHECKS
from ndf_core.testing.motion import Motion
from ndf_core.testing.run import check_reasons
from ndf_core.testing.subject import Subject


class RepresentationSuite(ABC):
    """Laws of one representation on one source.

    class TestHeightmap(RepresentationSuite):
        name = "heightmap"

        def source(self, folder):
            path = folder / "terrain.asc"
            path.write_text(...)
            return path
    """

    name: ClassVar[str]
    """The `--repr` value."""
    options: ClassVar[Mapping[str, Any]] = {}
    """Of the representation."""
    expected_failures: ClassVar[Mapping[str, str]] = {}
    """By name of the check, the reason why it cannot hold; such a test is an expected failure, strictly."""
    tolerance: ClassVar[float] = 1e-4
    """How far a projection may be off, as a share of the longest side."""
    faces: ClassVar[int] = 300
    """Of the base mesh."""

    @abstractmethod
    def source(self, folder: Path) -> Any:
        """A small source to open; `folder` is empty and of this class alone."""

    def moved(self, source: Any, motion: Motion, folder: Path) -> Any:
        """The same shape under `motion`, as a new source; None where the format cannot express this motion, and
        `NotAsked` with the reason where it can express none."""
        raise NotAsked("the suite has no method `moved`")

    @pytest.fixture(scope="class")
    @classmethod
    def subject(cls, tmp_path_factory: pytest.TempPathFactory) -> Subject:
        """What is checked; opened once for all tests of the class."""
        check_reasons(cls.expected_failures)
        suite = cls()
        source = suite.source(tmp_path_factory.mktemp("source"))
        folder = tmp_path_factory.mktemp("checks")
        return Subject(cls.name, source, folder, cls.options, suite.moved, cls.tolerance, cls.faces)

    @pytest.fixture(scope="class")
    @classmethod
    def outcomes(cls) -> dict[str, Outcome]:
        """What has been found so far."""
        return {}

    @pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
    def test_law(self, subject: Subject, outcomes: dict[str, Outcome], check: Check) -> None:
        found, why = outcome_of(check, subject, outcomes), self.expected_failures.get(check.name)
        if found.status == "skipped":
            pytest.skip(f"this law cannot be asked of {self.name}: {found.message}")
        if why and found.status == "failed":
            pytest.xfail(f"{why} ({found.message})")
        assert found.status == "passed", f"{found.message} [{found.reason}]"
        assert not why, f"was expected to fail ({why}), but passes: take it off expected_failures"
