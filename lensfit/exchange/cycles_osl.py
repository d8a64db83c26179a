"""A camera shader for Cycles (Blender 4.5 and later): rays through a measured lens.

For each position on the sensor and each place in the stop the shader starts the ray
that the lens would have sent there. In the scene a ray is a straight line: where it
crosses the plane of the entrance pupil, and its direction. Both are sums of products of
Chebyshev's polynomials T_n of the position and of the place,

    sum_k  c_k  T_a(x / half width) T_b(y / half height) T_c(s_x) T_d(s_y),

kept where they show; each of red, green and blue has its own, with a linear change over
the wavelengths of its band. Places are drawn evenly from a disc about the stop; what
blades or rims stop carries no light. Positions are sensor millimetres, x right and y
down, places as in `lensfit.optics.stop_places`; Cycles' camera looks along z with y up,
and its origin is the entrance pupil on the axis.

Reference: Blender's manual, "Custom Camera" (Cycles, Open Shading Language): the shader
is given a position within the picture in 0 to 1 from its bottom left corner, and
answers with position, direction and throughput of the ray.
"""

from collections.abc import Iterator

import numpy as np

from lensfit.atomic import write_text_atomic
from lensfit.errors import ExchangeError
from lensfit.exchange.cycles_lens import (
    WAVELENGTHS,
    CyclesLens,
    LensOpening,
    Series,
)
from lensfit.exchange.export_request import (
    Exported,
    ExportRequest,
    Nearness,
    export_result,
    lens_description,
)
from lensfit.exchange.ray_series import fit_ray_series
from lensfit.lens import Lens


def cycles_osl_text(lens: CyclesLens, label: str) -> str:
    """The shader's source.

    Parameters
    ----------
    label : What it is, in lines.
    """
    comment = "".join(f"// {line}\n" for line in label.splitlines())
    field, place = _pairs(lens)
    half_x, half_y = lens.half_mm
    parts = [
        comment,
        _HEAD,
        _position(lens),
        _opening(lens.opening),
        "    if (!open)\n        return;\n",
        _products("on_frame", (f"x / {half_x!r}", f"y / {half_y!r}"), field),
        _products("in_stop", ("s[0]", "s[1]"), place),
        _rays(lens, field, place),
        _TAIL,
    ]
    return "".join(parts)


_HEAD = """\
shader lensfit_camera(
    float scene_unit_mm = 1000.0
        [[ string help = "Millimetres of a unit of the scene", float min = 0.001 ]],
    float overscan_percent = 0.0
        [[ string help = "Rendered beyond the frame in total, percent of its width" ]],
    output point position = 0.0,
    output vector direction = 0.0,
    output color throughput = 0.0,
    output vector dPdx = 0.0,
    output vector dPdy = 0.0,
    output vector dDdx = 0.0,
    output vector dDdy = 0.0)
{
"""
_TAIL = """\
    position = point(crossing[0], -crossing[1], 0.0) / scene_unit_mm;
    direction = normalize(vector(tangent[0], -tangent[1], 1.0));
    throughput = max(light * weight, 0.0) * band;
}
"""


def _every(lens: CyclesLens) -> Iterator[Series]:
    yield lens.weight
    for channel in lens.channels:
        yield from channel


def _pairs(lens: CyclesLens) -> tuple[np.ndarray, np.ndarray]:
    """Degrees that occur, of position and of place."""
    every = np.concatenate([one.degrees for one in _every(lens)])
    return np.unique(every[:, :2], axis=0), np.unique(every[:, 2:], axis=0)


def _position(lens: CyclesLens) -> str:
    """Position on the sensor, place in the stop, the wavelength."""
    count = len(lens.channels)
    strata = count * len(WAVELENGTHS)
    if count == 1:
        strata = 1
    slope = 1 / _principal_mm(lens)
    return f"""\
    vector resolution = 1.0;
    getattribute("cam:image_resolution", resolution);
    point raster = camera_shader_raster_position();
    float width = {lens.width_mm!r} * (1.0 + overscan_percent / 100.0);
    float x = (raster[0] - 0.5) * width;
    float y = (0.5 - raster[1]) * width * resolution[1] / resolution[0];

    // what filters textures: a pinhole's ray is near enough
    vector pinhole = normalize(vector(x * {slope:.9g}, -y * {slope:.9g}, 1.0));
    dDdx = Dx(pinhole);
    dDdy = Dy(pinhole);

    // one random number chooses the wavelength too
    vector dice = camera_shader_random_sample();
    int stratum = min(int(dice[0] * {strata}), {strata - 1});
    float reach = sqrt(dice[0] * {strata} - stratum);
    int channel = stratum / {len(WAVELENGTHS)};
    float wavelength = stratum % {len(WAVELENGTHS)} - 1;
    color band = color({count} * (channel == 0), {count} * (channel == 1), \
{count} * (channel == 2));
    if ({strata} == 1) {{
        wavelength = 0.0;
        band = 1.0;
    }}
    float s[2] = {{reach * cos(M_2PI * dice[1]), reach * sin(M_2PI * dice[1])}};
"""


def _products(name: str, along: tuple[str, str], pairs: np.ndarray) -> str:
    """A table of products of the polynomials of two numbers."""
    most = 1 + int(pairs.max(initial=1))
    text = f"    float {name}[{len(pairs)}];\n    {{\n"
    for axis, one in zip("xy", along, strict=True):
        text += f"""\
        float t{axis}[{most}];
        t{axis}[0] = 1.0;
        t{axis}[1] = {one};
        for (int n = 2; n < {most}; ++n)
            t{axis}[n] = 2.0 * t{axis}[1] * t{axis}[n - 1] - t{axis}[n - 2];
"""
    text += "".join(
        f"        {name}[{n}] = tx[{i}] * ty[{j}];\n"
        for n, (i, j) in enumerate(pairs.tolist())
    )
    return text + "    }\n"


def _principal_mm(lens: CyclesLens) -> float:
    """Of the pinhole that textures are filtered for: the slope on the axis."""
    series = lens.channels[len(lens.channels) // 2].x
    near = series.at(np.array([[1e-3, 0.0], [-1e-3, 0.0]]), np.zeros((2, 2)))[:, 0]
    slope = (near[0] - near[1]) / (2e-3 * lens.half_mm[0])
    return float(1 / slope) if slope > 0 else lens.width_mm


def _opening(opening: LensOpening) -> str:
    arcs, (x, y) = opening.arcs, opening.axis_mm
    d, k, reach = arcs.distance, arcs.curvature, arcs.reach
    b0, b1 = opening.stop_shift
    text = f"""\
    float hx = (x - {x:.9g}) / {opening.field_radius_mm:.9g};
    float hy = (y - {y:.9g}) / {opening.field_radius_mm:.9g};
    float h2 = hx * hx + hy * hy;
    float px = s[0] * {reach:.9g}, py = s[1] * {reach:.9g};
    int open = 1;
"""
    for azimuth in arcs.azimuth_rad:
        nx, ny = np.cos(azimuth), np.sin(azimuth)
        text += (
            f"    open = open && {k / 2:.9g} * (px * px + py * py) + {1 - k * d:.9g} * "
            f"({nx:.9g} * px + {ny:.9g} * py) <= {d - k * d * d / 2:.9g};\n"
        )
    radius = opening.stop_radius
    text += f"""\
    float shift = ({b0:.9g} + {b1:.9g} * h2) * {radius**2:.9g};
    float sx = hx * shift + {radius:.9g} * px, sy = hy * shift + {radius:.9g} * py;
"""
    for (a0, a1), (r0, r1) in zip(opening.rim_shift, opening.rim_radius, strict=True):
        rim = f"({a0:.9g} + {a1:.9g} * h2)"
        text += (
            f"    open = open && hypot(sx - hx * {rim}, sy - hy * {rim})"
            f" <= {r0:.9g} + {r1:.9g} * h2;\n"
        )
    return text


def _rays(lens: CyclesLens, field: np.ndarray, place: np.ndarray) -> str:
    text = """\
    float tangent[2] = {0.0, 0.0}, crossing[2] = {0.0, 0.0};
    float light = 0.0, weight = 0.0;
"""

    def add(series: Series, targets: tuple[str, ...]) -> str:
        return _sum(series, (field, place), targets)

    text += add(lens.weight, ("weight",))
    for number, channel in enumerate(lens.channels):
        text += f"    if (channel == {number} || {len(lens.channels)} == 1) {{\n"
        for axis, series in enumerate((channel.x, channel.y)):
            text += add(series, (f"tangent[{axis}]", f"crossing[{axis}]"))
        text += add(channel.brightness, ("light",)) + "    }\n"
    return text


def _sum(
    series: Series, pairs: tuple[np.ndarray, np.ndarray], targets: tuple[str, ...]
) -> str:
    """A loop over the terms; two columns a target where it changes with wavelength."""
    count, body = len(series.degrees), "    {\n"
    for name, all_pairs, own in zip(
        "ij", pairs, np.split(series.degrees, 2, 1), strict=True
    ):
        known = {pair: n for n, pair in enumerate(map(tuple, all_pairs.tolist()))}
        row = ", ".join(str(known[pair]) for pair in map(tuple, own.tolist()))
        body += f"        int {name}[{count}] = {{{row}}};\n"
    columns = series.values.shape[1]
    for column in range(columns):
        numbers = ", ".join(f"{v:.9g}" for v in series.values[:, column])
        body += f"        float v{column}[{count}] = {{{numbers}}};\n"
    body += f"        for (int n = 0; n < {count}; ++n) {{\n"
    body += "            float t = on_frame[i[n]] * in_stop[j[n]];\n"
    per = columns // len(targets)
    for number, target in enumerate(targets):
        value = f"v{per * number}[n]"
        if per == 2:
            value = f"({value} + wavelength * v{per * number + 1}[n])"
        body += f"            {target} += t * {value};\n"
    return body + "        }\n    }\n"


_USE = """\
In Blender 4.5 or later: render with Cycles (processor or OptiX), set the camera's lens
type to Custom and choose this file. Its place is the entrance pupil, {pupil:.2f} mm
in front of the sensor. Frame: {frame}, {width:g} mm wide, at f/{stop:g}; another
f-number or focus distance is another export."""


def export_cycles(request: ExportRequest) -> Exported:
    """The shader of the lens at its state.

    Raises
    ------
    ExchangeError : The f-number is not known.
    """
    lens, frame = request.lens(), request.frame
    if lens.f_number is None:
        raise ExchangeError(
            "rays through the pupil need an f-number",
            where=request.preset.lens.name,
            remedy="give --f-number",
        )
    made, judged = fit_ray_series(lens, frame)
    nearness = (
        Nearness("distortion", judged.chief),
        Nearness("rays, from infinity to half the focus distance", judged.rays),
        Nearness("fall-off", worst_light=judged.worst_light),
    )
    use = _USE.format(
        pupil=float(lens.entrance_pupil_offset_mm),
        frame=frame,
        width=frame.sensor_width_mm,
        stop=lens.f_number,
    )
    label = "\n".join([lens_description(request, lens), *map(str, nearness), use])
    write_text_atomic(request.out, cycles_osl_text(made, label))
    found = export_result(
        request, lens, nearness, has_colour=True, has_light=True, has_blur=True
    )
    return Exported(found.paths, found.nearness, (*found.notes, *_left_out(lens)))


def _left_out(lens: Lens) -> list[str]:
    notes = ["a path tracer's rays do not diffract"]
    if lens.blur is None:
        notes.append("the blur was not measured: a perfect lens' is written")
    elif lens.blur.transmission is not None:
        notes.append("the shader holds no ring brightness and no filter of the stop")
    return notes
