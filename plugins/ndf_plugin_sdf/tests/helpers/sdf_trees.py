"""CSG trees for the tests, and random ones for hypothesis."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from hypothesis import strategies as st
from ndf_plugin_sdf.csg.node import Node
from ndf_plugin_sdf.csg.tree import parse_tree

Tree = dict[str, Any]


def node(type: str, **fields: Any) -> Node:
    return parse_tree({"type": type, **fields})


def values(tree: Node, points: np.ndarray) -> np.ndarray:
    """The field at points (n, 3)."""
    with torch.no_grad():
        return tree.distance(torch.from_numpy(points.T.copy())).numpy()


def gradients(tree: Node, points: np.ndarray) -> np.ndarray:
    columns = torch.from_numpy(points.T.copy()).requires_grad_(True)
    (gradient,) = torch.autograd.grad(tree.distance(columns).sum(), columns)
    return gradient.numpy().T


def cloud(seed: int, count: int, reach: float) -> np.ndarray:
    """Points in a cube about the origin."""
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 3))


BALL: Tree = {"type": "sphere", "radius": 1.0, "center": [0.2, -0.1, 0.3]}
BRACKET: Tree = {
    "type": "difference",
    "children": [
        {
            "type": "smooth_union",
            "radius": 0.2,
            "children": [
                {"type": "box", "size": [3.0, 2.0, 0.4]},
                {"type": "box", "size": [0.4, 2.0, 2.0], "center": [-1.3, 0.0, 1.0]},
                {"type": "capped_cylinder", "start": [0.8, 0, -0.3], "end": [0.8, 0, 0.6], "radius": 0.6},
            ],
        },
        {"type": "capped_cylinder", "start": [0.8, 0, -1], "end": [0.8, 0, 1], "radius": 0.35},
        {"type": "capped_cylinder", "start": [-2, 0.4, 1.2], "end": [0, 0.4, 1.2], "radius": 0.3},
    ],
}
BLOB: Tree = {
    "type": "smooth_union",
    "radius": 0.6,
    "children": [
        {"type": "sphere", "radius": 1.0},
        {"type": "torus", "major_radius": 1.2, "minor_radius": 0.2},
        {"type": "capsule", "start": [0, 0, 0], "end": [1.5, 1, 1], "radius": 0.3},
    ],
}
TWISTED: Tree = {"type": "twist", "rate": 60, "child": {"type": "rounded_box", "size": [1, 1, 3], "radius": 0.1}}
BLADE: Tree = {
    "type": "intersection",
    "children": [
        {"type": "box", "size": [2, 1, 2]},
        {"type": "plane", "normal": [1, 4, 0], "offset": 0.2},
        {"type": "plane", "normal": [1, -4, 0], "offset": 0.2},
    ],
}
SQUASHED: Tree = {"type": "scale", "factor": [1.0, 0.5, 2.0], "child": {"type": "sphere", "radius": 1.0}}
SOLIDS = {"bracket": BRACKET, "blob": BLOB, "twisted": TWISTED, "blade": BLADE, "squashed": SQUASHED, "ball": BALL}

_length = st.floats(0.1, 1.0)
_coordinate = st.floats(-1.0, 1.0)
_vector = st.lists(_coordinate, min_size=3, max_size=3)
_direction = _vector.filter(lambda v: sum(x * x for x in v) > 0.1)
_sizes = st.lists(_length, min_size=3, max_size=3)


def _solid(type: str, **fields: Any) -> st.SearchStrategy[Tree]:
    return st.fixed_dictionaries({"type": st.just(type), **fields})


@st.composite
def _bars(draw: st.DrawFn) -> Tree:
    kind = draw(st.sampled_from(["capsule", "capped_cylinder", "cone"]))
    start, step = draw(_vector), draw(_direction)
    ends = {"start": start, "end": [a + b for a, b in zip(start, step, strict=True)]}
    if kind == "cone":
        return {"type": kind, **ends, "start_radius": draw(_length), "end_radius": draw(st.floats(0, 1))}
    return {"type": kind, **ends, "radius": draw(_length)}


PRIMITIVES = st.one_of(
    _solid("sphere", radius=_length, center=_vector),
    _solid("box", size=_sizes, center=_vector),
    _solid("rounded_box", size=_sizes, radius=st.just(0.04), center=_vector),
    _solid(
        "torus", major_radius=st.floats(0.5, 1.0), minor_radius=st.floats(0.05, 0.4), center=_vector, axis=_direction
    ),
    _solid("ellipsoid", radii=_sizes, center=_vector),
    _bars(),
)


def _over(children: st.SearchStrategy[Tree]) -> st.SearchStrategy[Tree]:
    several = st.lists(children, min_size=2, max_size=3)
    plain = st.sampled_from(["union", "intersection", "difference"])
    smooth = st.sampled_from(["smooth_union", "smooth_intersection", "smooth_difference"])
    return st.one_of(
        st.fixed_dictionaries({"type": plain, "children": several}),
        st.fixed_dictionaries({"type": smooth, "children": several, "radius": st.floats(0.02, 0.5)}),
        _solid("translate", child=children, offset=_vector),
        _solid("rotate", child=children, axis=_direction, angle=st.floats(-180, 180)),
        _solid("rotate", child=children, euler=_vector, unit=st.just("radians")),
        _solid("scale", child=children, factor=st.one_of(st.floats(0.3, 2.0), _sizes)),
        _solid("mirror", child=children, axis=st.sampled_from(["x", "y", "z"]), offset=_coordinate),
        _solid("round", child=children, radius=st.floats(0.02, 0.3)),
        _solid("shell", child=children, thickness=st.floats(0.02, 0.3)),
        _solid("ripple", child=children, amplitude=st.floats(0.01, 0.1), wavelength=st.floats(0.3, 2.0)),
        _solid("twist", child=children, rate=st.floats(-90, 90)),
    )


TREES = st.recursive(PRIMITIVES, _over, max_leaves=5)
"""Bounded solids, about three units large, of any kind but `repeat`."""
