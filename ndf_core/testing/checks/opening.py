"""Recognising and opening the source."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from ndf_core.api import Sniff
from ndf_core.testing.check import NotAsked, expect, law
from ndf_core.testing.checks.config import config_takes_the_options
from ndf_core.testing.checks.entry import spec_can_be_had
from ndf_core.testing.subject import Subject

NOISE_BYTES = 3000


@law(spec_can_be_had)
def sniff_knows_the_source(subject: Subject) -> None:
    """Users should not have to say --repr."""
    if subject.spec.sniff is None:
        raise NotAsked("the representation has no sniff; --repr has to be given")
    if not isinstance(subject.source, (str, Path)):
        raise NotAsked("only files and names can be looked at")
    answer: Any = subject.spec.sniff(Path(subject.source))
    expect(isinstance(answer, Sniff), f"sniff returned {answer!r} for {subject.source}, not a Sniff")
    expect(0 < answer.confidence <= 1, f"its confidence must be in (0, 1], not {answer.confidence!r}")


@law(spec_can_be_had)
def sniff_leaves_strangers_alone(subject: Subject) -> None:
    """It is asked about every file that anyone opens."""
    if subject.spec.sniff is None:
        raise NotAsked("the representation has no sniff")
    noise, folder = subject.folder / "noise", subject.folder / "empty"
    noise.write_bytes(noise_bytes())
    folder.mkdir(exist_ok=True)
    for what, path in (("noise", noise), ("an empty folder", folder), ("what is not there", subject.folder / "none")):
        answer = subject.spec.sniff(path)
        expect(answer is None, f"sniff takes {what} for {subject.name}: {answer!r}")


@law(config_takes_the_options)
def source_can_be_opened(subject: Subject) -> None:
    """Everything else is asked of the opened surface."""
    if subject.source is None:
        raise NotAsked("no source was given")
    _ = subject.surface


@law(source_can_be_opened)
def fingerprint_is_of_the_content(subject: Subject) -> None:
    """--resume compares it: it must not depend on time, path or run."""
    digest = subject.surface.fingerprint
    expect(bool(re.fullmatch("[0-9a-f]{64}", digest)), f"the fingerprint {digest!r:.80} is no SHA-256 in hex")
    again = subject.surface_again.fingerprint
    expect(digest == again, "opening the same source twice gives two fingerprints")


def noise_bytes() -> bytes:
    return np.random.default_rng(0).bytes(NOISE_BYTES)
