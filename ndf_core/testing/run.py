"""Running all checks of one representation."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ndf_core.names import nearest
from ndf_core.testing.check import Outcome, outcome_of
from ndf_core.testing.checks import CHECKS
from ndf_core.testing.subject import Mover, Subject


def run_checks(subject: Subject, expected_failures: Mapping[str, str] | None = None) -> list[Outcome]:
    """What each check finds, in the order of `ndf_core.testing.checks.CHECKS`.

    Args:
        subject: representation and source.
        expected_failures: by name of the check, why it cannot hold. One that passes after all counts as failed, so
            that no exemption outlives its reason.

    Raises:
        ValueError: an expected failure names no check, or gives no reason.
    """
    expected = dict(expected_failures or {})
    check_reasons(expected)
    known: dict[str, Outcome] = {}
    return [_weighed(outcome_of(check, subject, known), expected) for check in CHECKS]


def check_reasons(expected_failures: Mapping[str, str]) -> None:
    """Raise ValueError where an expected failure names no check, or gives no reason."""
    names = {check.name: check.name for check in CHECKS}
    for name, why in expected_failures.items():
        if name not in names:
            raise ValueError(f"expected_failures: there is no check {name!r}; {nearest(name, names)}")
        if not why.strip():
            raise ValueError(f"expected_failures: {name} needs a reason")


def _weighed(outcome: Outcome, expected: Mapping[str, str]) -> Outcome:
    why = expected.get(outcome.check)
    if why is None or outcome.status == "skipped":
        return outcome
    if outcome.status == "failed":
        return replace(outcome, status="expected", message=f"{why} ({outcome.message})")
    message = f"was expected to fail ({why}), but passed: take it off the list"
    return replace(outcome, status="failed", message=message)


def check_representation(
    name: str,
    source: Any = None,
    *,
    expected_failures: Mapping[str, str] | None = None,
    options: Mapping[str, Any] | None = None,
    moved: Mover | None = None,
    tolerance: float = 1e-4,
    faces: int = 300,
) -> list[Outcome]:
    """Check that a representation keeps the laws of `ndf_core.interfaces`.

    Args:
        name: the `--repr` value of an installed plugin.
        source: a file that it reads, small if possible; None checks only what needs none.
        expected_failures: by name of the check, the reason why it cannot hold.
        options: of the representation.
        moved: ``moved(source, motion, folder)`` writes the same shape under a motion and returns the new source, or
            None where its format cannot express the motion. Without it motions are not checked.
        tolerance: how far a projection may be off, as a share of the longest side.
        faces: of the base mesh.

    Raises:
        AssertionError: with one line for every check that failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        subject = Subject(name, source, Path(folder), options or {}, moved, tolerance, faces)
        outcomes = run_checks(subject, expected_failures)
    failed = [outcome for outcome in outcomes if outcome.status == "failed"]
    if failed:
        lines = [f"{outcome.check}: {outcome.message} [{outcome.reason}]" for outcome in failed]
        raise AssertionError("\n".join([f"--repr {name} breaks {len(failed)} of {len(outcomes)} laws:", *lines]))
    return outcomes
