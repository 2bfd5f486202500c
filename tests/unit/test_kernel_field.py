"""The field kernel against numpy in float64 and against the same network in torch."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch
from jaxtyping import Float, Int
from numpy import ndarray as Array

from ndf_core.kernels.field import FieldArrays, evaluate_field, evaluate_space_field
from ndf_core.kernels.reference import field as reference

BOX_TOLERANCE = 3e-6
"""1e-6 of the longest side, which is 3 in the box frame."""


def field(
    levels: int, feature_dim: int, hidden: tuple[int, ...], *, vertices: int = 50, outputs: int = 3, **options: object
) -> FieldArrays:
    """Random weights of the size that Kaiming initialisation gives."""
    rng = np.random.default_rng(levels + 10 * feature_dim)
    include = bool(options.get("include_position", True))
    widths = [3 * include + 6 * levels + feature_dim, *hidden, outputs]
    parts = []
    for inputs, rows in pairwise(widths):
        parts += [rng.normal(size=rows * inputs) * np.sqrt(2 / inputs), rng.normal(size=rows) * 0.1]
    return FieldArrays(
        base_frequency=float(options.get("base_frequency", np.pi / 3)),
        levels=levels,
        include_position=include,
        features=rng.normal(size=(vertices, feature_dim)).astype(np.float32),
        widths=np.array(widths, np.int32),
        parameters=np.concatenate(parts).astype(np.float32),
        residual=outputs == 3,
    )


def queries(count: int, vertices: int = 50) -> tuple[Array, Array, Array, Array]:
    """Faces, weights, positions, base faces."""
    rng = np.random.default_rng(count)
    base_faces = rng.integers(0, vertices, size=(30, 3)).astype(np.int32)
    return (
        rng.integers(0, 30, size=count).astype(np.int32),
        rng.dirichlet((1.0, 1.0, 1.0), size=count),
        rng.uniform(-1.5, 1.5, size=(vertices, 3)),
        base_faces,
    )


CASES = [
    field(8, 16, (64, 64)),
    field(8, 0, (64, 64)),
    field(8, 16, (64, 64), base_frequency=np.pi),
    field(0, 5, (7,)),
    field(3, 2, (13, 9, 21), outputs=5),
    field(2, 1, (), include_position=False),
    field(6, 3, (128,), outputs=1),
]


@pytest.mark.parametrize("instructions", [0, 1, 2])
@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case.widths.tolist()))
@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 1000])
def test_equal_to_reference(
    case: FieldArrays, count: int, instructions: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ndf_core.kernels.field.INSTRUCTIONS", instructions)
    arguments = queries(count)
    expected = reference.evaluate_field(case, *arguments)
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(evaluate_field(case, *arguments), expected, rtol=0, atol=1e-6 * scale)


@pytest.mark.parametrize("case", [CASES[1]], ids=["inverse"])
def test_space_field_is_the_same_network(case: FieldArrays) -> None:
    points = np.random.default_rng(0).uniform(-1.6, 1.6, size=(500, 3))
    expected = reference.evaluate_space_field(case, points)
    np.testing.assert_allclose(evaluate_space_field(case, points), expected, rtol=0, atol=3e-6)


def torch_field(case: FieldArrays, faces: Array, weights: Array, vertices: Array, base_faces: Array) -> torch.Tensor:
    """The paper's network written with torch's own layers, float32."""
    corners = torch.from_numpy(base_faces[faces].astype(np.int64))
    barycentric = torch.from_numpy(weights).float()[..., None]
    x = (barycentric * torch.from_numpy(vertices).float()[corners]).sum(1)
    features = (barycentric * torch.from_numpy(case.features)[corners]).sum(1)
    angles = x[:, None, :] * (case.base_frequency * 2.0 ** torch.arange(case.levels))[:, None].float()
    encoded = torch.stack([angles.sin(), angles.cos()], dim=2).reshape(len(x), -1)
    layers: list[torch.nn.Module] = []
    parameters = torch.from_numpy(case.parameters)
    for inputs, outputs in pairwise(case.widths.tolist()):
        layer = torch.nn.Linear(inputs, outputs)
        size = inputs * outputs
        with torch.no_grad():
            layer.weight.copy_(parameters[:size].reshape(outputs, inputs))
            layer.bias.copy_(parameters[size : size + outputs])
        parameters = parameters[size + outputs :]
        layers += [layer, torch.nn.ReLU()]
    with torch.no_grad():
        return x + torch.nn.Sequential(*layers[:-1])(torch.cat([x, encoded, features], dim=1))


def test_equal_to_torch() -> None:
    """A trained field's displacements are smooth: damp the levels as training does, and scale the output down."""
    case = field(8, 16, (64, 64))
    parameters = case.parameters.copy()
    first = parameters[: 64 * 67].reshape(64, 67)
    for level in range(8):
        first[:, 3 + 6 * level : 9 + 6 * level] *= 0.5**level
    last = 64 * 68 + 64 * 65
    parameters[last:] *= 0.2
    case = case._replace(parameters=parameters)
    arguments = queries(4000)
    ours, theirs = evaluate_field(case, *arguments), torch_field(case, *arguments).numpy()
    assert np.abs(theirs - reference.evaluate_field(case, *arguments)).max() > 0  # not the same arithmetic
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=BOX_TOLERANCE)


def test_rows_are_independent_of_batches_and_threads() -> None:
    case, (faces, weights, vertices, base_faces) = CASES[0], queries(10_000)
    whole = evaluate_field(case, faces, weights, vertices, base_faces)
    for threads in (2, 3):
        np.testing.assert_array_equal(evaluate_field(case, faces, weights, vertices, base_faces, threads), whole)
    order = np.random.default_rng(0).permutation(len(faces))
    shuffled = evaluate_field(case, faces[order], weights[order], vertices, base_faces)
    np.testing.assert_array_equal(shuffled, whole[order])
    np.testing.assert_array_equal(evaluate_field(case, faces[7:9], weights[7:9], vertices, base_faces), whole[7:9])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda case, q: (case, q[0] + 100, *q[1:]), "faces: index 1.. is outside"),
        (lambda case, q: (case, q[0] - 100, *q[1:]), "faces: index -.* is outside"),
        (lambda case, q: (case, *q[:3], q[3] + 50), "base_faces: index"),
        (lambda case, q: (case, q[0], q[1][:-1], *q[2:]), "a row per face"),
        (lambda case, q: (case, *q[:2], q[2][:-1], q[3]), "a row per vertex"),
        (lambda case, q: (case._replace(parameters=case.parameters[:-1]), *q), "need .* parameters"),
        (lambda case, q: (case._replace(levels=7), *q), "encoding and features give"),
        (lambda case, q: (case._replace(widths=case.widths * 0), *q), "widths must be"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change: object, message: str) -> None:
    arguments: tuple[Int[Array, " n"] | Float[Array, "n 3"] | FieldArrays, ...]
    arguments = change(CASES[0], queries(10))  # pyright: ignore[reportCallIssue]
    with pytest.raises((ValueError, IndexError), match=message):
        evaluate_field(*arguments)  # pyright: ignore[reportArgumentType]
