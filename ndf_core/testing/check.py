"""What a check is, and what comes of one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from ndf_core.lines import one_line
from ndf_core.testing.subject import Subject


class Broken(AssertionError):
    """The law does not hold; the message says by how much, in one line."""


class NotAsked(Exception):
    """The law means nothing here; the message says why."""


@dataclass(frozen=True)
class Check:
    """One law."""

    name: str
    reason: str
    """Why it matters, one line."""
    run: Callable[[Subject], None]
    """Raises `Broken` or `NotAsked`; any other exception is a failure too."""
    needs: tuple[Check, ...] = ()
    """Laws without which this one cannot be judged: a plugin that breaks one of them is told of that one alone."""


@dataclass(frozen=True)
class Outcome:
    """What one check found."""

    check: str
    status: Literal["passed", "failed", "expected", "skipped"]
    """"expected": failed, as its author said that it would; "skipped": could not be asked, `message` says why."""
    reason: str
    """Why the law matters."""
    message: str = ""


def law(*needs: Check) -> Callable[[Callable[[Subject], None]], Check]:
    """Make a check of a function: its name is the law's, the first line of its docstring the reason."""

    def made(function: Callable[[Subject], None]) -> Check:
        assert function.__doc__, f"the check {function.__name__} needs a docstring that says why it matters"
        return Check(function.__name__, function.__doc__.partition("\n")[0], function, needs)

    return made


def expect(holds: bool, message: str) -> None:
    """Raise `Broken` unless it holds."""
    if not holds:
        raise Broken(message)


def outcome_of(check: Check, subject: Subject, known: dict[str, Outcome]) -> Outcome:
    """Run a check after those that it needs; `known` keeps what has been found."""
    if check.name not in known:
        known[check.name] = _judge(check, subject, known)
    return known[check.name]


def _judge(check: Check, subject: Subject, known: dict[str, Outcome]) -> Outcome:
    for need in check.needs:
        before = outcome_of(need, subject, known)
        if before.status == "skipped":
            return Outcome(check.name, "skipped", check.reason, before.message)
        if before.status == "failed":
            return Outcome(check.name, "skipped", check.reason, f"cannot be judged before {need.name} holds")
    try:
        check.run(subject)
    except NotAsked as why:
        return Outcome(check.name, "skipped", check.reason, str(why))
    except Broken as fault:
        return Outcome(check.name, "failed", check.reason, " ".join(str(fault).split()))
    except (Exception, SystemExit) as error:
        return Outcome(check.name, "failed", check.reason, one_line(error))
    return Outcome(check.name, "passed", check.reason)
