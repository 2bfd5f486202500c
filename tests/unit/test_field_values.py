"""Values that cannot be learned are refused with one clear error each; the others become numbers."""

from __future__ import annotations

import numpy as np
import pytest
from small_assets import icosphere

from ndf_core.errors import InputError
from ndf_core.fitting.field_values import FieldValues, check_values

VERTICES, FACES = icosphere(1)
COUNT = len(VERTICES)
RAMP = np.arange(COUNT, dtype=float)


def of(values: object, faces: object = FACES, points: object = VERTICES) -> FieldValues:
    return FieldValues(np.asarray(points), np.asarray(values), None if faces is None else np.asarray(faces))


def changed(row: int, value: float) -> np.ndarray:
    values = RAMP.copy()
    values[row] = value
    return values


@pytest.mark.parametrize(
    ("given", "kind", "message"),
    [
        (of(changed(7, np.nan)), "continuous", "1 of 42 rows are not finite, the first is row 7"),
        (of(changed(7, np.inf)), "continuous", "not finite"),
        (of(RAMP[:-1]), "continuous", r"got shape \(41,\), need one row for each of 42 points or 80 faces"),
        (of(RAMP[:-1], None), "continuous", "need one row for each of 42 points$"),
        (of(np.zeros((COUNT, 0))), "continuous", "0 columns"),
        (of(RAMP * 1e300), "continuous", r"up to 4.1e\+301; at most 1e\+15"),
        (of(["a"] * COUNT), "continuous", "needs numbers"),
        (of(RAMP), "binary", "truth values, or 0 and 1 alone"),
        (of(np.ones((COUNT, 2))), "binary", "column 0 is 1 everywhere; the other class never occurs"),
        (of(RAMP + 0.5), "categorical", "whole numbers from 0 on"),
        (of(RAMP - 1), "categorical", "whole numbers from 0 on"),
        (of(changed(3, np.nan)), "categorical", "whole numbers from 0 on"),
        (of(np.where(RAMP < 5, 0, 2)), "categorical", "class '1' never occurs"),
        (of(np.zeros(COUNT)), "categorical", "one class alone"),
        (of(np.zeros((COUNT, 2))), "categorical", "one class per row"),
        (of(RAMP + 1e6), "categorical", "fewer than 4096"),
        (of(RAMP, FACES + 1), "continuous", "names a vertex that does not exist"),
        (of(RAMP, FACES.astype(float)), "continuous", "faces .* of whole numbers"),
        (of(RAMP, None, VERTICES[:, :2]), "continuous", "need points"),
        (of(RAMP, None, np.where(VERTICES > 0.5, np.nan, VERTICES)), "continuous", "points are not finite"),
    ],
)
def test_what_is_wrong_is_said(given: FieldValues, kind: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_values(given, kind)


def test_labels_decide_which_classes_there_are() -> None:
    words = np.array(["stone", "wood"])[(RAMP > 3).astype(int)]
    assert check_values(of(words), "categorical").labels == ("stone", "wood")
    assert check_values(of(words), "categorical", ["wood", "stone"]).targets[0].tolist() == [[0, 1]]
    with pytest.raises(InputError, match="class 'gold' never occurs"):
        check_values(of(words), "categorical", ["wood", "stone", "gold"])
    with pytest.raises(InputError, match="class 'stone' is not among the labels"):
        check_values(of(words), "categorical", ["wood", "gold"])
    with pytest.raises(InputError, match="class 1 has no label"):
        check_values(of((RAMP > 3).astype(int)), "categorical", ["wood"])


def test_on_triangles_values_are_linear_or_those_of_the_closest_corner() -> None:
    face, weights = np.array([4]), np.array([[0.2, 0.5, 0.3]])
    corners = RAMP[FACES[4]]
    checked = check_values(of(RAMP), "continuous")
    assert checked.at(face, weights, continuous=True).item() == pytest.approx(weights[0] @ corners)
    assert checked.at(face, weights, continuous=False).item() == corners[1]
    by_face = check_values(of(np.arange(len(FACES))), "continuous")
    assert by_face.at(face, weights, continuous=True).item() == 4
