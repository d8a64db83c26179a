"""From marks to a lens: `lensfit.fit(takes)`, and the stages it is made of.

Whoever enters this room is about to fit, which is quickest with all cores.
"""

from lensfit._callable import make_callable
from lensfit._jax import count_cores

count_cores()
make_callable(__name__, "lensfit.fit.lens_states", "fit")
