"""One exception class per kind of failure; each message says what, where it came from and what to do."""

from __future__ import annotations


class NdfError(Exception):
    """Base of every error that ndf raises on purpose. The command line prints it without a traceback."""

    exit_code = 3


class ConfigError(NdfError):
    """The command line or a configuration layer is wrong (unknown option, value out of bounds, bad TOML)."""

    exit_code = 2


class InputError(NdfError):
    """The input file or object cannot be read as the surface it was said to be."""


class RepresentationError(NdfError):
    """No representation, or more than one, claims the input; or the named one does not exist."""

    exit_code = 2


class PluginError(NdfError):
    """A plugin was asked for and cannot be used: import error, wrong API version, clashing name, bad config."""


class BaseMeshError(NdfError):
    """No closed manifold base mesh could be made from the surface."""


class FitError(NdfError):
    """The fit cannot go on: the losses are not finite, or too few samples can be projected."""


class ResumeError(NdfError):
    """A checkpoint does not belong to this run, or cannot be read."""


class AssetError(NdfError):
    """An ``.ndf`` file is truncated, corrupted, too new, or inconsistent."""


class ExtractionError(NdfError):
    """The mesh asked for cannot be extracted (an edge length that needs more vertices than allowed, say)."""


class OutputError(NdfError):
    """The output cannot be written (unknown suffix, no such folder, a directory in its place)."""

    exit_code = 2
