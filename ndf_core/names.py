"""Advice for names that do not exist."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def nearest(word: str, known: Iterable[str]) -> str:
    """The closest ones, with or without their table, or all of them."""
    names = list(known)
    spellings = {name.rpartition(".")[2]: name for name in names} | {name: name for name in names}
    matches = difflib.get_close_matches(word, spellings, n=3, cutoff=0.7)
    close = dict.fromkeys(spellings[match] for match in matches)
    return f"did you mean {' or '.join(close)}?" if close else f"there are {', '.join(names) or 'none'}"
