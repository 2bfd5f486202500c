"""What must hold between the parts of an asset; asked before writing and after reading."""

from __future__ import annotations

import numpy as np

from ndf_core.asset import limits
from ndf_core.asset.content import AssetContent, FieldBlock, QuantisedArray, Stored, stored_shape
from ndf_core.errors import AssetError

_OUTPUTS = {"displacement": 3, "inverse": 3}
_DOMAINS = {"displacement": "base", "inverse": "space"}


def check_content(content: AssetContent) -> None:
    """Refuse content whose parts do not fit each other or are not finite.

    Raises:
        AssetError: names the part.
    """
    _check_base_mesh(content)
    _check_placement(content)
    if not (np.isfinite(content.center).all() and content.center.shape == (3,)):
        raise AssetError("its center is not three finite numbers")
    if not (np.isfinite(content.scale) and content.scale > 0):
        raise AssetError("its scale is not a positive number")
    for name, block in content.fields.items():
        if block.name != name:
            raise AssetError(f"its field {name!r} calls itself {block.name!r}")
        _check_block(block, len(content.vertices))
    displacement = content.fields.get("displacement")
    if displacement is None or displacement.kind != "displacement":
        raise AssetError("it has no displacement field")


def _check_base_mesh(content: AssetContent) -> None:
    vertices, faces = content.vertices, content.faces
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not 3 <= len(vertices) <= limits.VERTICES:
        raise AssetError(f"its base mesh has vertices of shape {vertices.shape}; 3 to {limits.VERTICES} are allowed")
    if faces.ndim != 2 or faces.shape[1] != 3 or not 1 <= len(faces) <= limits.FACES:
        raise AssetError(f"its base mesh has faces of shape {faces.shape}; 1 to {limits.FACES} are allowed")
    if not np.isfinite(vertices).all():
        raise AssetError("its base mesh has a vertex that is not finite")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise AssetError("its base mesh has a face that names a vertex that does not exist")


def _check_placement(content: AssetContent) -> None:
    placement = content.placement
    if placement is None:
        return
    if placement.codes.shape != content.vertices.shape:
        raise AssetError(f"its placement has shape {placement.codes.shape} for {len(content.vertices)} vertices")
    _check_numbers(QuantisedArray(placement.codes, placement.step), "its placement")
    reach = float(np.abs(placement.positions).max())
    if not 0 < reach <= limits.REACH:
        raise AssetError(f"its base mesh is placed up to {reach:g} from the middle of the box frame")


def _check_block(block: FieldBlock, vertices: int) -> None:
    where = f"its field {block.name!r}"
    if not block.weights or len(block.weights) != len(block.biases):
        raise AssetError(f"{where} has {len(block.weights)} weight and {len(block.biases)} bias arrays")
    if block.activation != "relu":
        raise AssetError(f"{where} has the activation {block.activation!r}; this program knows relu")
    features = stored_shape(block.features)
    if len(features) != 2 or features[0] != vertices or features[1] > limits.FEATURE_DIM:
        raise AssetError(f"{where} has features of shape {features} for {vertices} vertices")
    if block.domain == "space" and features[1]:
        raise AssetError(f"{where} is over space and has features all the same")
    if block.domain != _DOMAINS.get(block.kind, block.domain):
        raise AssetError(f"{where} is of kind {block.kind} and cannot be over {block.domain!r}")
    if block.encoding.base_frequency * 2.0**block.encoding.levels > limits.FREQUENCY:
        raise AssetError(f"{where} has an encoding of too high a frequency")
    width = block.encoding.width + features[1]
    if block.latent is not None:
        latent = stored_shape(block.latent)
        if len(latent) != 2 or not 1 <= latent[0] <= limits.WIDTH or not 1 <= latent[1] <= limits.FEATURE_DIM:
            raise AssetError(f"{where} has latent codes of shape {latent}")
        if block.kind in _OUTPUTS or block.residual:
            raise AssetError(f"{where} is of kind {block.kind} and cannot have latent codes")
        _check_numbers(block.latent, where)
        width += latent[1]
    if not 1 <= width <= limits.WIDTH:
        raise AssetError(f"{where} has {width} inputs, 1 to {limits.WIDTH} are allowed")
    for i, (weights, biases) in enumerate(zip(block.weights, block.biases, strict=True)):
        outputs = stored_shape(biases)[0] if len(stored_shape(biases)) == 1 else -1
        if not 1 <= outputs <= limits.WIDTH or stored_shape(weights) != (outputs, width):
            raise AssetError(
                f"{where} has weights {stored_shape(weights)} and biases {stored_shape(biases)} for {width} inputs"
            )
        width = outputs
        for array in (weights, biases):
            _check_numbers(array, f"{where}, layer {i},")
    _check_numbers(block.features, where)
    needed = 3 if block.residual else _OUTPUTS.get(block.kind, width)
    if width != needed:
        raise AssetError(f"{where} has {width} outputs, {needed} are needed")
    if block.columns > limits.WIDTH:
        raise AssetError(f"{where} has {block.columns} columns, {limits.WIDTH} are allowed")
    if block.labels and len(block.labels) != block.columns:
        raise AssetError(f"{where} has {len(block.labels)} labels for {block.columns} columns")


def _check_numbers(array: Stored, where: str) -> None:
    if isinstance(array, QuantisedArray):
        low, high = limits.STEP
        if array.codes.dtype != np.int16 or not low <= array.step <= high:
            raise AssetError(f"{where} has codes of type {array.codes.dtype} with a step of {array.step:g}")
    elif str(array.dtype) not in ("float32", "float16") or not np.isfinite(array).all():
        raise AssetError(f"{where} has numbers of type {array.dtype} that are not all finite float32 or float16")
