"""The run-time type checker of the tests, by a name that jaxtyping's import hook can import."""

from __future__ import annotations

from beartype import BeartypeConf, beartype

check = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""An int will do for a float, as for pyright."""
