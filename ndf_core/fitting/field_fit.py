"""Learning fields on an asset's surface: samples, training, rounding, and the asset with the field (Sec. 3.5)."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ndf_core.asset.asset import Asset
from ndf_core.asset.content import Encoding, FieldBlock
from ndf_core.asset.limits import LABEL
from ndf_core.config.field import FieldConfig
from ndf_core.errors import ConfigError, FitError
from ndf_core.fitting.compact import decorrelate
from ndf_core.fitting.field_losses import loss_of, squared_error
from ndf_core.fitting.field_samples import FieldSamples, sample_values
from ndf_core.fitting.field_size import Standard, coded_size, fit_to_size
from ndf_core.fitting.field_step import FieldStep
from ndf_core.fitting.field_values import FieldValues, check_values
from ndf_core.fitting.geometry import BaseGeometry
from ndf_core.fitting.network import NetworkShape, Parameters, apply_network, encode, interpolate
from ndf_core.fitting.optimizer import Optimizer, rate_factor
from ndf_core.fitting.quantise import coarsest, sensitivities, stored
from ndf_core.fitting.sampling import BasePoints, generator_at
from ndf_core.fitting.trainer import row_slices

_RESERVED = ("displacement", "inverse")
_TILE = 16_384
"""Rows of the network that are computed at once, so that they stay in cache."""
_MEASURED = 16_384
"""Samples that decide how finely numbers are kept."""
_PROBED = 2048
"""Samples for what the outputs' derivatives are averaged over."""
_LEAST_LOSS = {"continuous": 1e-10, "binary": 1e-4, "categorical": 1e-4}
"""Nothing is gained from keeping numbers finer than this error needs; of values of unit size."""


@dataclass(frozen=True)
class FieldFit:
    """What `fit_field` returns."""

    asset: Asset
    """The asset with the field."""
    report: dict[str, Any]
    """JSON-ready: what `ndf field fit --json` prints."""


def fit_field(
    asset: Asset,
    values: FieldValues,
    name: str,
    config: FieldConfig | None = None,
    labels: Sequence[str] = (),
    threads: int = 1,
) -> FieldFit:
    """Learn a field, or several in one network, as a function over the base mesh: u_phi with u_phi(x) = u(g(x)).

    Args:
        asset: its displacement stays as it is; a field of this name is replaced.
        values: on a mesh of the surface, or at points near it, in the units of the asset's input.
        name: an identifier.
        config: kind, sizes and training options.
        labels: names of the columns, or of a categorical field's classes.
        threads: for closest points.

    Raises:
        ConfigError: a name that is taken or no identifier, or a latent code for a categorical field.
        InputError: values that cannot be learned; the message says which.
        FitError: the loss is not finite.

    Reference: Sec. 3.5; App. B.5 for latent codes.
    """
    config = config or FieldConfig.model_validate({})
    if not (name.isidentifier() and name.isascii() and len(name) <= 64) or name in _RESERVED:
        raise ConfigError(f"field name {name!r:.70}: must be an identifier of at most 64 letters, not {_RESERVED}")
    if config.latent and config.kind == "categorical":
        raise ConfigError("latent codes are for several fields; a categorical field is one, with an output per class")
    if config.size and (config.latent or config.kind != "continuous"):
        raise ConfigError("a size in bytes is for continuous fields without latent codes; leave `size` out")
    start = time.perf_counter()
    checked = check_values(values, config.kind, labels if config.kind == "categorical" else ())
    columns = checked.targets.shape[1] * checked.targets.shape[2]
    if labels and len(labels) != columns:
        raise ConfigError(f"{len(labels)} labels for {columns} columns: give one for each, or none")
    if not all(label.isprintable() and 1 <= len(label) <= LABEL for label in (*labels, *checked.labels)):
        raise ConfigError(f"a label must be printable text of 1 to {LABEL} characters")
    samples = sample_values(asset, checked, config.kind, config.samples, config.seed, threads)
    content = asset.content
    geometry = BaseGeometry(content.vertices, content.faces)
    sampled = time.perf_counter()
    with one_thread():
        learned = learn(geometry, samples, config)
    trained = time.perf_counter()
    block = rounded_block(learned, geometry, samples, config, name)
    block = replace(block, labels=checked.labels or tuple(labels))
    fields = {**content.fields, name: block}
    result = Asset(replace(content, fields=fields))
    error = field_error(result, name, samples)
    told = dict(content.provenance.get("fields", {})) | {name: {key: float(f"{v:.4g}") for key, v in error.items()}}
    provenance = {**content.provenance, "fields": told}
    result = Asset(replace(content, fields=fields, provenance=provenance))
    before = Asset(replace(content, fields={key: kept for key, kept in content.fields.items() if key != name}))
    report = {
        "field": name,
        "kind": config.kind,
        "columns": block.columns,
        "labels": block.labels,
        "samples": len(samples),
        "left_out": samples.left_out,
        "invented": samples.invented,
        "largest_offset": samples.largest_offset,
        "error": error,
        "field_bytes": result.size - before.size,
        "asset_bytes": result.size,
        "seconds": {
            "sample": sampled - start,
            "train": trained - sampled,
            "round": time.perf_counter() - trained,
        },
    }
    return FieldFit(result, report)


@contextmanager
def one_thread() -> Generator[None]:
    """Keep torch to one thread: rows are few, and its threads would wait for each other at every operation."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@dataclass(frozen=True)
class Learned:
    """A trained network, and how its outputs become values."""

    parameters: Parameters
    shift: Float[Tensor, " o"]
    scale: Float[Tensor, " o"]
    """value = shift + scale * output; 0 and 1 but for continuous fields."""

    @property
    def standard(self) -> Standard:
        return Standard(self.shift, self.scale)


def learn(
    geometry: BaseGeometry, samples: FieldSamples, config: FieldConfig, codes: Float[Tensor, "k l"] | None = None
) -> Learned:
    """Train a network on the samples; continuous values are brought to mean 0 and variance 1 first.

    Args:
        geometry: on the device to train on, where `Learned` then is.
        samples: on any device.
        config: kind, sizes and training options.
        codes: latent codes that stay as they are; None learns them.

    Raises:
        FitError: the loss is not finite.
    """
    device = geometry.device
    if not config.latent:
        samples = _one_field(samples)
    shift, scale = _standard(samples.targets, config.kind)
    samples = replace(samples, targets=(samples.targets - shift) / scale).to(device)
    fields, outputs = samples.targets.shape[1:]
    shape = NetworkShape(
        encoding=Encoding(config.base_frequency, config.encoding_levels, include_position=True),
        hidden_width=config.hidden,
        hidden_layers=config.hidden_layers,
        vertex_count=len(geometry.vertices),
        feature_dim=config.feature_dim,
        outputs=outputs,
        networks=("forward",),
        latent=(fields, config.latent) if config.latent else (0, 0),
    )
    parameters = Parameters.initial(
        shape, config.seed, zero_last=False, feature_scale=config.feature_scale, device=device
    )
    parameters.damp_octaves(config.frequency_damping)
    if codes is not None:
        parameters.views["latent"].copy_(codes)
    optimizer, loss_function = Optimizer(parameters, config), loss_of(config)
    count = min(config.batch, len(samples))
    tile = _TILE // fields if torch.device(device).type == "cpu" else count
    (tiles,) = row_slices(count, 1, max(1, tile))
    gradient = Parameters.zeros(shape, device)
    steps = {n: FieldStep(shape, n, device, gradient) for n in {part.stop - part.start for part in tiles}}
    first_kept, mean = config.steps - max(1, round(config.averaged * config.steps)), torch.zeros_like(parameters.flat)
    for number in range(config.steps):
        base, targets = samples.batch(geometry, count, generator_at(config.seed, number))
        gradient.flat.zero_()
        total = 0.0
        for part in tiles:
            rows = base.rows(part.start, part.stop)
            step = steps[len(rows.face)]
            outputs_now = step.evaluate(parameters, rows.batch)
            loss, into_outputs = loss_function(outputs_now, targets[:, part])
            share = len(rows.face) / count
            total += share * loss
            step.backward(parameters, rows.batch, into_outputs.mul_(share))
        if not total < float("inf"):
            raise FitError(f"the loss of the field is not finite at step {number}; lower the learning rate")
        if codes is not None:
            gradient.views["latent"].zero_()
        optimizer.step(gradient, rate_factor(config, number))
        if number >= first_kept:
            mean.lerp_(parameters.flat, 1 / (number - first_kept + 1))
    parameters.flat.copy_(mean)
    return Learned(parameters, shift.to(device), scale.to(device))


def _one_field(samples: FieldSamples) -> FieldSamples:
    """All columns as outputs of one run of the network."""
    return replace(samples, targets=samples.targets.flatten(1)[:, None])


def _standard(targets: Float[Tensor, "n k o"], kind: str) -> tuple[Float[Tensor, " o"], Float[Tensor, " o"]]:
    """Mean and standard deviation of each output, over all fields that share it."""
    count = targets.shape[2]
    if kind != "continuous":
        return torch.zeros(count), torch.ones(count)
    flat = targets.double().flatten(0, 1)
    deviation = flat.std(0, correction=0)
    # Columns that hardly vary beside the others, or not at all, are not blown up.
    least = max(1e-3 * float(deviation.max()), 1e-30)
    return flat.mean(0).float(), torch.where(deviation > least, deviation, 1.0 if least == 1e-30 else least).float()


def evaluate(parameters: Parameters, base: BasePoints) -> Float[Tensor, "k n o"]:
    """Outputs for each latent code: the readable reference of `FieldStep.evaluate`. Differentiable."""
    shape, batch = parameters.shape, base.batch
    features = interpolate(parameters.features, batch.corners, batch.barycentric)
    seen = torch.cat([encode(batch.positions, shape.encoding), features], 1)
    codes = parameters.views["latent"] if shape.latent[0] else seen.new_zeros(1, 0)
    inputs = torch.cat([seen.expand(len(codes), -1, -1), codes[:, None].expand(-1, len(seen), -1)], 2)
    return apply_network(parameters.layers("forward"), inputs)


def rounded_block(
    learned: Learned, geometry: BaseGeometry, samples: FieldSamples, config: FieldConfig, name: str
) -> FieldBlock:
    """The field block: features in canonical form, everything on the coarsest grids within the budget.

    `learned` is changed: it gives the values themselves from then on, not yet rounded.
    """
    parameters, loss_function = learned.parameters, loss_of(config)
    generator = generator_at(config.seed, 2**40)
    base, targets = samples.batch(geometry, min(_MEASURED, len(samples)), generator)
    probes, _ = samples.batch(geometry, min(_PROBED, len(samples)), generator)
    if not config.latent:
        targets = targets.permute(1, 0, 2).flatten(1)[None]
    targets = (targets - learned.shift) / learned.scale
    if config.feature_dim:
        decorrelate(parameters, _feature_sensitivity(parameters, probes))
    learned.standard.to_values(parameters)
    exact = evaluate(parameters, probes) / learned.scale

    def loss(candidate: Parameters) -> float:
        outputs = (evaluate(candidate, base) - learned.shift) / learned.scale
        return loss_function(outputs, targets)[0]

    def change(candidate: Parameters) -> Float[Tensor, "n o"]:
        difference = evaluate(candidate, probes) / learned.scale - exact
        return difference.transpose(0, 1).flatten(1)

    names = [key for key, view in parameters.views.items() if view.numel()]
    squared = loss_function is squared_error
    allowed = max(loss(parameters), _LEAST_LOSS[config.kind]) * (1 + config.rounding) ** (2 if squared else 1)
    sensitivity = sensitivities(parameters, names, change)
    grids = coarsest(parameters, sensitivity, lambda now, _: loss(now) <= allowed)
    if config.size and coded_size(parameters, grids) > config.size:
        with one_thread():
            grids = fit_to_size(parameters, learned.standard, sensitivity, geometry, _one_field(samples), config)
    layers = range(config.hidden_layers + 1)
    return FieldBlock(
        name=name,
        kind=config.kind,
        domain="base",
        encoding=parameters.shape.encoding,
        features=stored(parameters, "features", grids.get("features", 1.0)),
        weights=tuple(stored(parameters, f"forward.weight.{i}", grids[f"forward.weight.{i}"]) for i in layers),
        biases=tuple(stored(parameters, f"forward.bias.{i}", grids[f"forward.bias.{i}"]) for i in layers),
        activation="relu",
        residual=False,
        latent=stored(parameters, "latent", grids["latent"]) if config.latent else None,
    )


def _feature_sensitivity(parameters: Parameters, base: BasePoints) -> Float[Tensor, "d d"]:
    """Mean over base points, fields and outputs of the squared derivative by the features."""
    shape, batch = parameters.shape, base.batch
    features = interpolate(parameters.features, batch.corners, batch.barycentric)
    position = encode(batch.positions, shape.encoding)
    codes = parameters.views["latent"] if shape.latent[0] else position.new_zeros(1, 0)
    total = torch.zeros(shape.feature_dim, shape.feature_dim, dtype=torch.float64)
    for code in codes:
        live = features.clone().requires_grad_()
        inputs = torch.cat([position, live, code.expand(len(position), -1)], 1)
        answer = apply_network(parameters.layers("forward"), inputs)
        for output in range(shape.outputs):
            (row,) = torch.autograd.grad(answer[:, output].sum(), live, retain_graph=True)
            total += row.double().mT @ row.double()
    return total / len(features)


def field_error(asset: Asset, name: str, samples: FieldSamples) -> dict[str, float]:
    """Error of the stored field as a client decodes it, on the samples that it was learned from.

    For a continuous field, the rms of the error, the same over the rms of the values, and the mean of the absolute
    error; else the share of wrong answers, and for a binary one the least intersection over union of all columns.
    """
    block = asset.content.fields[name]
    found = asset.evaluate(samples.faces.numpy(), samples.barycentric.numpy().astype("float64"), name)
    outputs, true = torch.from_numpy(found).double(), samples.targets.flatten(1).double()
    if block.kind == "continuous":
        rms = float((outputs - true).square().mean().sqrt())
        size = float(true.square().mean().sqrt())
        return {"rms": rms, "relative": rms / size if size else rms, "mean": float((outputs - true).abs().mean())}
    if block.kind == "categorical":
        return {"wrong": float((outputs.argmax(1) != true.argmax(1)).double().mean())}
    inside, wanted = outputs > 0, true > 0.5
    union = (inside | wanted).double().sum(0)
    overlap = torch.where(union > 0, (inside & wanted).double().sum(0) / union.clamp_min(1), 1.0)
    return {"wrong": float((inside != wanted).double().mean()), "least_overlap": float(overlap.min())}
