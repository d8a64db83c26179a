"""The basis functions in which images of a dot are drawn, and their light on cells.

An image is a sum over rays of a product: the amplitude of a ray along rows times its
amplitude along columns (`psf.spot.Profile`). Small dot apertures are drawn in the
cells themselves, where a ray's amplitude is its share of the cell; broad dots in waves
(`waves`), each of which a disc multiplies by a number of its own. The patch is measured
right and down from its corner, in sensor mm.
"""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from lensfit.psf.spot import Profile, Spot, profile_of


class Basis(eqx.Module):
    """Functions along one axis, the same along the other, of which images are sums."""

    corner_mm: eqx.AbstractVar[Float[Array, "2"]]
    cell_mm: eqx.AbstractVar[Float[Array, "2"]]
    cells: eqx.AbstractVar[int]

    @property
    def centre_mm(self) -> Float[Array, "2"]:
        """Of the patch, right and down."""
        return self.corner_mm + self.cell_mm * self.cells / 2

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """How many functions there are along an axis."""

    @abc.abstractmethod
    def profile(self, spot: Spot, variance_mm2: Float[Array, "*axes"]) -> Profile:
        """Amplitudes of rays that are Gaussians of this variance plus their own
        width."""

    @abc.abstractmethod
    def cell_light(
        self, amplitudes: Float[Array, "*images size size"]
    ) -> Float[Array, "*images cells cells"]:
        """Light on the cells, from amplitudes of the functions."""

    @abc.abstractmethod
    def cell_light_transpose(
        self, cotangent: Float[Array, "cells cells"]
    ) -> Float[Array, "size size"]:
        """The derivative by the amplitudes, from that by the light of cells."""


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
        """The number of cells."""
        return self.cells

    def profile(self, spot: Spot, variance_mm2: Float[Array, "*axes"]) -> Profile:
        """`psf.spot.profile_of`."""
        return profile_of(spot, self.corner_mm, self.cell_mm, self.cells, variance_mm2)

    def cell_light(
        self, amplitudes: Float[Array, "*images size size"]
    ) -> Float[Array, "*images cells cells"]:
        """The same."""
        return amplitudes

    def cell_light_transpose(
        self, cotangent: Float[Array, "cells cells"]
    ) -> Float[Array, "size size"]:
        """The same."""
        return cotangent
