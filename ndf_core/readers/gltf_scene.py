"""The meshes of a glTF scene with the transforms of the nodes above them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


def placed_meshes(document: dict[str, Any]) -> Iterator[tuple[dict[str, Any], Float[Array, "4 4"]]]:
    """Every mesh of the default scene with its transform to the scene; all meshes, unmoved, where there is no scene.

    Raises:
        ValueError: the nodes are no forest, or a transform is not readable.
    """
    meshes = _table(document, "meshes")
    nodes = _table(document, "nodes")
    if not nodes:
        for mesh in meshes:
            yield mesh, np.eye(4)
        return
    waiting = [(index, np.eye(4)) for index in _roots(document, nodes)]
    seen: set[int] = set()
    while waiting:
        index, above = waiting.pop()
        # glTF forbids a node with two parents, and a walk that met one twice could go on for ever.
        if type(index) is not int or not 0 <= index < len(nodes) or index in seen:
            raise ValueError(f"its node {index!r:.40} does not exist or appears twice in the scene")
        seen.add(index)
        matrix = above @ _matrix(nodes[index])
        mesh = nodes[index].get("mesh")
        if mesh is not None:
            if type(mesh) is not int or not 0 <= mesh < len(meshes):
                raise ValueError(f"its node {index} names mesh {mesh!r:.40}, which does not exist")
            yield meshes[mesh], matrix
        waiting.extend((child, matrix) for child in nodes[index].get("children", []))


def _table(document: dict[str, Any], name: str) -> list[dict[str, Any]]:
    table = document.get(name, [])
    if not isinstance(table, list) or not all(isinstance(entry, dict) for entry in table):
        raise ValueError(f"its {name} are not a list of tables")
    return table


def _roots(document: dict[str, Any], nodes: list[dict[str, Any]]) -> list[Any]:
    scenes = _table(document, "scenes")
    if scenes:
        default = document.get("scene", 0)
        if type(default) is not int or not 0 <= default < len(scenes):
            raise ValueError(f"its scene {default!r:.40} does not exist")
        return list(scenes[default].get("nodes", []))
    children = {child for node in nodes for child in node.get("children", [])}
    return [index for index in range(len(nodes)) if index not in children]


def _matrix(node: dict[str, Any]) -> Float[Array, "4 4"]:
    """Transform of a node: a matrix by columns, or translation * rotation (x, y, z, w) * scale."""
    if "matrix" in node:
        return _numbers(node["matrix"], 16).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = _numbers(node.get("rotation", [0, 0, 0, 1]), 4)
    norm = x * x + y * y + z * z + w * w
    if norm == 0:
        raise ValueError("a node is rotated by a quaternion that is zero")
    s = 2.0 / norm
    rotation = np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    )
    matrix[:3, :3] = rotation * _numbers(node.get("scale", [1, 1, 1]), 3)
    matrix[:3, 3] = _numbers(node.get("translation", [0, 0, 0]), 3)
    return matrix


def _numbers(values: object, count: int) -> Float[Array, " n"]:
    if not isinstance(values, list) or len(values) != count or not all(type(v) in (int, float) for v in values):
        raise ValueError("the transform of a node is not a list of numbers")
    numbers = np.array(values, dtype=np.float64)
    if not (np.abs(numbers) < 1e30).all():
        raise ValueError("the transform of a node is not finite")
    return numbers
