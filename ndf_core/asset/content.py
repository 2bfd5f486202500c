"""What an asset holds, as plain data: the base mesh, field blocks, the transform and the provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy import ndarray as Array

from ndf_core.annotations import Float, Int
from ndf_core.asset.placement import Placement


@dataclass(frozen=True)
class QuantisedArray:
    """Real numbers on a uniform grid: ``values = codes * step``. A step of 0 would mean nothing and is refused."""

    codes: Int[Array, "..."]
    """int16."""
    step: float

    @property
    def values(self) -> Float[Array, "..."]:
        """float32 array of the same shape."""
        return self.codes.astype(np.float32) * np.float32(self.step)


Stored = QuantisedArray | np.ndarray
"""An array as the file keeps it: quantised, or plain float32/float16."""


def stored_shape(array: Stored) -> tuple[int, ...]:
    """Its shape."""
    return array.codes.shape if isinstance(array, QuantisedArray) else array.shape


def values_of(array: Stored) -> Float[Array, "..."]:
    """The float32 numbers that a stored array stands for."""
    return array.values if isinstance(array, QuantisedArray) else array.astype(np.float32)


@dataclass(frozen=True)
class Encoding:
    """Periodic encoding of a position x in the box frame (Sec. 3.3): [x], then sin and cos of 2^k base_frequency x.

    Order of the columns: x (3) if `include_position`; then for k = 0 .. levels-1: sin of the three coordinates,
    cos of the three coordinates.
    """

    base_frequency: float
    levels: int
    include_position: bool

    @property
    def width(self) -> int:
        return 3 * self.include_position + 6 * self.levels


@dataclass(frozen=True)
class FieldBlock:
    """One network over the base mesh (or over space): input [encoding(x), features(x), code], ReLU between layers.

    The features at a base point are the barycentric mean of its face's three vertex features. `residual` adds x to
    the output (displacement and inverse). `domain` says what x is: "base" a point of the base mesh, "space" any
    point of the box frame (then there are no features: shape (v, 0)).

    A block may hold several fields: as the outputs of the network, or, with `latent`, by running the network once for
    each code (Sec. 3.5, App. B.5). Outputs mean the value itself where the kind is "continuous", log-odds where it is
    "binary", and one score per class where it is "categorical".
    """

    name: str
    kind: Literal["displacement", "inverse", "continuous", "binary", "categorical"]
    domain: Literal["base", "space"]
    encoding: Encoding
    features: Stored
    """(v, d), in the order of the base mesh's vertices; d may be 0."""
    weights: tuple[Stored, ...]
    """Layer i: (out_i, in_i); in_0 = encoding.width + d + c."""
    biases: tuple[Stored, ...]
    """Layer i: (out_i,)."""
    activation: Literal["relu"]
    residual: bool
    latent: Stored | None = None
    """(k, c): the codes of k fields, numbers that the network sees beside the features; None where there is none."""
    labels: tuple[str, ...] = ()
    """Names of the columns of the answer, or of the classes; none, or one for each."""

    @property
    def feature_dim(self) -> int:
        return stored_shape(self.features)[1]

    @property
    def latent_shape(self) -> tuple[int, int]:
        """(k, c), or (0, 0) without latent codes."""
        return (0, 0) if self.latent is None else (stored_shape(self.latent)[0], stored_shape(self.latent)[1])

    @property
    def columns(self) -> int:
        """Columns of the answer: outputs of the network, once for each latent code."""
        return stored_shape(self.biases[-1])[0] * max(1, self.latent_shape[0])


@dataclass(frozen=True)
class AssetContent:
    """Everything in an ``.ndf`` file."""

    vertices: Float[Array, "v 3"]
    """float64, box frame: exactly what the decoded base-mesh blob gives."""
    faces: Int[Array, "f 3"]
    """int32."""
    center: Float[Array, "3"]
    """float64: x_input = x_box * scale + center."""
    scale: float
    fields: Mapping[str, FieldBlock]
    """By name; "displacement" is always there, "inverse" may be."""
    provenance: Mapping[str, Any]
    """JSON-serialisable: versions, config, fingerprint, measured errors. No time, host or path."""
    base_mesh_blob: bytes
    """The Draco blob that `vertices` and `faces` were decoded from, so that writing is lossless."""
    placement: Placement | None = None
    """None where the base mesh was made for this surface."""

    @property
    def placed(self) -> Float[Array, "v 3"]:
        """float64, box frame: the vertices from which the displacement starts.

        Learned fields see `vertices` instead, which all assets over this base mesh have, and so can be copied.
        """
        return self.vertices if self.placement is None else self.placement.positions
