"""The whole way from a surface to an asset: base mesh, initialisation, training, quantising, measuring, writing."""

from __future__ import annotations

import os
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array
from torch import Tensor

from ndf_core import __version__
from ndf_core.asset.asset import Asset
from ndf_core.asset.content import AssetContent
from ndf_core.base_mesh.quantise import EncodedBaseMesh, encode_base_mesh
from ndf_core.config.fit import FitConfig, LossWeights
from ndf_core.errors import ConfigError, ResumeError
from ndf_core.fitting.anchors import anchor_fingerprint, place_anchors, read_anchors
from ndf_core.fitting.checkpoint import (
    base_mesh_of,
    base_mesh_tensors,
    checkpoint_path,
    read_checkpoint,
    write_checkpoint,
)
from ndf_core.fitting.colors import colors_of, learn_colors
from ndf_core.fitting.geometry import BaseGeometry, base_frames
from ndf_core.fitting.identity import initial_parameters
from ndf_core.fitting.losses import Anchors
from ndf_core.fitting.measure import Accuracy, measure
from ndf_core.fitting.observer import Observer, Observers
from ndf_core.fitting.projection import BoxProjector
from ndf_core.fitting.quantise import quantise
from ndf_core.fitting.shared_base import TARGET_FACES, SharedBase, follow
from ndf_core.fitting.sphere_map import SphereMap
from ndf_core.fitting.trainer import Trainer, worthwhile_workers
from ndf_core.interfaces import Remark, Surface
from ndf_core.mesh import topology

CONFORMALITY = 3e-4
"""Weight of the conformality loss (App. D.3) beside lambda_P where a base mesh is fitted to another shape."""
NORMAL = 3e-4
"""The same of the normal loss (App. D.2): it unfolds slender triangles."""
TOLD_FOLDED = 0.01
"""Share of the area of a map that a message tells of."""
ANCHOR = 0.1
"""Weight of each anchor beside lambda_P (App. D.1), where the map starts from the identity ..."""
HELD_ANCHOR = 0.02
"""... and where it starts with its anchors met and has to keep them: each counts as 60 of 3,072 samples do."""
_NOT_IDENTITY = ("checkpoint_seconds", "device", "threads")
"""Options that do not say what is fitted: they stay out of the asset."""


@dataclass(frozen=True)
class FitResult:
    """What `run_fit` returns."""

    asset: Asset
    report: dict[str, Any]
    """JSON-ready: what `ndf fit --json` prints."""


@dataclass
class _Clock:
    """Seconds per stage."""

    observer: Observer
    seconds: dict[str, float] = field(default_factory=dict[str, float])

    @contextmanager
    def stage(self, name: str) -> Generator[None]:
        self.observer.stage(name)
        start = time.perf_counter()
        yield
        self.seconds[name.replace(" ", "_")] = time.perf_counter() - start


def run_fit(
    surface: Surface,
    config: FitConfig,
    *,
    output: Path | None = None,
    resume: bool = False,
    observer: Observer | None = None,
) -> FitResult:
    """Fit a base mesh and a displacement field to a surface.

    Args:
        surface: what `ndf_core.open` returned.
        config: all options; `ndf_core.fit` builds it from keywords.
        output: the asset to write; beside it lies a checkpoint while the fit runs. None keeps everything in memory.
        resume: go on from that checkpoint where there is one.
        observer: told about the progress; one that fails is reported once and stops nothing.

    Raises:
        ConfigError: CUDA was asked for and is not there, or the anchors cannot be read.
        BaseMeshError, FitError, ResumeError, OutputError: as they say.
        KeyboardInterrupt: after a checkpoint has been written.
    """
    observer = Observers.of(observer)
    device = _device(config)
    threads = config.threads or os.cpu_count() or 1
    before = torch.get_num_threads()
    # Work is shared out by rows over our own threads; torch's would only wait for each other.
    torch.set_num_threads(1 if device.type == "cpu" else before)
    report: dict[str, Any] | None = None
    observer.start(_announced(surface, config, output))
    try:
        result = _Run(surface, config, output, observer, device, threads).run(resume)
        report = result.report
        return result
    finally:
        torch.set_num_threads(before)
        observer.finish(report)


def _announced(surface: Surface, config: FitConfig, output: Path | None) -> dict[str, Any]:
    """What observers are told of a run when it starts."""
    return {
        "representation": surface.representation,
        "input": surface.fingerprint,
        "plugin": surface.plugin,
        "output": None if output is None else str(output),
        "config": config.model_dump(),
    }


def _device(config: FitConfig) -> torch.device:
    if config.device == "cuda" and not torch.cuda.is_available():
        raise ConfigError("--device cuda: this torch sees no CUDA device; use --device cpu, or leave it out")
    wanted = "cuda" if config.device == "auto" and torch.cuda.is_available() else config.device
    return torch.device("cpu" if wanted == "auto" else wanted)


class _Run:
    """One fit."""

    def __init__(
        self,
        surface: Surface,
        config: FitConfig,
        output: Path | None,
        observer: Observer,
        device: torch.device,
        threads: int,
    ) -> None:
        self._surface, self._config, self._observer = surface, config, observer
        self._output, self._device, self._threads = output, device, threads
        self._workers = config.threads or min(threads, worthwhile_workers(config.batch))
        self._clock = _Clock(observer)
        self._remarks: tuple[Remark, ...] = ()
        self._pairs = _anchor_pairs(config)
        self._training = config.model_copy(update={"loss": _weights(config)})
        self._shared: SharedBase | None = None
        if config.base_from is not None:
            assert self._pairs is not None, "base_from without anchors has been refused"
            self._shared = SharedBase(Path(config.base_from), self._pairs)
        self._start: SphereMap | None = None
        self._colors = colors_of(surface) if config.colors else None
        self._color_report: dict[str, Any] | None = None

    def run(self, resume: bool) -> FitResult:
        config, clock = self._config, self._clock
        held = self._held(resume)
        with clock.stage("base mesh"):
            base = self._base_mesh(held)
        geometry = BaseGeometry(base.placed, base.faces, self._device)
        projector = BoxProjector(self._surface.projector, base.center, base.scale, self._workers)
        anchors = self._anchors(geometry, base)
        with clock.stage("initialise"):
            parameters = initial_parameters(geometry, config if held is None else _without_training(config))
            if self._start is not None:
                follow(parameters, geometry, self._start, self._training)
        training = self._with_normals(geometry, projector)
        trainer = Trainer(parameters, geometry, projector, training, self._observer, anchors, self._workers)
        if held is not None:
            trainer.load_state(held)
            self._observer.message(f"resumed at step {trainer.step_count} of {config.steps}")
        with clock.stage("train"):
            trainer.run(config.steps, lambda: self._save(trainer, base))
            self._save(trainer, base)
        with clock.stage("quantise"):
            blocks = quantise(parameters, geometry, projector, config.seed, keep_inverse=config.keep_inverse)
        content = AssetContent(
            base.vertices, base.faces, base.center, base.scale, blocks, {}, base.blob, base.placement
        )
        with clock.stage("measure"):
            accuracy = self._measure(Asset(content))
        folded = accuracy.folded_area or 0.0
        if self._shared is not None and folded > TOLD_FOLDED:
            self._observer.message(
                f"{folded:.1%} of the surface is folded; give more anchors, or a base mesh of more faces"
            )
        asset = Asset(replace(content, provenance=self._provenance(accuracy, trainer)))
        if self._colors is not None:
            with clock.stage("colors"):
                learned = learn_colors(asset, self._colors, config.seed, self._threads)
            asset, self._color_report = learned.asset, learned.report
        with clock.stage("write"):
            size = self._write(asset)
        report = self._report(base, trainer, accuracy, size)
        if anchors is not None:
            report["anchors"] = _anchor_report(asset, anchors)
        return FitResult(asset, report)

    def _identity(self) -> dict[str, Any]:
        """What a checkpoint must agree with."""
        config = self._options("checkpoint_seconds")
        config["threads"], config["device"] = self._workers, self._device.type
        return {
            **config,
            "representation": self._surface.representation,
            "input": self._surface.fingerprint,
            "ndf": __version__,
            "torch": torch.__version__,
        }

    def _options(self, *left_out: str) -> dict[str, Any]:
        """The config with the anchors and the shared base mesh themselves in place of their paths."""
        options = self._config.model_dump(exclude=set(left_out))
        options["anchors"] = None if self._pairs is None else anchor_fingerprint(self._pairs)
        options["base_from"] = None if self._shared is None else self._shared.fingerprint
        return options

    def _held(self, resume: bool) -> dict[str, Tensor] | None:
        if not resume:
            return None
        if self._output is None:
            raise ResumeError("resuming needs the output path that the interrupted run had")
        path = checkpoint_path(self._output)
        if not path.exists():
            self._observer.message(f"no checkpoint {path.name}: starting from the beginning")
            return None
        return read_checkpoint(path, self._identity())

    def _base_mesh(self, held: dict[str, Tensor] | None) -> EncodedBaseMesh:
        if held is not None:
            base, self._remarks = base_mesh_of(held)
            return base
        faces = self._config.faces if self._shared is None else TARGET_FACES
        mesh = self._surface.base_mesh.extract(faces, self._config.seed)
        self._remarks = mesh.remarks
        for remark in mesh.remarks:
            self._observer.message(remark.message)
        if self._shared is None:
            return encode_base_mesh(mesh)
        base, self._start = self._shared.placed(mesh, self._config.seed, self._observer.message)
        return base

    def _with_normals(self, geometry: BaseGeometry, projector: BoxProjector) -> FitConfig:
        """The training of a map between surfaces has the normal loss where the surface has normals."""
        training = self._training
        if self._shared is None or training.loss.normal is not None:
            return training
        face = torch.zeros(1, dtype=torch.int64, device=geometry.device)
        middle = torch.full((1, 3), 1 / 3, device=geometry.device)
        found = projector.project(geometry.positions(face, middle), base_frames(geometry, face).normal)
        normal = 0.0 if found.normals is None else NORMAL * training.loss.projection
        return training.model_copy(update={"loss": training.loss.model_copy(update={"normal": normal})})

    def _anchors(self, geometry: BaseGeometry, base: EncodedBaseMesh) -> Anchors | None:
        if self._shared is not None:
            return self._shared.anchors(geometry, base)
        return None if self._pairs is None else place_anchors(self._pairs, geometry, base.center, base.scale)

    def _save(self, trainer: Trainer, base: EncodedBaseMesh) -> None:
        if self._output is None:
            return
        tensors = trainer.state | base_mesh_tensors(base, self._remarks)
        write_checkpoint(checkpoint_path(self._output), tensors, self._identity())

    def _measure(self, asset: Asset) -> Accuracy:
        """Error of the field as a client decodes it, with samples that training has not seen."""
        content, threads = asset.content, self._threads
        inverse = asset.evaluator("inverse") if "inverse" in content.fields else None

        def base_points(faces: Int[Array, " n"], barycentric: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
            return np.einsum("nc,ncx->nx", barycentric, content.placed[content.faces[faces]])

        return measure(
            lambda faces, barycentric: asset.evaluate(faces, barycentric, threads=threads),
            len(content.faces),
            self._surface,
            content.center,
            content.scale,
            base_points,
            None if inverse is None else (lambda points: inverse.at_points(points, threads)),
            seed=self._config.seed + 1,
            threads=threads,
        )

    def _provenance(self, accuracy: Accuracy, trainer: Trainer) -> dict[str, Any]:
        defaults = FitConfig.model_validate({}).model_dump()
        config = self._options(*_NOT_IDENTITY)
        error = accuracy.as_dict()
        error["trained_converged"] = trainer.converged / max(trainer.projected, 1)
        return {
            "ndf": __version__,
            "torch": torch.__version__,
            "plugin": self._surface.plugin,
            "representation": self._surface.representation,
            "input": self._surface.fingerprint[:32],
            "config": {key: value for key, value in config.items() if value != defaults[key]},
            "error": _rounded(error),
        }

    def _write(self, asset: Asset) -> int:
        if self._output is None:
            return asset.size
        size = asset.save(self._output)
        checkpoint_path(self._output).unlink(missing_ok=True)
        return size

    def _report(self, base: EncodedBaseMesh, trainer: Trainer, accuracy: Accuracy, size: int) -> dict[str, Any]:
        counts = topology(base.faces, len(base.vertices))
        side = 3.0 * base.scale
        seconds = {name: round(value, 4) for name, value in self._clock.seconds.items()}
        seconds["total"] = round(sum(self._clock.seconds.values()), 4)
        return {
            "representation": self._surface.representation,
            "seconds": seconds,
            "steps": trainer.step_count,
            "base_mesh": {
                "faces": counts.faces,
                "vertices": counts.vertices,
                "genus": counts.genus,
                "components": counts.components,
                "remarks": [
                    {"kind": r.kind, "message": r.message, "position": r.position, "size": r.size, "count": r.count}
                    for r in self._remarks
                ],
            },
            "projection_rms": accuracy.field_to_surface.rms * side,
            "projection_rms_relative": accuracy.field_to_surface.rms,
            "converged": trainer.converged / max(trainer.projected, 1) if trainer.projected else accuracy.converged,
            "projected": trainer.projected,
            "left_out": trainer.projected - trainer.converged,
            "pulled": trainer.pulled,
            "cycle_loss": accuracy.cycle_loss,
            "asset_bytes": size,
            "longest_side": side,
            "error": accuracy.as_dict(),
            "device": self._device.type,
            "threads": self._workers,
            **({"colors": self._color_report} if self._color_report else {}),
        }


def _anchor_pairs(config: FitConfig) -> Float[Array, "m 6"] | None:
    """The anchors, read once.

    Raises:
        ConfigError: they cannot be read, or are not given although a weight or another asset's base mesh is.
    """
    if config.loss.anchor and not config.anchors:
        raise ConfigError("--loss.anchor: there are no anchors to weigh; give --anchors FILE too")
    if config.base_from is not None and not config.anchors:
        raise ConfigError("--base-from: needs --anchors, pairs of points of that asset's surface and of the input")
    return read_anchors(Path(config.anchors)) if config.anchors else None


def _weights(config: FitConfig) -> LossWeights:
    """The weights of the losses, with what is left to us filled in but for the normal loss's."""
    given = config.loss
    anchor = given.anchor
    if anchor is None and config.anchors:
        anchor = (ANCHOR if config.base_from is None else HELD_ANCHOR) * given.projection
    conformality = given.conformality
    if conformality is None and config.base_from is not None:
        conformality = CONFORMALITY * given.projection
    return given.model_copy(update={"anchor": anchor or 0.0, "conformality": conformality or 0.0})


def _anchor_report(asset: Asset, anchors: Anchors) -> dict[str, Any]:
    """How far the asset's anchors end from their targets, as shares of the longest side."""
    faces, barycentric = anchors.base.face.cpu().numpy(), anchors.base.barycentric.double().cpu().numpy()
    missed = asset.evaluate(faces, barycentric) - anchors.targets.cpu().numpy()
    missed = np.linalg.norm(missed, axis=1) * asset.content.scale / asset.longest_side
    return {"pairs": len(missed), "mean": float(missed.mean()), "largest": float(missed.max())}


def _without_training(config: FitConfig) -> FitConfig:
    """A resumed run takes its parameters from the checkpoint: no need to train the identity again."""
    return config.model_copy(update={"identity_steps": 0})


def _rounded(value: Any) -> Any:
    """Numbers to four significant digits, for a header of few bytes."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    return float(f"{value:.4g}") if isinstance(value, float) else value
