"""The errors of lensfit, and when each is raised.

- Static misuse by a programmer (a wrong shape, an unknown channel): ``ValueError``.
- A fault that a user can correct (a file, a photograph, a shoot, a preset): a
  `LensfitError`. Its text is one sentence in three parts: what is wrong, where,
  and what to do. The command line prints that line and exits with code 1.
- Values inside compiled code never raise: they come back as NaN or as a flag, and the
  caller that knows the file turns them into one of the errors below.
"""

from pathlib import Path

from lensfit.printable import printable

_LONGEST = 500


class LensfitError(Exception):
    """A failure that its user can mend.

    Parameters
    ----------
    what : what is wrong, as a sentence without its full stop.
    where : the file, key, take or frame it happened at; left out of the text if None.
    remedy : what to do about it, as a sentence without its full stop.
    """

    def __init__(
        self, what: str, *, where: str | Path | None = None, remedy: str | None = None
    ):
        self.what = what
        self.where = where
        self.remedy = remedy
        super().__init__(self._sentence())

    def _sentence(self) -> str:
        place = f"{self.where}: " if self.where is not None else ""
        advice = f"; {_on_one_short_line(self.remedy)}" if self.remedy else ""
        return printable(
            " ".join(f"{place}{_on_one_short_line(self.what)}{advice}".split())
        )


def sentence_of(error: BaseException) -> str:
    """An error that is none of these in one line, its kind first."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def error_at_frame(error: LensfitError, path: Path) -> LensfitError:
    """The error, named after the frame; it keeps its kind where it had no other place.

    Parameters
    ----------
    path : Of the frame.
    """
    if error.where is None:
        return type(error)(error.what, where=path, remedy=error.remedy)
    if Path(error.where) == path:
        return error
    what = f"{error.where}: {error.what}"
    return LensfitError(what, where=path, remedy=error.remedy)


def _on_one_short_line(text: str) -> str:
    """A line stays a line, whatever a file holds where a word should stand."""
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


class ImageError(LensfitError):
    """A picture file that cannot be read, or holds what it may not."""


class OutputError(LensfitError):
    """A result that cannot be written where it was requested."""


class CameraError(LensfitError):
    """A sidecar or camera file that cannot be read, or does not know a frame."""


class SettingsError(LensfitError):
    """A settings file that is malformed, or says what cannot be."""


class DetectionError(LensfitError):
    """A photograph on which the target could not be found or indexed."""


class ShootError(LensfitError):
    """A shoot file that is malformed, or contradicts itself or its photographs."""


class ChartError(LensfitError):
    """A chart that cannot be made as it was requested."""


class FitError(LensfitError):
    """Observations that do not determine a lens."""


class PresetError(LensfitError):
    """A preset that is malformed, of an unknown schema, or lacks what was asked."""


class ExchangeError(LensfitError):
    """A lens file of another program that is malformed, or a lens it cannot hold."""
