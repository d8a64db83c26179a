"""Options of rendering plates: everything that `lensfit apply` accepts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from lensfit.coords import Window
from lensfit.plate.camera.sources import CameraOptions, StateOverrides
from lensfit.plate.plate_depth import DepthOptions
from lensfit.rendering.filters import Filter, filter_for
from lensfit.rendering.render_stages import DEFAULT_TOLERANCE, Switches

Output = Literal[
    "result", "circle-of-confusion", "aberration-dots", "filter", "undistorted"
]


@dataclass(frozen=True)
class ApplyOptions:
    """How plates are rendered.

    Attributes
    ----------
    overrides : Camera state that counts in place of the headers.
    camera : Sidecars, cameras and settings that know more of it.
    switches : Effects of the lens that are wanted.
    pixel_aspect : Width of a pixel over its height as displayed, in place of the
        header's ``pixelAspectRatio``.
    keep_overscan : Write the plate's data window rather than the display window.
    layers : Layers to render; every colour layer if None ("" is the unnamed one).
    stmap : A redistort map to use in place of the lens' own distortion.
    tolerance : Accepted error of the picture, display-referred.
    method : Interpolating filter; chosen by the tolerance if None.
    overwrite : Render every finished frame again, whatever it was made of.
    keep : Refuse to replace a finished frame that was made otherwise than it would be
        made now; otherwise it is rendered again.
    again : Render a plate that carries a lens already.
    depth : What the user states about the depth channel.
    edge_mask : Objects of the Cryptomatte that are cut out of the plate and blurred as
        layers of their own (see `plate.cut_out`).
    edge_matte : A channel with their coverage, in place of their names.
    knobs : Knobs that the user set, by name (see `lensfit.preset.knobs`).
    output : The result, a picture that explains it (see `frame.explaining_picture`), or
        the inverse: a photographed plate made straight (see `frame.straight_plate`), of
        which `switches` say what else is taken off.
    scale_to_sensor : Put the look on focal lengths and sensors that it was not measured
        at (see `preset.scaled_look`).
    straight_overscan_percent : Window of a straight plate, in total; all that the
        photograph fills if None.
    """

    overrides: StateOverrides = field(default_factory=StateOverrides)
    camera: CameraOptions = field(default_factory=CameraOptions)
    switches: Switches = field(default_factory=Switches)
    pixel_aspect: float | None = None
    keep_overscan: bool = False
    layers: Sequence[str] | None = None
    stmap: Path | None = None
    tolerance: float = DEFAULT_TOLERANCE
    method: Filter | None = None
    overwrite: bool = False
    keep: bool = False
    again: bool = False
    depth: DepthOptions = field(default_factory=DepthOptions)
    edge_mask: Sequence[str] = ()
    edge_matte: str | None = None
    knobs: Mapping[str, object] = field(default_factory=dict)
    output: Output = "result"
    scale_to_sensor: bool = False
    straight_overscan_percent: float | None = None

    @property
    def filter(self) -> Filter:
        """The interpolating filter."""
        return self.method or filter_for(self.tolerance)

    def written(self, data_window: Window, display_window: Window) -> Window:
        """The window of a plate that is written."""
        return data_window if self.keep_overscan else display_window
