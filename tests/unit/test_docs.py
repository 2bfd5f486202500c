"""What README and docs/architecture/plugins.md show works as shown."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest

import ndf_core
from ndf_core.cli.app import ndf
from ndf_core.config.resolve import resolve_config
from ndf_core.config.toml import read_config_file
from ndf_core.plugins.choosing import choose
from ndf_core.plugins.discovery import OWNERS
from ndf_core.plugins.loading import load

if TYPE_CHECKING:
    from tests.conftest import PluginMaker

REPOSITORY = Path(__file__).resolve().parents[2]
README = (REPOSITORY / "README.md").read_text()
PLUGINS = (REPOSITORY / "docs" / "architecture" / "plugins.md").read_text()


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


def test_the_minimal_plugin_registers_and_recognises_its_files(plugin_maker: PluginMaker, tmp_path: Path) -> None:
    project = tomllib.loads(blocks(PLUGINS, "toml")[0])
    ((name, module),) = project["project"]["entry-points"]["ndf.representations"].items()
    assert module.startswith(project["project"]["name"].replace("-", "_"))
    plugin_maker.add(name, distribution=project["project"]["name"], source=blocks(PLUGINS, "python")[0])
    assert load(name).config.model_fields.keys() == {"spacing"}
    path = tmp_path / "x.heights"
    path.write_bytes(b"HEIGHTS1 and so on")
    assert choose(path).note == "read as heights: height map"


def test_the_config_file_is_valid(tmp_path: Path) -> None:
    (text,) = blocks(README, "toml")
    path = tmp_path / "fit.toml"
    path.write_text(text)
    file = read_config_file(path)
    assert file.repr in OWNERS
    assert resolve_config(file=file).fit.config.faces == 4000


COMMANDS = [line.split("#")[0].strip() for line in README.splitlines() if line.startswith("    ndf ")]


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_line_shown_exists(line: str) -> None:
    _, name, *words = shlex.split(line)
    context = click.Context(ndf)
    command = ndf.get_command(context, name)
    if isinstance(command, click.Group):
        command = command.get_command(context, words[0])
    assert command is not None
    text = "".join(word for param in command.params for word in param.opts)
    plain = {"--faces", "--seed", "--colors", "--help"}  # made from FitConfig, or click's own
    assert all(word in text or word in plain for word in words if word.startswith("-"))


def test_the_representations_listed_are_those_whose_names_are_kept() -> None:
    listed = re.search(r"Available now: (.*?)\. Anyone", README, flags=re.DOTALL)
    assert listed is not None
    assert set(re.findall(r"`([a-z-]+)`", listed[0])) == OWNERS.keys()


def test_the_public_functions_exist() -> None:
    used = set(re.findall(r"ndf_core\.(\w+)\(", "".join(blocks(README, "python"))))
    assert used <= set(ndf_core.__all__)
    assert used
