"""The config model in use; what the loader demands of it is in `ndf_core.plugins.contract`."""

from __future__ import annotations

import json
import tomllib

from ndf_core.config.schema import config_schema
from ndf_core.config.toml import toml_text
from ndf_core.testing.check import expect, law
from ndf_core.testing.checks.entry import CONTRACT
from ndf_core.testing.subject import Subject


@law(*CONTRACT)
def config_takes_the_options(subject: Subject) -> None:
    """Without options every field needs a default, so that a file alone can be opened."""
    _ = subject.config


@law(config_takes_the_options)
def config_survives_toml(subject: Subject) -> None:
    """Any options may stand in a config file."""
    text = toml_text(subject.config.model_dump(mode="json", exclude_none=True))
    back = type(subject.config).model_validate(tomllib.loads(text))
    expect(back == subject.config, f"written to TOML and read again, {subject.config!r} becomes {back!r}")


@law(*CONTRACT)
def config_has_a_schema(subject: Subject) -> None:
    """Editors complete config files with it (`ndf plugins --schema`)."""
    json.dumps(config_schema(subject.spec))
