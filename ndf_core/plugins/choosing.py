"""Which representation a source is, when the user does not say: ask every usable plugin to look at it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ndf_core.api import RepresentationSpec, Sniff
from ndf_core.errors import RepresentationError
from ndf_core.plugins.guard import ForeignFailure, guarded
from ndf_core.plugins.loading import load_usable
from ndf_core.plugins.source import check_source


@dataclass(frozen=True)
class Choice:
    """The representation taken and why."""

    spec: RepresentationSpec
    reason: str
    warnings: tuple[str, ...] = ()
    """One line for each plugin that could not be asked."""

    @property
    def note(self) -> str:
        return f"read as {self.spec.name}: {self.reason}"


def choose(source: str | Path | object) -> Choice:
    """The single most confident representation.

    Raises:
        InputError: there is no such file, or it is empty.
        RepresentationError: none recognises the source, or two do equally well.
    """
    if not isinstance(source, (str, Path)):
        raise RepresentationError(f"a {type(source).__name__} is no file; name its representation with repr=")
    check_source(source)
    specs, broken = load_usable()
    warnings = [f"not asked: {line}" for line in broken]
    answers: list[tuple[Sniff, RepresentationSpec]] = []
    for spec in specs:
        try:
            answer = _look(spec, Path(source))
        except ForeignFailure as failure:
            warnings.append(f"not asked: --repr {spec.name}: {failure}")
            continue
        if answer is not None:
            answers.append((answer, spec))
    if not answers:
        raise RepresentationError(_nobody(source, specs, warnings))
    best = max(answer.confidence for answer, _ in answers)
    winners = [(answer, spec) for answer, spec in answers if answer.confidence == best]
    if len(winners) > 1:
        reasons = " and as ".join(f"{spec.name} ({answer.reason})" for answer, spec in winners)
        ways = " or ".join(f"--repr {spec.name}" for _, spec in winners)
        raise RepresentationError(f"{source}: can be read equally well as {reasons}; say {ways}")
    answer, spec = winners[0]
    return Choice(spec, answer.reason, tuple(warnings))


def _look(spec: RepresentationSpec, path: Path) -> Sniff | None:
    if spec.sniff is None:
        return None
    sniff = spec.sniff
    answer: Any = guarded(lambda: sniff(path), f"looking at {path.name}")
    if answer is not None and not (isinstance(answer, Sniff) and 0 < answer.confidence <= 1):
        raise ForeignFailure(f"its sniff returned {answer!r}, not a Sniff with a confidence in (0, 1]")
    return answer


def _nobody(source: str | Path, specs: list[RepresentationSpec], warnings: list[str]) -> str:
    lines = [f"{source}: no installed representation recognises this; name one with --repr. Looked for:"]
    lines += [f"{spec.name}: {spec.summary} ({' '.join(spec.suffixes) or 'no suffix'})" for spec in specs]
    lines += warnings
    if not specs:
        lines.append("nothing, since no usable plugin is installed; try: pip install ndf-plugin-sdf")
    return "\n  ".join(lines)
