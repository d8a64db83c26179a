"""How many dots an effort fits."""

import pytest

from lensfit.fitting.wavefront.effort import Effort


@pytest.mark.parametrize(("takes", "each"), [(1, 140), (2, 70), (7, 20), (30, 20)])
def test_few_takes_are_fitted_to_as_many_dots_as_the_usual_seven(takes, each):
    assert Effort.NORMAL.fine_dots(takes) == each
    assert Effort.BEST.coarse_dots(takes) == max(8, -(-56 // takes))
