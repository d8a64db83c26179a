"""The photograph of a take beside the model's, with a wipe, and the residual.

Without a script both lie side by side; with it the model lies over the photograph and a
slider (or a finger on the picture) wipes one away from the other. On paper there are
three pictures in a row.
"""

from collections.abc import Mapping

from lensfit.report.markup import Markup, number, tag

MODEL_PICTURES = ("photograph", "model", "left")
"""Names of a take's pictures in the report."""
_STEPS = 9
"""Of the key of colours."""
_WITH_BLUR = "where the lens puts them, with its blur and its fall-off"
_WITHOUT = "where the lens puts them, with its fall-off; blur was not measured here"


def wipe_figures(
    take: dict, name: str, pictures: Mapping[str, str | None]
) -> Markup | None:
    """Wipe and residual of one take, or why there are none; None without pictures.

    Parameters
    ----------
    take : Its part of the report.
    name : What the page calls it.
    pictures : ``data:`` address of each picture, by the path that the report names.
    """
    said = take.get("modelled") or {}
    if said.get("failed"):
        reason = f"The model's picture could not be drawn: {said['failed']}"
        return tag("p", reason, class_="facts")
    photograph, model, left = (
        pictures.get(said.get(key) or "") for key in MODEL_PICTURES
    )
    if photograph is None or model is None or left is None:
        return None
    return tag(
        "div",
        _wipe(name, photograph, model, _caption(said)),
        _residual_picture(name, left, said),
        class_="trio",
    )


def _wipe(name: str, photograph: str, model: str, caption: str) -> Markup:
    shots = [
        tag(
            "div",
            tag("img", src=address, alt=f"{what.capitalize()} of {name}"),
            tag("span", what, class_="what"),
            class_=f"shot {what}",
        )
        for what, address in (("photograph", photograph), ("model", model))
    ]
    stage = tag("div", tag("div", *shots, class_="stage"), class_="pair")
    slider = tag(
        "input", type="range", min="0", max="100", value="50", step="1",
        aria_label=f"Wipe between photograph and model of {name}",
    )  # fmt: skip
    large = tag("button", "Actual size", type="button", aria_pressed="false")
    controls = tag("div", slider, large, class_="wiper", hidden=True)
    return tag(
        "figure",
        tag("h4", "Photograph and model"),
        stage,
        controls,
        tag("figcaption", caption),
        class_="wipe",
        data_figure="wipe",
    )


def _caption(said: dict) -> str:
    where = _WITH_BLUR if said.get("blur_measured") else _WITHOUT
    text = f"The detected points, {where}; green light."
    if said.get("lighting_fitted"):
        text += " How unevenly the chart was lit is not the lens' and was fitted."
    if said.get("explained") is not None:
        text += f" The model explains {_share(float(said['explained']))} of what the "
        text += "photograph shows among them (of its variance)."
    return text


def _share(part: float) -> str:
    """A share that is never rounded to the whole."""
    percent = 100 * part
    for digits in (1, 2, 3):
        if percent < 100 - 0.5 * 10**-digits:
            return f"{percent:.{digits}f}%"
    return "more than 99.999%"


def _residual_picture(name: str, address: str, said: dict) -> Markup:
    picture = tag("img", src=address, alt=f"Photograph minus model, {name}")
    label = f"Enlarge the residual of {name}"
    button = tag("button", picture, type="button", class_="zoom", aria_label=label)
    share = said.get("left_share")
    ends = number(None if share is None else 100 * share, "%", 1)
    key = tag(
        "div",
        tag("span", f"−{ends}"),
        *(tag("i", class_=f"k{k}") for k in range(_STEPS)),
        tag("span", f"+{ends}"),
        class_="key",
    )
    text = "Photograph minus model, of what is shown as white: orange where the "
    text += "photograph is brighter, blue where it is darker."
    return tag(
        "figure",
        tag("h4", "What is left"),
        button,
        key,
        tag("figcaption", text),
        data_figure="left",
    )
