"""The laws of `ndf_core.testing` on every representation of this plugin."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
import trimesh
from networks import Ball

from ndf_core.testing import Motion, NotAsked
from ndf_core.testing.suite import RepresentationSuite

SOLID = {
    "type": "smooth_union",
    "radius": 0.3,
    "children": [
        {"type": "box", "size": [3.0, 1.0, 0.6]},
        {"type": "torus", "major_radius": 1.2, "minor_radius": 0.3},
    ],
}


class TestAnalytic(RepresentationSuite):
    name = "analytic"
    options: ClassVar = {"resolution": 48}

    def source(self, folder: Path) -> Path:
        return _tree(folder / "solid.json", SOLID)

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path:
        return _tree(folder / "moved.json", moved_tree(json.loads(source.read_text()), motion))


class TestMesh(RepresentationSuite):
    name = "mesh"
    tolerance = 1e-9

    def source(self, folder: Path) -> Path:
        return write_mesh(folder / "ring.ply", trimesh.creation.torus(2.0, 0.6))

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path:
        mesh = trimesh.load(source, process=False)
        assert isinstance(mesh, trimesh.Trimesh)
        moved = trimesh.Trimesh(motion.apply(np.asarray(mesh.vertices)), mesh.faces, process=False)
        return write_mesh(folder / "moved.ply", moved)


class TestGrid(RepresentationSuite):
    name = "grid"
    frame = np.diag([0.2, 0.25, 0.3, 1.0])

    def source(self, folder: Path) -> Path:
        index = np.argwhere(np.ones((24, 22, 20)))
        points = index @ self.frame[:3, :3].T
        offset = points - points.mean(axis=0)
        ring = np.hypot(np.hypot(offset[:, 0], offset[:, 1]) - 1.3, offset[:, 2]) - 0.7
        return _volume(folder / "ring.npz", ring.reshape(24, 22, 20).astype(np.float32), self.frame)

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path:
        frame = np.eye(4)
        frame[:3, :3] = motion.scale * motion.rotation @ self.frame[:3, :3]
        frame[:3, 3] = motion.translation
        return _volume(folder / "moved.npz", np.load(source)["volume"], frame)


class TestNeural(RepresentationSuite):
    name = "neural"
    options: ClassVar = {"resolution": 48}

    def source(self, folder: Path) -> Path:
        return _weights(folder / "ball.npz", Ball().state_dict())

    def moved(self, source: Path, motion: Motion, folder: Path) -> Path:
        raise NotAsked("the box that a network knows is an option, not part of its file")


def moved_tree(tree: dict[str, Any], motion: Motion) -> dict[str, Any]:
    """The tree in nodes that turn, scale and move it."""
    cosine = (np.trace(motion.rotation) - 1) / 2
    turn = motion.rotation - motion.rotation.T
    axis = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
    if np.linalg.norm(axis) > 0:
        angle = float(np.degrees(np.arccos(cosine)))
        tree = {"type": "rotate", "axis": axis.tolist(), "angle": angle, "child": tree}
    tree = {"type": "scale", "factor": motion.scale, "child": tree}
    return {"type": "translate", "offset": motion.translation.tolist(), "child": tree}


def write_mesh(path: Path, mesh: trimesh.Trimesh) -> Path:
    """In double precision, which trimesh's own writer does not keep."""
    lines = [f"{x!r} {y!r} {z!r}" for x, y, z in np.asarray(mesh.vertices).tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in np.asarray(mesh.faces).tolist()]
    header = ["ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}"]
    header += [f"property double {axis}" for axis in "xyz"]
    header += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices", "end_header"]
    path.write_text("\n".join([*header, *lines, ""]))
    return path


def _tree(path: Path, tree: dict[str, Any]) -> Path:
    path.write_text(json.dumps(tree))
    return path


def _volume(path: Path, values: np.ndarray, frame: np.ndarray) -> Path:
    np.savez(path, volume=values, affine=frame)
    return path


def _weights(path: Path, state: dict[str, torch.Tensor]) -> Path:
    arrays: dict[str, Any] = {name: tensor.numpy() for name, tensor in state.items()}
    np.savez(path, **arrays)
    return path
