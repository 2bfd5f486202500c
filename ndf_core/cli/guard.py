"""Around every command: what reaches stdout, what an error looks like, and the exit code."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Generator
from contextlib import contextmanager, redirect_stdout

import click

from ndf_core.cli.app import ndf
from ndf_core.cli.result import Interrupted, Result
from ndf_core.errors import NdfError
from ndf_core.plain_json import as_json

INTERNAL, USAGE, BAD, INTERRUPTED = 1, 2, 3, 130
OPTIONAL_PACKAGES = ("torch", "scipy", "igl", "rich", "safetensors", "cholespy", "pygeodesic", "potpourri3d")
"""What the light client lacks."""


def run(arguments: list[str]) -> int:
    """Run one command line and return the exit code."""
    json_wanted = "--json" in arguments
    with _stdout(reserved=json_wanted) as descriptor:
        result, failure, code = _answer(arguments)
        if failure:
            print(f"error: {failure}", file=sys.stderr)
            if json_wanted:
                result = Result({"error": failure, "exit_code": code})
        return code if result is None or _emit(result, descriptor) else INTERNAL


def _answer(arguments: list[str]) -> tuple[Result | None, str | None, int]:
    """Result, or failure in words, and the exit code."""
    try:
        answer = ndf.main(args=arguments, prog_name="ndf", standalone_mode=False, obj=tuple(arguments))
    except click.UsageError as error:
        return None, _usage(error), USAGE
    except Exception as error:
        if "--debug" in arguments and not isinstance(error, click.Abort):
            traceback.print_exc()
        return None, *_explain(error, "fit" if "fit" in arguments else "processing")
    except KeyboardInterrupt:
        return None, "interrupted", INTERRUPTED
    return (answer, None, answer.exit_code) if isinstance(answer, Result) else (None, None, int(answer or 0))


def _explain(error: Exception, extra: str) -> tuple[str, int]:
    match error:
        case NdfError():
            return str(error), error.exit_code
        case Interrupted():
            return str(error), INTERRUPTED
        case click.Abort():  # click's name for KeyboardInterrupt
            return "interrupted", INTERRUPTED
        case ModuleNotFoundError() if (error.name or "").partition(".")[0] in OPTIONAL_PACKAGES:
            return f"this needs {error.name}, which is not installed: pip install 'ndf-core[{extra}]'", BAD
        case MemoryError():
            return "out of memory: ask for fewer faces, or a longer edge length", BAD
        case OSError():
            return f"{error.filename or 'the system'}: {error.strerror or error}", BAD
        case _:
            name = type(error).__name__
            return f"a fault of ndf itself, please report it: {name}: {error} (--debug shows where)", INTERNAL


def _usage(error: click.UsageError) -> str:
    command = error.ctx.command_path if error.ctx else "ndf"
    return f"{error.format_message()} (try: {command} --help)"


@contextmanager
def _stdout(reserved: bool) -> Generator[int]:
    """File descriptor for the answer. Reserved: whatever else anyone prints, C libraries included, goes to stderr."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # names of files need not be valid text
            stream.reconfigure(errors="backslashreplace")  # pyright: ignore
    if not reserved:
        yield 1
        return
    sys.stdout.flush()
    answer = os.dup(1)
    os.dup2(2, 1)
    try:
        with redirect_stdout(sys.stderr):  # Python's own prints: unbuffered, so in order
            yield answer
    finally:
        os.dup2(answer, 1)
        os.close(answer)


def _emit(result: Result, descriptor: int) -> bool:
    """Print the answer; False where nobody reads it any more."""
    try:
        if descriptor != 1:
            with os.fdopen(os.dup(descriptor), "w", encoding="ascii") as file:
                file.write(as_json(result.data) + "\n")
        elif result.text:
            print(result.text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # or the interpreter complains when it flushes at exit
        return False
    return True
