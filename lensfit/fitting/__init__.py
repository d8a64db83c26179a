"""From detections to a lens: `lensfit.fit(views)` and the stages it is made of.

Whoever enters this room is about to fit, which is quickest with all cores.
"""

from lensfit._jax import count_cores

count_cores()
