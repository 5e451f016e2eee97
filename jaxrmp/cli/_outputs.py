"""Whether what a command is to write can be written, before it works."""

import argparse
import tempfile
from pathlib import Path

from .._errors import ConfigurationError

_FILES = ("json", "html", "save", "video", "stablehlo")
_PLACES = (*_FILES, "out", "figures", "c", "log")  # the options that name what is written; some are folders


def check_outputs(arguments: argparse.Namespace) -> None:
    """**Raises** `ConfigurationError`, by option, for a file or folder of `arguments` that could not be written to.

    Nothing is made: a file without a name is opened, and gone again, in the nearest folder that is there.
    """
    for name in _PLACES:
        path = getattr(arguments, name, None)
        if not isinstance(path, Path):
            continue
        if name in _FILES and path.is_dir():
            raise ConfigurationError(f"cannot write --{name} {path}: it is a folder, expected a file.")
        at = path if path.is_dir() else next(folder for folder in path.absolute().parents if folder.exists())
        try:
            if not at.is_dir():
                raise NotADirectoryError(f"{at} is a file, not a folder")
            with tempfile.TemporaryFile(dir=at):
                pass
        except OSError as error:
            why = f"files cannot be made in {at} ({error.strerror})" if error.strerror else str(error)
            raise ConfigurationError(f"cannot write --{name} {path}: {why}.") from error
