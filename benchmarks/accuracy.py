"""Error of any asset against the surface it was fitted to, from the written file alone, with fresh samples.

Both directions use samples spread evenly by area; lengths are shares of the longest side of the base mesh. The table
goes to stderr, one JSON object to stdout. `--require` makes it a gate: exit status 1 when a limit is not met.

    python benchmarks/accuracy.py a.ndf ../shared/data/mesh/rocker-arm.obj --require field_to_surface.rms=1.2e-4 \
        surface_to_field.rms=1.5e-4 field_to_surface.p99=5e-4 cycle_loss=3e-6 folded_area=0 'converged>=0.999'
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
import tomllib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array

import ndf_core
from ndf_core.asset.asset import Asset
from ndf_core.errors import ConfigError, NdfError
from ndf_core.files import atomic_write
from ndf_core.fitting.measure import DenseMap, dense_map, measure
from ndf_core.interfaces import Surface
from ndf_core.kernels.mesh_check import check_mesh, measure_mesh

SEED = 77_003
"""Neither the fit (its seed) nor the figures in the asset (its seed plus one) use these samples."""
DIRECTIONS = ("field_to_surface", "surface_to_field")
STATISTICS = ("rms", "mean", "p99", "max")
SHARES = ("two_sided_rms", "cycle_loss", "folded_area", "against_area", "opposed_area", "converged")
NAMES = (*(f"{side}.{name}" for side in DIRECTIONS for name in STATISTICS), *SHARES, "asset_bytes")


@dataclass(frozen=True)
class Requirement:
    """A limit on one figure; met by numbers only, so NaN or a figure that the asset does not have fails it."""

    name: str
    limit: float
    at_least: bool

    @classmethod
    def parse(cls, text: str) -> Requirement:
        """From ``NAME=LIMIT`` (at most) or ``NAME>=LIMIT`` (at least).

        Raises:
            ConfigError: of another form, or no such figure.
        """
        match = re.fullmatch(r"([a-z0-9_.]+)\s*(<=|>=|=)\s*(\S+)", text.strip())
        try:
            limit = float(match[3]) if match else math.nan
        except ValueError:
            limit = math.nan
        if match is None or math.isnan(limit):
            raise ConfigError(f"--require {text}: give NAME=LIMIT (at most) or 'NAME>=LIMIT' (at least)")
        if match[1] not in NAMES:
            raise ConfigError(f"--require {text}: no figure {match[1]!r}; there are {', '.join(NAMES)}")
        return cls(match[1], limit, match[2] == ">=")

    def failure(self, result: dict[str, Any]) -> str | None:
        """What is wrong, or None where the limit is met."""
        value: Any = result
        for part in self.name.split("."):
            value = None if value is None else value[part]
        met = value is not None and (value >= self.limit if self.at_least else value <= self.limit)
        return None if met else f"{self.name} is {value}, required {'>=' if self.at_least else '<='} {self.limit:g}"


def measure_asset(
    asset: Asset, surface: Surface, samples: int = 100_000, seed: int = SEED, threads: int = 1
) -> dict[str, Any]:
    """All figures of an asset, JSON-ready. Lengths are shares of the longest side of its base mesh.

    `cycle_loss` is the mean squared error of the inverse in the paper's box, None without one. `against_area` is
    the share of the mapped area that faces against the surface's normal at its projection, `folded_area` what of it
    faces against all of the surface near it, across edges too; `opposed_area` the share of the
    triangles of the dense mapped mesh with a neighbour folded over them (unit normals' product below -1/2).
    """
    content = asset.content
    inverse = asset.evaluator("inverse") if "inverse" in content.fields else None

    def mapped(faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        return asset.evaluate(faces, barycentric, threads=threads)

    def base_points(faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        return np.einsum("nc,ncx->nx", barycentric, content.vertices[content.faces[faces]])

    accuracy = measure(
        mapped,
        len(content.faces),
        surface,
        content.center,
        content.scale,
        base_points,
        None if inverse is None else (lambda points: inverse.at_points(points, threads)),
        samples,
        seed,
        threads,
    )
    backward = accuracy.surface_to_field
    return {
        "field_to_surface": asdict(accuracy.field_to_surface),
        "surface_to_field": None if backward is None else asdict(backward),
        "two_sided_rms": accuracy.two_sided_rms,
        "cycle_loss": accuracy.cycle_loss,
        "folded_area": accuracy.folded_area,
        "against_area": accuracy.against_area,
        "opposed_area": opposed_area(dense_map(len(content.faces), mapped), content.faces),
        "converged": accuracy.converged,
        "asset_bytes": asset.size,
        "longest_side": asset.longest_side,
        "base_faces": len(content.faces),
        "feature_dim": content.fields["displacement"].feature_dim,
        "samples": samples,
        "seed": seed,
    }


def opposed_area(dense: DenseMap, base_faces: Int[Array, "f 3"]) -> float:
    """Share of the area in triangles that have a neighbour folded over them, across edges of the base mesh too."""
    index = weld(dense, base_faces)
    vertices = np.empty((int(index.max()) + 1, 3))
    vertices[index] = dense.vertices
    faces = index[dense.triangles].astype(np.int32)
    return measure_mesh(vertices, faces, check_mesh(faces, len(vertices)).twins).folded_area


def weld(dense: DenseMap, base_faces: Int[Array, "f 3"]) -> Int[Array, " m"]:
    """For each vertex of a dense map its number among the distinct base points: faces share corners and edges.

    By name, not by place, so that folds, which bring different points together, are not joined.
    """
    weights = np.rint(dense.barycentric * (1 << 20)).astype(np.int64)
    names = np.where(weights > 0, (base_faces[dense.base_faces].astype(np.int64) << 21) + weights, -1)
    return np.unique(np.sort(names, axis=1), axis=0, return_inverse=True)[1].reshape(-1)


def option(text: str) -> tuple[str, Any]:
    """An option KEY=VALUE; the value as in TOML, or else as text."""
    key, separator, value = text.partition("=")
    if not separator:
        raise ConfigError(f"{text}: options are given as KEY=VALUE")
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value


def table(result: dict[str, Any]) -> str:
    """The figures for people."""
    lines = [f"{'share of the longest side':28}" + "".join(f"{name:>11}" for name in STATISTICS)]
    for side in DIRECTIONS:
        row = result[side]
        cells = "".join(f"{row[name]:11.3e}" for name in STATISTICS) if row else "  the surface cannot be sampled"
        lines.append(f"{side.replace('_', ' '):28}{cells}")
    for name in SHARES:
        value = result[name]
        lines.append(f"{name.replace('_', ' '):28}{'none' if value is None else f'{value:11.4g}'}")
    lines.append(f"{'bytes':28}{result['asset_bytes']:11,}")
    return "\n".join(lines)


def run(arguments: argparse.Namespace) -> int:
    """Measure, print, and return the exit status."""
    if min(arguments.samples, arguments.threads) < 1 or arguments.seed < 0:
        raise ConfigError("--samples and --threads must be positive, --seed not negative")
    requirements = [Requirement.parse(text) for text in arguments.require]
    asset = ndf_core.load(arguments.asset)
    surface = ndf_core.open(arguments.surface, arguments.repr, **dict(map(option, arguments.option)))
    fitted_to = str(asset.content.provenance.get("input", ""))
    same = bool(fitted_to) and surface.fingerprint.startswith(fitted_to)
    if not same:
        print("note: the asset's provenance names another input, or other options of it", file=sys.stderr)
    figures = measure_asset(asset, surface, arguments.samples, arguments.seed, arguments.threads)
    result = {"asset": arguments.asset.name, "surface": Path(arguments.surface).name, "fitted_to_it": same, **figures}
    failures = [failure for item in requirements if (failure := item.failure(result))]
    result["failures"] = failures
    text = json.dumps(result, indent=1)
    if arguments.json:
        with atomic_write(arguments.json) as file:
            file.write(f"{text}\n".encode())
    print(table(result), file=sys.stderr)
    print(text)
    for failure in failures:
        print(f"not met: {failure}", file=sys.stderr)
    return 1 if failures else 0


def main(given: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("asset", type=Path)
    parser.add_argument("surface", help="what it was fitted to: a file, or module:callable")
    parser.add_argument("--repr", help="representation of the surface; otherwise its content decides")
    parser.add_argument("--option", nargs="*", default=[], metavar="KEY=VALUE", help="options of the representation")
    parser.add_argument("--samples", type=int, default=100_000, help="in each direction")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", type=Path, help="write the JSON object to this file too")
    parser.add_argument("--require", nargs="*", default=[], metavar="NAME=LIMIT", help=f"of {', '.join(NAMES)}")
    try:
        return run(parser.parse_args(given))
    except NdfError as error:
        print(f"error: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
