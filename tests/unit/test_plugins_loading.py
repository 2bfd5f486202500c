"""The guard around foreign entry modules: whatever they do, one line says it and nothing else suffers."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest

from ndf_core.errors import PluginError, RepresentationError
from ndf_core.plugins.discovery import entries
from ndf_core.plugins.guard import ForeignFailure, guarded
from ndf_core.plugins.loading import load, load_entry, load_usable

if TYPE_CHECKING:
    from tests.conftest import PluginMaker

BROKEN = [
    ({"from pathlib": "import no_such\nfrom pathlib"}, "ModuleNotFoundError: No module named 'no_such'"),
    ({"from pathlib": "raise SystemExit(3)\nfrom pathlib"}, "SystemExit: 3"),
    ({"from pathlib": "def !\nfrom pathlib"}, "SyntaxError"),
    ({"@hookimpl\n": ""}, "no @hookimpl function ndf_representation"),
    ({"return RepresentationSpec(": "return dict("}, "returned dict, not a RepresentationSpec"),
    ({"return RepresentationSpec(": "return 1 / 0 or dict("}, "ZeroDivisionError"),
    ({"api_version=1": "api_version=2"}, "speaks plugin API version 2, this ndf-core 1; upgrade ndf-core"),
    ({"api_version=1": "api_version=0"}, "speaks plugin API version 0, this ndf-core 1; upgrade the plugin"),
    ({"api_version=1": "api_version=1, colour='red'"}, "unexpected keyword argument 'colour'"),
    ({'name="NAME"': 'name="other"'}, "called 'blob' but the representation 'other'"),
    ({'support="full"': 'support="some"'}, "support must be 'full' or 'partial', not 'some'"),
    ({"MODULE_open:open_it": "MODULE_open"}, "must look like 'package.module:function'"),
    ({"config=Config": "config=dict"}, "config must be a pydantic model class"),
    ({"frozen=True, ": ""}, "config model Config must be frozen"),
    ({', extra="forbid"': ""}, "config model Config must forbid extra options"),
    ({', description="Newton steps"': ""}, "option steps of config model Config has no description"),
    ({'gt=0, desc': 'gt=0, alias="s", desc'}, "option steps of config model Config has an alias"),
    ({'{"loss": {"cycle": 1e5}}': '{"loss": {"cicle": 1e5}}'}, "did you mean loss.cycle?"),
    ({'{"loss": {"cycle": 1e5}}': '{"loss": {"cycle": -1}}'}, "training_defaults: ValidationError"),
    ({'{"loss": {"cycle": 1e5}}': "3"}, "training_defaults must be a mapping, not int"),
]  # fmt: skip


@pytest.mark.parametrize(("replace", "cause"), BROKEN, ids=[cause[:40] for _, cause in BROKEN])
def test_a_broken_plugin_is_one_line_with_its_distribution_and_cause(
    plugin_maker: PluginMaker, replace: dict[str, str], cause: str
) -> None:
    plugin_maker.add("blob", version="0.3", replace=replace)
    with pytest.raises(PluginError) as caught:
        load("blob")
    assert str(caught.value).startswith("--repr blob: the plugin third-party-blob 0.3 cannot be used: ")
    assert cause in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_broken_plugin_stops_no_other(plugin_maker: PluginMaker) -> None:
    plugin_maker.add("broken", source="raise ImportError('no GPU')")
    plugin_maker.add("fine")
    specs, causes = load_usable()
    assert "fine" in [spec.name for spec in specs]
    assert any("third-party-broken 1.0 cannot be used" in cause and "no GPU" in cause for cause in causes)


def test_what_a_plugin_prints_on_import_goes_to_stderr(
    plugin_maker: PluginMaker, capsys: pytest.CaptureFixture[str]
) -> None:
    plugin_maker.add("blob", replace={"from pathlib": "print('hello')\nfrom pathlib"})
    load("blob")
    assert capsys.readouterr() == ("", "hello\n")


def test_a_plugin_that_hangs_is_given_up(plugin_maker: PluginMaker) -> None:
    # A name of its own: the thread goes on holding the lock of the module that it imports.
    plugin_maker.add("sleeper", replace={"from pathlib": "import time; time.sleep(60)\nfrom pathlib"})
    entry = next(entry for entry in entries() if entry.name == "sleeper")
    with pytest.raises(PluginError, match=r"importing third_party_sleeper did not finish within 0\.3 s"):
        load_entry(entry, seconds=0.3)


def test_an_interrupt_passes_the_guard() -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        guarded(interrupt, "pressing Ctrl-C")


def test_the_message_of_a_failure_is_one_line() -> None:
    def fail() -> None:
        raise ValueError("first\n   second")

    with pytest.raises(ForeignFailure, match=r"^trying failed: ValueError: first second$"):
        guarded(fail, "trying")


def test_an_unknown_name_names_the_nearest(plugin_maker: PluginMaker) -> None:
    plugin_maker.add("blobs")
    with pytest.raises(
        RepresentationError, match=r"--repr blob: there is no such representation; did you mean blobs\?"
    ):
        load("blob")


def test_only_the_plugin_asked_for_is_imported(plugin_maker: PluginMaker) -> None:
    wanted, other = plugin_maker.add("wanted"), plugin_maker.add("other")
    assert load("wanted").summary == "A made-up representation."
    assert wanted in sys.modules
    assert other not in sys.modules
    assert f"{wanted}_open" not in sys.modules
