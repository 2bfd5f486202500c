"""What metadata alone tell about the installed plugins."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest

from ndf_core import api
from ndf_core.cli import main
from ndf_core.errors import RepresentationError
from ndf_core.plugins import discovery

if TYPE_CHECKING:
    from tests.conftest import PluginMaker


def found(name: str) -> list[discovery.Entry]:
    return [entry for entry in discovery.entries() if entry.name == name]


def test_the_group_is_the_one_plugin_authors_are_told() -> None:
    assert discovery.GROUP == api.ENTRY_POINT_GROUP


def test_listing_reads_metadata_and_imports_nothing(plugin_maker: PluginMaker) -> None:
    module = plugin_maker.add("blob", version="2.1", source="raise SystemExit('imported')")
    assert found("blob") == [discovery.Entry("blob", module, "third-party-blob", "2.1")]
    assert module not in sys.modules


def test_two_strangers_with_one_name_are_both_unusable_and_name_each_other(plugin_maker: PluginMaker) -> None:
    plugin_maker.add("blob", distribution="first")
    plugin_maker.add("blob", distribution="second", version="3.0")
    first, second = found("blob")
    assert first.error == "the name clashes with second 3.0; uninstall one of them"
    assert second.error == "the name clashes with first 1.0; uninstall one of them"


@pytest.fixture
def _owned(monkeypatch: pytest.MonkeyPatch) -> None:
    """A name with an owner that is not installed."""
    monkeypatch.setitem(discovery.OWNERS, "waves", "ndf-plugin-waves")


@pytest.mark.usefixtures("_owned")
@pytest.mark.parametrize("spelling", ["ndf-plugin-waves", "NDF_plugin.waves"])
def test_a_stranger_cannot_take_a_name_from_its_owner(plugin_maker: PluginMaker, spelling: str) -> None:
    plugin_maker.add("waves", distribution=spelling)
    plugin_maker.add("waves", distribution="stranger")
    errors = {entry.distribution: entry.error for entry in found("waves")}
    assert errors[spelling] is None
    assert errors["stranger"] == f"the name clashes with {spelling} 1.0, which keeps it; rename this one"


@pytest.mark.usefixtures("_owned")
def test_an_owned_name_is_free_while_its_owner_is_not_installed(plugin_maker: PluginMaker) -> None:
    plugin_maker.add("waves", distribution="stranger")
    assert [entry.error for entry in found("waves")] == [None]


def test_a_name_that_the_command_line_could_not_take_is_refused(plugin_maker: PluginMaker) -> None:
    plugin_maker.add("Blob_1")
    assert found("Blob_1")[0].error == "its name must be lower-case letters, digits and hyphens"


def test_unreadable_entry_points_are_told_and_hide_no_other(plugin_maker: PluginMaker) -> None:
    plugin_maker.add("good")
    plugin_maker.add("torn")
    path = plugin_maker.folder / "third_party_torn-1.0.dist-info" / "entry_points.txt"
    path.write_text("[ndf.representations\nno equals sign")
    (plugin_maker.folder / "binary-1.0.dist-info").mkdir()
    (plugin_maker.folder / "binary-1.0.dist-info" / "entry_points.txt").write_bytes(b"\xff\xfe\x00")
    assert found("good")[0].error is None


@pytest.mark.usefixtures("_owned")
def test_an_owned_name_that_is_not_installed_says_what_to_install(plugin_maker: PluginMaker) -> None:
    assert discovery.not_installed()["waves"] == "ndf-plugin-waves"
    with pytest.raises(RepresentationError, match=r"--repr waves: is not installed; pip install ndf-plugin-waves"):
        discovery.claims("waves")
    with pytest.raises(RepresentationError, match=r"did you mean waves\?"):
        discovery.claims("wavs")


@pytest.mark.usefixtures("_owned")
def test_the_listing_shows_what_is_not_installed_with_its_pip_line(
    plugin_maker: PluginMaker, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["plugins"]) == 0
    assert "waves              not installed: pip install ndf-plugin-waves" in capfd.readouterr().out.splitlines()


def test_unreadable_metadata_are_told_as_a_plugin_without_a_name(plugin_maker: PluginMaker) -> None:
    plugin_maker.add("blob")
    (metadata,) = plugin_maker.folder.glob("*.dist-info/METADATA")
    metadata.write_bytes(b"Name: \xe9\xff\n")
    assert [entry.origin for entry in found("blob")] == ["unnamed 0"]
