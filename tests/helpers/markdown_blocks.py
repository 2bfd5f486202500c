"""Fenced code blocks of a page, as its reader meets them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

_FENCE = re.compile(r'^```(\w+)(?: title="([^"]+)")?[^\n]*\n(.*?)^```$', re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """One block."""

    language: str
    title: str
    """File that it is the content of; empty for a program or commands."""
    text: str


def blocks_of(page: Path) -> list[Block]:
    """In order."""
    return [Block(*found.groups(default="")) for found in _FENCE.finditer(page.read_text("utf-8"))]
