"""Every check of the conformance kit catches the plugin that breaks its law, and lets all others pass.

The toys are the plugin that `ndf new-plugin` writes, with one place broken.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ndf_core.cli import main
from ndf_core.plugins.discovery import entries
from ndf_core.plugins.loading import load_usable
from ndf_core.scaffold.write import write_plugin
from ndf_core.testing import Motion, Outcome, check_representation, run_checks
from ndf_core.testing.checks import CHECKS
from ndf_core.testing.subject import Subject

ENTRY, OPENING, EXTRACTOR, PROJECTOR = "toy.py", "opening.py", "extractor.py", "projector.py"
EXTRACT = "return self._level_set.extract(max_faces, seed)"
ANSWER = "return Projection(found.to(points), distance > 0, normals.to(points))"
SAMPLE = "return center + radius * normals, normals"


def mesh(change: str) -> tuple[str, str, str]:
    """The base mesh with its arrays v, f or its remarks r changed."""
    lines = (
        "m = self._level_set.extract(max_faces, seed)",
        "v, f, r = m.vertices.copy(), m.faces.copy(), m.remarks",
        change,
        "return BaseMesh(v, f, r)",
    )
    return EXTRACTOR, EXTRACT, "\n        ".join(lines)


def answer(
    change: str, last: str = "return Projection(found.to(points), sure, normals.to(points))"
) -> tuple[str, ...]:
    """The projection with found, normals or the flags `sure` changed; `size` is the ball's."""
    lines = ("sure, size = distance > 0, 2 * self._radius", change, last)
    return PROJECTOR, ANSWER, "\n        ".join(lines)


TOYS = {
    "spec_can_be_had": (ENTRY, "@hookimpl\n", ""),
    "api_version_is_spoken": (ENTRY, "api_version=1", "api_version=99"),
    "name_is_that_of_the_entry_point": (ENTRY, 'name="toy"', 'name="other"'),
    "support_is_full_or_partial": (ENTRY, 'support="full"', 'support="some"'),
    "open_names_a_function": (ENTRY, "opening:open_toy", "opening"),
    "config_is_a_pydantic_model": (ENTRY, "config=Config", "config=dict"),
    "config_is_frozen": (ENTRY, "frozen=True, ", ""),
    "config_forbids_extra_options": (ENTRY, ', extra="forbid"', ""),
    "config_describes_every_option": (ENTRY, ', description="length added to the ball\'s radius"', ""),
    "config_has_no_aliases": (ENTRY, "default=0.0, ge", 'default=0.0, alias="blow_up", ge'),
    "training_defaults_are_fit_options": (ENTRY, '"cycle": 1e2', '"cicle": 1e2'),
    "entry_module_is_light": (ENTRY, "import tomllib", "import tomllib\n\nimport numpy"),
    "entry_module_prints_nothing": (ENTRY, "import tomllib", "import tomllib\n\nprint('hello')"),
    "config_takes_the_options": (ENTRY, "default=0.0, ge", "ge"),
    "config_survives_toml": (ENTRY, "inflate: float", "key: pydantic.SecretStr = Field(default=pydantic.SecretStr("
                             "'1'), description='x')\n    inflate: float"),
    "config_has_a_schema": (ENTRY, "inflate: float", "rule: Callable[[], int] | None = Field(default=None, "
                            "description='x')\n    inflate: float"),
    "sniff_knows_the_source": (ENTRY, 'return Sniff(1.0, "a ball") if keys', 'return Sniff(7.0, "a ball") if keys'),
    "sniff_leaves_strangers_alone": (ENTRY, "if path.suffix != SUFFIX or not path.is_file():\n        return None",
                                     "if not path.is_file():\n        return None"),
    "source_can_be_opened": (OPENING, "radius += config.inflate", "radius += config.deflate"),
    "fingerprint_is_of_the_content": (OPENING, "[center, np.array(radius)]", "[center, str(source)]"),
    "noise_is_refused_by_name": (OPENING, "    try:\n        table", "    if path.stat().st_size > 999:\n        "
                                 "raise InputError('this is no ball')\n    try:\n        table"),
    "half_a_file_does_no_harm": (OPENING, "    try:\n        table", "    if path.stat().st_size < 30:\n        "
                                 "raise ZeroDivisionError\n    try:\n        table"),
    "base_mesh_can_be_made": (EXTRACTOR, EXTRACT, "raise IndexError(max_faces)"),
    "base_mesh_is_finite": mesh("v[5, 2] = np.nan"),
    "base_mesh_is_closed": mesh("f = f[1:]"),
    "base_mesh_is_manifold": mesh("v = np.vstack([v, v[:1] * 1.001])"),
    "base_mesh_is_oriented": mesh("f[7] = f[7, ::-1]"),
    "base_mesh_has_no_flat_faces": mesh("v[f[0, 0]] = (v[f[0, 1]] + v[f[0, 2]]) / 2"),
    "base_mesh_has_few_faces": mesh("m = self._level_set.extract(2 * max_faces, seed); v, f = m.vertices, m.faces"),
    "base_mesh_is_repeatable": mesh("v += 1e-6 * np.random.default_rng().random()"),
    "base_mesh_stays_in_bounds": mesh("v[0] += 0.9 * (v[0] - v.mean(axis=0))"),
    "projector_answers": answer("found = found[:, :2]"),
    "projector_reaches_the_surface": answer("sure = sure & (found[:, 0] < center[0] - 0.2 * size)"),
    "projector_keeps_type_and_device": answer("", "return Projection(found, sure, normals)"),
    "projector_takes_no_points": answer("if not len(points): raise IndexError('no rows')"),
    "projector_leaves_its_input_alone": answer("points += 1e-3 * size"),
    "projector_refuses_nan": (PROJECTOR, "if not bool(points.isfinite().all()):", "if not len(points.shape):"),
    "far_points_stay_finite": answer("sure = sure & (distance < size); found[~sure] = torch.nan"),
    "far_points_are_flagged": answer("far = distance > size; found[far] = points[far].to(found)"),
    "normals_are_unit": answer("normals = 2 * normals"),
    "normals_point_outwards": answer("normals = -normals"),
    "projector_is_pure": answer("self.calls = getattr(self, 'calls', 0) + 1; found += 1e-6 * size * self.calls"),
    "projecting_twice_is_projecting_once": answer(
        "near = (distance - self._radius).abs() > 1e-3 * size\n"
        "        found = torch.where(near[:, None], center + (self._radius + 5e-4 * size) * normals, found)"
    ),
    "points_on_the_surface_stay": (OPENING, SAMPLE, "return center + 1.01 * radius * normals, normals"),
    "batches_do_not_matter": answer("found += 1e-3 * size * (normals.abs().mean() - 0.5)"),
    "order_does_not_matter": answer("found[1::2] += 1e-6 * size"),
    "projector_follows_rigid_motion": answer(
        "level = offset[:, 2:] / self._radius\n"
        "        ring = torch.nn.functional.normalize(offset[:, :2], dim=1) * (1 - level**2).clamp_min(0).sqrt()\n"
        "        flat = center + self._radius * torch.cat([ring, level], dim=1)\n"
        "        found = torch.where(level.abs() < 0.95, flat, found)"
    ),
    "projector_follows_scale": answer(
        "near = (distance - self._radius).abs() < 0.01\n"
        "        found = torch.where(near[:, None], points.to(found), found)"
    ),
}  # fmt: skip


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder that this process and its children import from, with the plugin `toy` in it."""
    write_plugin("toy", tmp_path)
    folder = tmp_path / "ndf-plugin-toy"
    info = folder / "ndf_plugin_toy-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: ndf-plugin-toy\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[ndf.representations]\ntoy = ndf_plugin_toy.toy\n")
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.chdir(tmp_path)
    _forget()
    yield folder
    _forget()


def _forget() -> None:
    entries.cache_clear()
    load_usable.cache_clear()
    for module in [name for name in sys.modules if name.startswith("ndf_plugin_toy")]:
        del sys.modules[module]


def ball(path: Path, center: list[float] | None = None, radius: float = 2.0) -> Path:
    path.write_text(f"center = {center or [1.0, 2.0, 3.0]}\nradius = {radius}\n")
    return path


def moved(source: Path, motion: Motion, folder: Path) -> Path:
    center = motion.apply(np.array([[1.0, 2.0, 3.0]]))[0]
    return ball(folder / "moved.toy", center.tolist(), 2.0 * motion.scale)


def outcomes(folder: Path) -> list[Outcome]:
    return run_checks(Subject("toy", ball(folder / "ball.toy"), folder, moved=moved))


def break_it(site: Path, file: str, old: str, new: str) -> None:
    path = site / "ndf_plugin_toy" / file
    text = path.read_text()
    assert text.count(old) == 1, old
    text = text.replace(old, new)
    if file == ENTRY:
        text = text.replace("import tomllib", "import tomllib\nfrom collections.abc import Callable\nimport pydantic")
    path.write_text(text)


def test_every_check_has_a_toy_and_a_reason_of_one_line() -> None:
    assert sorted(TOYS) == sorted(check.name for check in CHECKS)
    assert all(check.reason and "\n" not in check.reason for check in CHECKS)


def test_the_plugin_that_new_plugin_writes_keeps_every_law(site: Path, tmp_path: Path) -> None:
    assert {outcome.status for outcome in outcomes(tmp_path)} == {"passed"}


@pytest.mark.parametrize("name", TOYS)
def test_each_toy_is_caught_by_its_check_and_by_no_other(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    break_it(site, *TOYS[name])
    if TOYS[name][0] != ENTRY:  # only of these a fresh interpreter has news
        monkeypatch.setattr(Subject, "imported", ("", list[str]()))
    found = outcomes(tmp_path)
    failed = [f"{outcome.check}: {outcome.message}" for outcome in found if outcome.status == "failed"]
    assert len(failed) == 1, failed
    assert failed[0].startswith(f"{name}: ")
    assert "\n" not in failed[0]


def test_an_expected_failure_needs_a_check_a_reason_and_the_failure(site: Path, tmp_path: Path) -> None:
    break_it(site, *TOYS["normals_are_unit"])
    source = ball(tmp_path / "ball.toy")
    why = {"normals_are_unit": "they carry areas"}
    statuses = {o.check: o.status for o in check_representation("toy", source, expected_failures=why)}
    assert statuses["normals_are_unit"] == "expected"
    assert statuses["projector_follows_scale"] == "skipped", "nobody said how to move it"
    with pytest.raises(ValueError, match=r"there is no check 'normals_unit'; did you mean normals_are_unit\?"):
        check_representation("toy", source, expected_failures={"normals_unit": "x"})
    with pytest.raises(ValueError, match="normals_are_unit needs a reason"):
        check_representation("toy", source, expected_failures={"normals_are_unit": " "})
    with pytest.raises(AssertionError, match=r"projector_is_pure: was expected to fail \(odd\), but passed"):
        check_representation("toy", source, expected_failures={**why, "projector_is_pure": "odd"})


def test_a_failure_is_raised_with_the_law_and_its_reason(site: Path, tmp_path: Path) -> None:
    break_it(site, *TOYS["projector_refuses_nan"])
    with pytest.raises(AssertionError) as caught:
        check_representation("toy", ball(tmp_path / "ball.toy"))
    assert "--repr toy breaks 1 of " in str(caught.value)
    assert "projector_refuses_nan: a coordinate that is nan is projected as if it were a number [A field" in str(
        caught.value
    )


def test_without_a_source_only_what_needs_none_is_checked(site: Path) -> None:
    by_status = {outcome.status for outcome in check_representation("toy")}
    assert by_status == {"passed", "skipped"}


def test_the_command_line_shows_every_law_and_fails_with_3(
    site: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    break_it(site, *TOYS["normals_are_unit"])
    source = ball(tmp_path / "ball.toy")
    assert main(["plugins", "--check", "toy", str(source)]) == 3
    lines = capfd.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == [check.name for check in CHECKS]
    (failed,) = [line for line in lines if " failed " in line]
    assert failed.endswith("of the normals are not of length 1 [The loss of normals compares directions.]")
    assert lines[-1] == f"{len(CHECKS)} laws: 1 broken, 2 not asked"
    assert main(["plugins", "--check", "toy", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["failed"] == 0


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--check", "toy", "none.toy"], 3, "none.toy: there is no such file"),
        (["--check", "toyy"], 2, "did you mean toy?"),
        (["toy"], 2, "NAME is for --check"),
        (["--check", "toy", "--timeout", "0.01"], 3, "did not finish within 0.01 s"),
    ],
)
def test_what_cannot_be_checked_is_one_line(
    site: Path, words: list[str], code: int, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["plugins", *words]) == code
    error = capfd.readouterr().err
    assert message in error
    assert len(error.splitlines()) == 1
