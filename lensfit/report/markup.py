"""HTML that escapes by default, and numbers rounded for readers.

`tag` escapes every string it is given unless that string is already `Markup`, so a
lens called ``<script>`` is text wherever it appears. Numbers keep three significant
digits, use a real minus sign and powers of ten instead of ``1e-09``; a value with its
standard deviation is rounded to two digits of the deviation (the usual rule of the
Guide to the Expression of Uncertainty in Measurement, JCGM 100:2008, section 7.2.6).
Absent (``None``) and undefined (NaN) values are an en dash.
"""

import html
import math
from collections.abc import Iterable
from numbers import Integral, Real
from typing import Any

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_VOID = {"img", "meta", "br", "hr", "input"}
NOTHING = "–"


class Markup(str):
    """Text that is HTML already; everything else is escaped."""

    __slots__ = ()


def markup(child: Any) -> Markup:
    """HTML of one child: `Markup` as it is, a list joined, other values escaped."""
    if isinstance(child, Markup):
        return child
    if child is None:
        return Markup("")
    if isinstance(child, str) or not isinstance(child, Iterable):
        return Markup(html.escape(str(child), quote=True))
    return Markup("".join(markup(one) for one in child))


def tag(element: str, *children: Any, **attributes: Any) -> Markup:
    """One HTML element; ``class_`` and ``data_x`` become ``class`` and ``data-x``.

    An attribute whose value is None or False is left out; True stands alone.
    """
    written = [element]
    for key, value in attributes.items():
        name = key.rstrip("_").replace("_", "-")
        if value is None or value is False:
            continue
        written.append(name if value is True else f'{name}="{markup(str(value))}"')
    opening = f"<{' '.join(written)}>"
    if element in _VOID:
        return Markup(opening)
    return Markup(f"{opening}{markup(children)}</{element}>")


def html_document(
    title: str, policy: str, style: str, *body: Markup, class_: str | None = None
) -> str:
    """A page in one file, which opens nothing outside it.

    Parameters
    ----------
    policy : Its content security policy.
    style : Its style sheet.
    class_ : Of the body.
    """
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=policy),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Markup(style)),
    )
    whole = tag("html", head, tag("body", *body, class_=class_), lang="en")
    return "<!DOCTYPE html>\n" + whole


def number(value: Any, unit: str = "", digits: int = 3) -> str:
    """A value to `digits` significant digits with its unit, or an en dash."""
    if not isinstance(value, Real) or math.isnan(value):
        return NOTHING
    whole, value = isinstance(value, Integral), float(value)
    suffix = "" if not unit else unit if unit in "%°" else f"\u202f{unit}"
    if math.isinf(value):
        return ("∞" if value > 0 else "−∞") + suffix
    if whole or value == 0:
        return _minus(f"{value + 0.0:,.0f}".replace(",", "\u202f")) + suffix
    exponent = math.floor(math.log10(abs(value)))
    if not -5 <= exponent < 6:
        mantissa = _minus(f"{value / 10.0**exponent:.{digits - 1}f}")
        return (
            f"{mantissa}\u202f×\u202f10{str(exponent).translate(_SUPERSCRIPTS)}{suffix}"
        )
    decimals = max(0, digits - 1 - exponent)
    return _minus(f"{value:,.{decimals}f}".replace(",", "\u202f")) + suffix


def stated_value(value: Any, unit: str = "") -> str:
    """A value that somebody stated (50 mm, f/1.4), without zeros nobody wrote."""
    if not isinstance(value, Real) or not math.isfinite(value):
        return number(value, unit)
    return _minus(f"{value:.5g}") + (f"\u202f{unit}" if unit else "")


def number_with_deviation(value: Any, deviation: Any, unit: str = "") -> str:
    """``value ± standard deviation``, both to two digits of the deviation."""
    if not isinstance(value, Real) or not isinstance(deviation, Real):
        return number(value, unit, digits=4)
    value, deviation = float(value), float(deviation)
    if not (math.isfinite(value) and math.isfinite(deviation) and deviation > 0):
        return number(value, unit, digits=4)
    top = math.floor(math.log10(max(abs(value), deviation)))
    power = top if not -3 <= top < 5 else 0
    scale = 10.0**power
    decimals = max(0, 1 - math.floor(math.log10(deviation / scale)))
    pair = f"{value / scale:.{decimals}f} ± {deviation / scale:.{decimals}f}"
    suffix = "" if not unit else f"\u202f{unit}"
    if power:
        raised = str(power).translate(_SUPERSCRIPTS)
        return _minus(f"({pair})") + f"\u202f×\u202f10{raised}{suffix}"
    return _minus(pair) + suffix


def _minus(text: str) -> str:
    return text.replace("-", "−")
