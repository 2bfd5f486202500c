"""Trees from text: the same solid whatever the format, and every fault named by its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ndf_plugin_sdf.csg.tree import parse_tree, read_tree
from sdf_trees import BALL, BRACKET, SOLIDS, cloud, values

from ndf_core.errors import InputError

TOML = """
# a ball with a hole
type = "difference"
[[children]]
type = "sphere"
radius = 1
[[children]]
type = "capped_cylinder"
start = [0, 0, -2]
end = [0, 0, 2]
radius = 0.5
"""


def faults(document: object) -> str:
    with pytest.raises(InputError) as caught:
        parse_tree(document)
    return str(caught.value)


def write(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_toml_and_json_say_the_same(tmp_path: Path) -> None:
    from_toml = read_tree(write(tmp_path, "a.toml", TOML))
    from_json = read_tree(write(tmp_path, "a.json", from_toml.model_dump_json()))
    assert from_json == from_toml
    points = cloud(0, 100, 1.5)
    np.testing.assert_array_equal(values(from_toml, points), values(from_json, points))


@pytest.mark.parametrize("name", SOLIDS)
def test_writing_and_reading_a_tree_is_the_identity(name: str) -> None:
    tree = parse_tree(SOLIDS[name])
    assert parse_tree(json.loads(tree.model_dump_json())) == tree


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"children": [BALL, {**BALL, "radius": -1}]}, "shape.children[1].radius: must be at least 1e-12 (got -1)"),
        ({"children": [BALL, {**BALL, "radius": "x"}]}, "shape.children[1].radius: must be a number (got 'x')"),
        ({"children": [BALL, {**BALL, "radius": True}]}, "shape.children[1].radius: must be a number (got True)"),
        (
            {"children": [BALL, {**BALL, "radius": float("nan")}]},
            "children[1].radius: must be a finite number (got nan)",
        ),
        ({"children": [BALL, {**BALL, "radius": 1e300}]}, "children[1].radius: must be at most 1e+09 (got 1e+300)"),
        ({"children": [BALL, {**BALL, "radius": 10**400}]}, "shape.children[1].radius: "),
        ({"children": [BALL, {**BALL, "center": [0, 0]}]}, "shape.children[1].center[2]: is missing"),
        ({"children": [BALL, {**BALL, "center": [0, 0, 0, 0]}]}, "center: must have at most 3 entries"),
        ({"children": [BALL, {**BALL, "size": 3}]}, "shape.children[1].size: is not a field of this solid (got 3)"),
        ({"children": [BALL, {"type": "sphere"}]}, "shape.children[1].radius: is missing"),
        (
            {"children": [BALL, {"type": "spere"}]},
            "shape.children[1]: there is no solid of type 'spere'; there are 'sp",
        ),
        ({"children": [BALL, {"radius": 1}]}, "shape.children[1]: a solid needs a `type`"),
        ({"children": [BALL, 7]}, "shape.children[1]: must be a solid: a table with a `type` (got 7)"),
        ({"children": [BALL]}, "shape.children: must have 2 or more entries"),
        ({"children": []}, "shape.children: must have 2 or more entries"),
        ({"children": BALL}, "shape.children: must be a list"),
        ({}, "shape.children: is missing"),
    ],
)
def test_faults_name_their_place(change: dict[str, Any], fault: str) -> None:
    message = faults({"type": "union", **change})
    assert fault in message
    assert len(message.splitlines()) == 2


@pytest.mark.parametrize(
    ("tree", "fault"),
    [
        ({"type": "rounded_box", "size": [1, 1, 1], "radius": 0.6}, "more than half of the shortest side"),
        ({"type": "torus", "major_radius": 1, "minor_radius": 1}, "minor_radius must be below major_radius"),
        ({"type": "torus", "major_radius": 1, "minor_radius": 0.1, "axis": [0, 0, 0]}, "axis must not be zero"),
        ({"type": "capsule", "start": [1, 1, 1], "end": [1, 1, 1], "radius": 1}, "start and end must differ"),
        ({"type": "plane", "normal": [0, 0, 0]}, "normal must not be zero"),
        ({"type": "rotate", "child": BALL, "axis": [0, 0, 1]}, "either axis and angle, or euler"),
        ({"type": "rotate", "child": BALL}, "either axis and angle, or euler"),
        (
            {"type": "rotate", "child": BALL, "euler": [0, 0, 0], "axis": [0, 0, 1], "angle": 1},
            "either axis and angle",
        ),
        ({"type": "rotate", "child": BALL, "axis": [0, 0, 0], "angle": 1}, "axis must not be zero"),
        ({"type": "twist", "child": BALL, "rate": 1, "unit": "turns"}, "shape.unit: must be 'degrees' or 'radians'"),
    ],
)
def test_solids_that_make_no_sense(tree: dict[str, Any], fault: str) -> None:
    assert fault in faults(tree)


def test_all_faults_come_at_once() -> None:
    tree = json.loads(json.dumps(BRACKET))
    tree["children"][0]["radius"] = -1
    tree["children"][1]["radius"] = "wide"
    tree["children"][2]["colour"] = "red"
    message = faults(tree)
    for place in ("shape.children[0].radius", "shape.children[1].radius", "shape.children[2].colour"):
        assert place in message
    assert len(message.splitlines()) == 4


def test_many_faults_are_cut_short() -> None:
    message = faults({"type": "union", "children": [{"type": "sphere"}] * 100})
    assert "and 80 more" in message
    assert len(message.splitlines()) == 22


def nested(depth: int) -> dict[str, Any]:
    tree: dict[str, Any] = BALL
    for _ in range(depth):
        tree = {"type": "round", "radius": 0.01, "child": tree}
    return tree


def test_size_is_bounded(tmp_path: Path) -> None:
    assert parse_tree(nested(39)).bounds().finite
    assert "nested too deeply" in faults(nested(60))
    assert "more than 2000 solids" in faults({"type": "union", "children": [BALL] * 3000})
    deep = '{"type":"round","radius":1,"child":' * 100_000
    with pytest.raises(InputError, match="nested too deeply|not valid JSON"):
        read_tree(write(tmp_path, "deep.json", deep))
    with pytest.raises(InputError, match="nested too deeply|not valid TOML"):
        read_tree(write(tmp_path, "deep.toml", "a = " + "[" * 100_000))
    with pytest.raises(InputError, match="more than 4 MiB"):
        read_tree(write(tmp_path, "long.toml", "#" * (5 << 20)))


def test_copies_of_copies_are_bounded() -> None:
    """Each point is near up to 5^3 copies; three levels of it would be two million primitives per point."""
    tree: dict[str, Any] = {"type": "sphere", "radius": 1.0}
    for _ in range(3):
        size = parse_tree(tree).bounds().longest_side
        tree = {"type": "repeat", "child": tree, "count": [9, 9, 9], "spacing": [size / 3] * 3}
        try:
            parse_tree(tree)
        except InputError as error:
            assert "primitives" in str(error)
            return
    pytest.fail("not refused")


@pytest.mark.parametrize(
    ("name", "content", "fault"),
    [
        ("a.toml", "type = ", "not valid TOML"),
        ("a.json", "{", "not valid JSON"),
        ("a.toml", b"\xff\xfe\x00", "not text in UTF-8"),
        ("a.toml", "radius = 1", "no `type` at the top"),
        ("a.json", "[1, 2]", "no `type` at the top"),
        ("a.json", "3", "no `type` at the top"),
        ("a.json", '{"type": ["sphere"]}', "there is no solid of type"),
        ("a.json", '{"type": "sphere", "radius": ' + "9" * 5000 + "}", "not valid JSON"),
        ("a.toml", "type = 'sphere'\nradius = 1979-05-27", "shape.radius: must be a number"),
        ("a.toml", "type = 'sphere'\nradius = inf", "shape.radius: must be a finite number"),
    ],
)
def test_files_that_are_no_trees(tmp_path: Path, name: str, content: str | bytes, fault: str) -> None:
    path = write(tmp_path, name, content)
    with pytest.raises(InputError) as caught:
        read_tree(path)
    assert fault in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_tree(tmp_path / "none.toml")
