"""What the rays of a dot are drawn in, and how the cells of its patch see that.

An image is a sum over rays of a product: what a ray is along rows times what it is
along columns (`kernel.pixels.Profile`). Small holes are drawn in the cells themselves,
of which a ray has its share; broad dots in waves (`waves`), which a disc passes on one
by one. The patch is right and down from its corner, in sensor mm.
"""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from lensfit.kernel.pixels import Profile, profile_of
from lensfit.kernel.spot import Spot


class Basis(eqx.Module):
    """Functions along one axis, the same along the other, that images are made of."""

    corner_mm: eqx.AbstractVar[Float[Array, "2"]]
    cell_mm: eqx.AbstractVar[Float[Array, "2"]]
    cells: eqx.AbstractVar[int]

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """How many functions there are along an axis."""

    @abc.abstractmethod
    def profile(self, spot: Spot, variance_mm2: Float[Array, "*axes"]) -> Profile:
        """Of rays that are Gaussians of this variance, besides their own width."""

    @abc.abstractmethod
    def seen(
        self, drawn: Float[Array, "*images size size"]
    ) -> Float[Array, "*images cells cells"]:
        """Light of the cells of images that were drawn."""

    @abc.abstractmethod
    def traced_back(
        self, pull: Float[Array, "cells cells"]
    ) -> Float[Array, "size size"]:
        """A derivative by the light of cells as one by what was drawn."""


class Cells(Basis):
    """The cells of the patch.

    Attributes
    ----------
    corner_mm, cell_mm, cells : Of the patch; cells along a side.
    """

    corner_mm: Float[Array, "2"]
    cell_mm: Float[Array, "2"]
    cells: int = eqx.field(static=True)

    @property
    def size(self) -> int:
        """As many as cells."""
        return self.cells

    def profile(self, spot: Spot, variance_mm2: Float[Array, "*axes"]) -> Profile:
        """`kernel.pixels.profile_of`."""
        return profile_of(spot, self.corner_mm, self.cell_mm, self.cells, variance_mm2)

    def seen(
        self, drawn: Float[Array, "*images size size"]
    ) -> Float[Array, "*images cells cells"]:
        """The same."""
        return drawn

    def traced_back(
        self, pull: Float[Array, "cells cells"]
    ) -> Float[Array, "size size"]:
        """The same."""
        return pull
