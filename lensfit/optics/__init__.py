"""The lens model: no images, no optimiser."""
