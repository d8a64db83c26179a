"""The outcome of one frame of a batch: rendered, skipped or failed; never raises."""

from dataclasses import dataclass
from pathlib import Path

from lensfit.errors import ImageError, LensfitError, error_at_frame, sentence_of
from lensfit.io.exr import ExrPart
from lensfit.plate.frame.content_digest import write_with_digest
from lensfit.plate.frame.provenance import Fingerprint
from lensfit.plate.frame.renderer import FrameRenderer, with_fingerprint


@dataclass(frozen=True)
class FrameOutcome:
    """What became of a frame.

    Attributes
    ----------
    target : The result; None if there is none.
    skipped : It was finished before.
    failure : Why there is none, as one line that names the frame.
    notes : What was noted so far.
    size_px : Width and height of the plate's display window; None of one that failed.
    """

    target: Path | None = None
    skipped: bool = False
    failure: str | None = None
    notes: tuple[str, ...] = ()
    size_px: tuple[int, int] | None = None


def apply_frame(renderer: FrameRenderer, path: Path, target: Path) -> FrameOutcome:
    """Render a frame to its place, unless it is there as it would be rendered now."""
    try:
        made_of = renderer.fingerprint(path)
        found = ()
        if not renderer.options.overwrite:
            found = renderer.finished(path, target, made_of)
        parts = found or _rendered(renderer, path, target, made_of)
    except (LensfitError, ValueError, MemoryError, ArithmeticError) as error:
        failure = error_line(error, path)
        return FrameOutcome(failure=failure, notes=tuple(renderer.notes))
    window = parts[0].display_window
    return FrameOutcome(
        target,
        skipped=bool(found),
        notes=tuple(renderer.notes),
        size_px=(window.width, window.height),
    )


def _rendered(
    renderer: FrameRenderer, path: Path, target: Path, made_of: Fingerprint
) -> tuple[ExrPart, ...]:
    """The headers of the frame that was written."""
    image = with_fingerprint(renderer.render(path), made_of)
    write_with_digest(target, image)
    return image.parts


def error_line(error: Exception, path: Path) -> str:
    """The error as one line, with the frame it happened at."""
    if not isinstance(error, LensfitError):
        return str(ImageError(sentence_of(error), where=path))
    return str(error_at_frame(error, path))
