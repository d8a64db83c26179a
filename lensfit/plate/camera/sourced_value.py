"""A value of one quantity and its source."""

from typing import NamedTuple


class SourcedValue(NamedTuple):
    """A value and its source.

    Attributes
    ----------
    value : In the unit of its quantity.
    source : The option, file or header entry, for people.
    from_pupil : A focus distance from the pinhole of the CG camera, which is the
        entrance pupil, rather than from the sensor.
    rank : Place among the sources; less counts more.
    of_pinhole : A focal length of the pinhole with the picture's angle of view, rather
        than as on the barrel or the zoom ring.
    """

    value: float | str
    source: str
    from_pupil: bool = False
    rank: int = 0
    of_pinhole: bool = False
