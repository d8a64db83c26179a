"""Dealing marks into chunks and back: nothing lost, nothing twice, fair samples."""

import numpy as np
import pytest

from lensfit.fitting.view_stack import CHUNK_SIZE, chunking_of


def _present(*counts: int) -> np.ndarray:
    return np.arange(max(counts)) < np.array(counts)[:, None]


@pytest.mark.parametrize("counts", [(5,), (64, 65), (300, 1, 129), (0, 40)])
def test_every_mark_lies_in_one_place_of_its_own_view(counts):
    present = _present(*counts)
    deal = chunking_of(present)
    flat = deal.index[deal.real]
    assert sorted(flat) == np.flatnonzero(present.ravel()).tolist()
    assert (deal.index // present.shape[1] == deal.view[:, None])[: deal.count].all()
    assert not deal.real[deal.count :].any()


def test_cut_and_joined_are_inverses():
    present = _present(130, 20)
    deal = chunking_of(present)
    values = np.random.default_rng(0).normal(size=(*present.shape, 2))
    back = deal.from_chunks(deal.in_chunks(values), values)
    np.testing.assert_array_equal(back, np.where(present[..., None], values, 0.0))


def test_numbers_of_chunks_are_few():
    """Shoots of 600 to 1000 marks share their programs."""
    shapes = {chunking_of(_present(n)).index.shape for n in range(600, 1000, 25)}
    assert len(shapes) == 1


def test_a_sample_holds_marks_of_every_view_and_no_more_than_there_are():
    deal = chunking_of(_present(1000, 1000, 70))
    chunks = deal.sample(2 * CHUNK_SIZE)
    assert chunks == 6
    assert set(deal.view[:chunks]) == {0, 1, 2}
    assert deal.sample(10**6) == deal.count


def test_a_sample_is_scattered_over_the_marks():
    """The first chunk of a thousand marks in order spans nearly all of the order."""
    deal = chunking_of(_present(1000))
    first = deal.index[0]
    assert first.min() < 100
    assert first.max() > 900
