"""Ten eigenfunctions in one network (paper App. B.5): what does the intrinsic encoding gain, and what can be had at
its size?

    python benchmarks/scalar_fields.py ASSET MESH --steps 40000 [--dims 2 4 8] [--code number|learned] [--best JSON]

`baseline` sees the point on the fine surface, `ours` the point of the base mesh and d features per vertex; both see
which function is asked for, and are trained alike: 2 x 32 network, 8 octaves, Adam at 1e-3, 3,276 points a step, each
with all ten functions. The function is told by its number k, encoded like a coordinate ("four dimensions, xyz and the
latent code"), or by a code of eight numbers that is learned with the network. Errors are rms over the rms of the
functions, at 100,000 points of their own. `best` is this project's own recipe. Bytes are what the field adds to an
asset, rounded and coded alike for all.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array

from ndf_core.asset.asset import Asset
from ndf_core.asset.content import FieldBlock
from ndf_core.config.field import FieldConfig
from ndf_core.fitting.field_fit import Learned, evaluate, learn, rounded_block
from ndf_core.fitting.field_samples import FieldSamples, sample_values
from ndf_core.fitting.field_values import FieldValues, check_values
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.network import Parameters
from ndf_core.kernels.bvh import TriangleBVH
from ndf_core.processing.mesh_input import read_input
from ndf_core.processing.operators import Operators
from ndf_core.processing.spectrum import laplace_spectrum

FUNCTIONS = 10
TRAINING, TEST = 2**18, 100_000
PAPER: dict[str, Any] = {
    "hidden": 32,
    "latent": 8,
    "batch": 3276,
    "optimizer": "adam",
    "schedule": "constant",
    "learning_rate": 1e-3,
    "feature_learning_rate": 1e-3,
    "adam_beta2": 0.999,
    "warmup_steps": 0,
    "frequency_damping": 1.0,
}
RESULTS = Path(__file__).resolve().parent / "results" / "scalar_fields.json"


class OnSurface(BaseGeometry):
    """Samples as points of the fine surface: each is a face of its own, all of whose corners are the point."""

    def __init__(self, points: Float[Array, "n 3"]) -> None:
        super().__init__(points, np.repeat(np.arange(len(points))[:, None], 3, axis=1))


class Experiment:
    """One shape: its eigenfunctions, and samples of them for training and for the error."""

    def __init__(self, asset: Path, mesh: Path, device: str) -> None:
        self.device = device
        self.asset = Asset.load(asset)
        fine = read_input(mesh)
        spectrum = laplace_spectrum(Operators.of(fine), FUNCTIONS + 1)
        values = FieldValues(fine.vertices, spectrum.eigenfunctions[:, 1:], fine.faces)
        checked = check_values(values, "continuous")
        self.train = sample_values(self.asset, checked, "continuous", TRAINING, 1, 1)
        self.test = sample_values(self.asset, checked, "continuous", TEST, 2, 1)
        self._tree = TriangleBVH(fine.vertices, fine.faces)
        content = self.asset.content
        self.geometry = BaseGeometry(content.vertices, content.faces)

    def run(
        self, config: FieldConfig, baseline: bool = False, codes: Float[torch.Tensor, "k l"] | None = None
    ) -> dict[str, Any]:
        """Learn, round, and measure what was learned and what is stored."""
        train, geometry = self._on_surface(self.train) if baseline else (self.train, self.geometry)
        test, seen = self._on_surface(self.test) if baseline else (self.test, self.geometry)
        vertices, faces = geometry.vertices.numpy(), geometry.faces.numpy()
        start = time.process_time()
        learned = _on_cpu(learn(BaseGeometry(vertices, faces, self.device), train, config, codes))
        seconds = time.process_time() - start
        error = self._error(
            lambda base: learned.shift + learned.scale * evaluate(learned.parameters, base), test, seen
        )
        block = rounded_block(learned, geometry, train, config, "modes")
        for name, view in learned.parameters.views.items():
            view.copy_(torch.from_numpy(_numbers(block, name)))
        return {
            "error": error,
            "error_stored": self._error(lambda base: evaluate(learned.parameters, base), test, seen),
            "bytes": self._bytes(replace(block, domain="space", features=self._none()) if baseline else block),
            "steps": config.steps,
            "seconds": seconds,
            "device": self.device,
        }

    def _on_surface(self, samples: FieldSamples) -> tuple[FieldSamples, BaseGeometry]:
        content = self.asset.content
        mapped = self.asset.map_points(samples.faces.numpy(), samples.barycentric.numpy().astype(np.float64))
        points = (self._tree.closest(mapped)[0] - content.center) / content.scale
        corner = torch.tensor([1.0, 0.0, 0.0]).expand(len(samples), 3)
        return replace(samples, faces=torch.arange(len(samples)), barycentric=corner), OnSurface(points)

    def _error(self, values: Any, test: FieldSamples, geometry: BaseGeometry) -> float:
        wrong = size = 0.0
        for rows in torch.arange(len(test)).split(8192):
            base, targets = test.rows(geometry, rows)
            found = values(base)
            found = found if len(found) == len(targets) else found[0].t()[:, :, None]
            wrong += float((found - targets).double().square().sum())
            size += float(targets.double().square().sum())
        return (wrong / size) ** 0.5

    def _none(self) -> Array:
        return np.zeros((len(self.asset.content.vertices), 0), np.float32)

    def _bytes(self, block: FieldBlock) -> int:
        content = self.asset.content
        return Asset(replace(content, fields={**content.fields, "modes": block})).size - self.asset.size


def _on_cpu(learned: Learned) -> Learned:
    parameters = Parameters(learned.parameters.shape, learned.parameters.flat.cpu())
    return Learned(parameters, learned.shift.cpu(), learned.scale.cpu())


def numbered_codes(config: FieldConfig) -> Float[torch.Tensor, "k l"]:
    """The numbers 0 to 9 spread over the side of the box, encoded as the coordinates are."""
    numbers = torch.linspace(-1.5, 1.5, FUNCTIONS)[:, None]
    angles = numbers * config.base_frequency * 2.0 ** torch.arange(config.encoding_levels)
    return torch.cat([numbers, angles.sin(), angles.cos()], 1)


def _numbers(block: FieldBlock, name: str) -> Array:
    """The numbers of a stored block by the name of the parameter."""
    from ndf_core.asset.content import values_of

    if name in ("features", "latent"):
        array = block.features if name == "features" else block.latent
        assert array is not None
        return values_of(array)
    _, part, index = name.split(".")
    return values_of((block.weights if part == "weight" else block.biases)[int(index)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", type=Path)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--steps", type=int, default=40_000)
    parser.add_argument("--dims", type=int, nargs="*", default=[2, 4, 8], help="feature dimensions of ours; none: 0")
    parser.add_argument("--no-baseline", action="store_true")
    parser.add_argument("--best", type=json.loads, metavar="JSON", help="also a run of our recipe with these options")
    parser.add_argument("--code", choices=("number", "learned"), default="number", help="how a function is told")
    parser.add_argument("--averaged", type=float, default=0.0, help="last share of the steps whose mean is kept")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu", help="to train on")
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args()
    torch.set_num_threads(1)
    experiment = Experiment(options.asset, options.mesh, options.device)
    paper, told = {**PAPER, "averaged": options.averaged, "seed": options.seed}, ""
    if options.code == "number":
        paper["latent"], told = numbered_codes(FieldConfig()).shape[1], " of k"
    runs: dict[str, FieldConfig] = {}
    if not options.no_baseline:
        runs[f"baseline{told}"] = FieldConfig(**paper, steps=options.steps, feature_dim=0)
    runs |= {f"ours{told} d={d}": FieldConfig(**paper, steps=options.steps, feature_dim=d) for d in options.dims}
    if options.best is not None:
        runs["best"] = FieldConfig(**options.best)
    for name, config in runs.items():
        codes = numbered_codes(config) if told and name != "best" else None
        found = experiment.run(config, name.startswith("baseline"), codes)
        print(options.mesh.stem, name, json.dumps(found), file=sys.stderr, flush=True)
        results = json.loads(options.results.read_text()) if options.results.exists() else {}
        on = "" if name.startswith("baseline") else f" on {len(experiment.asset.content.faces):,} faces"
        kept = f", mean of the last {config.averaged:.0%}" if config.averaged else ""
        again = f", seed {config.seed}" if config.seed else ""
        results.setdefault(options.mesh.stem, {})[f"{name}{on}, {config.steps} steps{kept}{again}"] = found
        options.results.write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
