"""The docs' pictures of every representation: the input beside the mesh extracted from its asset (docs/pictures).

Real files come from ../shared/data; the fits are those of `ndf fit` with fewer steps, unless a folder has assets
already, named NAME.ndf. Takes a quarter of an hour without them:

    python tools/docs_pictures.py [--assets FOLDER] [NAME ...]
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

import ndf_core
from ndf_core.render import write_png
from ndf_core.render.camera import Camera
from ndf_core.render.panels import panels
from ndf_core.render.raycast import render_mesh

REPOSITORY = Path(__file__).resolve().parents[1]
DATA = REPOSITORY.parent / "shared" / "data"
sys.path.insert(0, str(REPOSITORY / "benchmarks"))

import representation_pictures as inputs  # noqa: E402  # not a package

STEPS = 600
inputs.SAMPLES = 40_000
INPUTS = {
    "analytic": REPOSITORY / "examples" / "shapes" / "teapot.toml",
    "mesh": DATA / "mesh" / "rocker-arm.obj",
    "grid": DATA / "grid" / "spm152.nii.gz",
    "neural": DATA / "neural" / "niq_bunny.npz",
    "soup": DATA / "soup" / "beetle-alt.obj",
    "oriented-points": DATA / "pointcloud" / "gpmr_hand.pwn",
    "points": DATA / "pointcloud" / "ipsr_walrus.ply",
    "gaussians": DATA / "splat" / "statue_angel.sog",
    "nerf": DATA / "nerf" / "krrish_lego.ckpt",
}
UPRIGHT = {"nerf": "z", "grid": "z", "analytic": "z"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*INPUTS, []])
    parser.add_argument("--assets", type=Path)
    asked = parser.parse_args()
    for name in asked.names or INPUTS:
        path, start = INPUTS[name], time.perf_counter()
        kept = asked.assets / f"{name}.ndf" if asked.assets else None
        if kept is not None and kept.exists():
            asset = ndf_core.load(kept)
        else:
            asset = ndf_core.fit(ndf_core.open(path, repr=name), steps=STEPS)
        mesh = asset.extract(2 * asset.default_edge_length)
        turn = np.diag([1.0, -1.0, -1.0]) if name == "gaussians" else np.eye(3)
        vertices = mesh.vertices @ turn
        size = {"width": inputs.WIDTH, "height": inputs.HEIGHT}
        camera = Camera.framing(vertices, (30.0, 15.0), aspect=1.0, up=UPRIGHT.get(name, "y"))
        source = inputs.input_of(path, name)
        if isinstance(source, inputs.Dots):
            left, what = inputs.paint(source._replace(points=source.points @ turn), camera), source.what
        else:
            left, what = render_mesh(*source, **size, view=camera), f"{len(source[1]):,} triangles"
        right = render_mesh(vertices, mesh.faces, **size, view=camera)
        titles = [f"{path.name}: {what}", f"{asset.size / 1e3:.0f} KB, {len(mesh.faces):,} faces"]
        target = REPOSITORY / "docs" / "pictures" / f"{name}.png"
        target.parent.mkdir(exist_ok=True)
        write_png(target, panels([left, right], titles, columns=2))
        print(f"{target}  {time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
