"""From marks to a lens: `lensfit.fit(takes)`, and the stages it is made of."""

from lensfit._callable import make_callable

make_callable(__name__, "lensfit.fit.lens_states", "fit")
