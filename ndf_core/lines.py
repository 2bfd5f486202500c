"""What others wrote, on one line of a terminal: names, messages of exceptions, the last words of a process."""

from __future__ import annotations


def plain_line(text: str, width: int = 300) -> str:
    """The text without line breaks, without what steers a terminal, and cut to `width`."""
    words = " ".join(text[: 10 * width].split())
    return "".join(letter if letter.isprintable() else "?" for letter in words)[:width]


def one_line(error: BaseException) -> str:
    """Type and message of an exception, even of one that cannot say what it is."""
    name = type(error).__name__
    try:
        text = str(error)
    except Exception:
        text = ""
    return plain_line(f"{name}: {text}" if text else name)
