"""Which representation a file is taken for, and what is said of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import ndf_core
from ndf_core.errors import InputError, PluginError, RepresentationError
from ndf_core.plugins.choosing import choose

if TYPE_CHECKING:
    from tests.conftest import PluginMaker

ALSO = {'startswith("NAME")': 'startswith("blob")'}


@pytest.fixture
def blob(tmp_path: Path) -> Path:
    path = tmp_path / "thing.blob"
    path.write_text("blob")
    return path


def test_the_most_confident_is_taken_with_its_reason(plugin_maker: PluginMaker, blob: Path) -> None:
    plugin_maker.add("blob", confidence=0.6)
    plugin_maker.add("rival", confidence=0.3, replace=ALSO)
    choice = choose(blob)
    assert choice.spec.name == "blob"
    assert choice.note == "read as blob: starts with the word blob"


def test_two_equally_confident_are_an_error_that_names_both(plugin_maker: PluginMaker, blob: Path) -> None:
    plugin_maker.add("blob", confidence=0.6)
    plugin_maker.add("rival", confidence=0.6, replace=ALSO)
    with pytest.raises(RepresentationError, match="say --repr blob or --repr rival"):
        choose(blob)


def test_nobody_recognising_it_says_what_was_looked_for(plugin_maker: PluginMaker, tmp_path: Path) -> None:
    plugin_maker.add("blob")
    plugin_maker.add("broken", source="import no_such_module")
    path = tmp_path / "noise.blob"
    path.write_bytes(b"\x00\xff\x00")
    with pytest.raises(RepresentationError) as caught:
        choose(path)
    assert "blob: A made-up representation. (.blob)" in str(caught.value)
    assert "third-party-broken 1.0 cannot be used" in str(caught.value)


@pytest.mark.parametrize(
    ("replace", "cause"),
    [
        ({"text = path": "raise RuntimeError('odd file')\n    text = path"}, "RuntimeError: odd file"),
        ({"return Sniff(CONFIDENCE,": "return Sniff(7,"}, "not a Sniff with a confidence in (0, 1]"),
    ],
)
def test_a_failing_look_leaves_the_others_and_is_told(
    plugin_maker: PluginMaker, blob: Path, replace: dict[str, str], cause: str
) -> None:
    plugin_maker.add("blob", confidence=0.3)
    plugin_maker.add("sloppy", replace={**ALSO, **replace})
    choice = choose(blob)
    assert choice.spec.name == "blob"
    assert any("--repr sloppy" in warning and cause in warning for warning in choice.warnings)


def test_no_plugin_is_asked_about_what_is_not_there(plugin_maker: PluginMaker, tmp_path: Path) -> None:
    plugin_maker.add("blob")
    with pytest.raises(InputError, match="there is no such file"):
        choose(tmp_path / "missing.blob")
    empty = tmp_path / "empty.blob"
    empty.touch()
    with pytest.raises(InputError, match="the file is empty"):
        choose(empty)
    with pytest.raises(InputError, match="/dev/zero: is no regular file"):
        choose("/dev/zero")
    with pytest.raises(InputError, match="cannot be read"):
        choose("null\0byte")
    with pytest.raises(RepresentationError, match="a dict is no file; name its representation"):
        choose({})


def test_open_from_python_notes_the_choice(plugin_maker: PluginMaker, blob: Path) -> None:
    plugin_maker.add("blob")
    surface = ndf_core.open(blob, resolution=32)
    assert surface.notes == ("read as blob: starts with the word blob", "a note")
    assert surface.fingerprint == "blob 32"
    assert surface.training_defaults == {"loss": {"cycle": 1e5}}
    assert ndf_core.open(blob, repr="blob").notes == ("a note",)


def test_a_plugin_that_fails_while_opening_is_named(plugin_maker: PluginMaker, tmp_path: Path) -> None:
    plugin_maker.add("blob")
    path = tmp_path / "thing.blob"
    path.write_text("blob crash")
    with pytest.raises(PluginError, match=r"--repr blob: the plugin failed on .*: ZeroDivisionError: of a sloppy"):
        ndf_core.open(path)
    path.write_text("blob exit")
    with pytest.raises(PluginError, match=r"the plugin failed on .*: SystemExit"):
        ndf_core.open(path)
    path.write_text("blob bad")
    with pytest.raises(InputError, match="is bad"):
        ndf_core.open(path)
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        ndf_core.open(tmp_path, repr="blob")


def test_a_plugin_whose_opener_cannot_be_imported_is_unusable(plugin_maker: PluginMaker, blob: Path) -> None:
    plugin_maker.add("blob", replace={"MODULE_open:open_it": "json:open_it"})
    with pytest.raises(PluginError, match=r"--repr blob: the plugin cannot be used: .*open_it"):
        ndf_core.open(blob)
