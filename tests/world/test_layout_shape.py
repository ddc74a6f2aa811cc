"""A layout that says it is a rectangle is one: its file holds only the rectangle."""

import numpy as np
import pytest

from dore.errors import InputError
from dore.world.layout import Layout


@pytest.mark.parametrize("shape", [(1, 2), (5, 7), "ab", 3, (2.5, 1)])
def test_cells_that_form_another_rectangle_are_refused(shape: object) -> None:
    with pytest.raises(InputError, match=r"layout\.grid_shape"):
        Layout(((0.5, 0.0), (0.7, 0.0)), 0.1, shape)  # type: ignore[arg-type]


def test_counts_of_numpy_are_taken() -> None:
    layout = Layout(((0.5, 0.05), (0.5, -0.05)), 0.1, np.array([1, 2]))  # type: ignore[arg-type]
    assert Layout.from_dict(layout.to_dict()).coincides(layout)
    assert all(type(count) is int for count in layout.to_dict().values() if count in (1, 2))
