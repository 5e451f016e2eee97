"""Parses the command line, runs the command, and turns errors into messages and exit codes."""

import contextlib
import importlib
import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from .._errors import JaxrmpError
from ._ending import CODES, INTERRUPTED, Ended, end_at_once, ended_by_signals
from ._outputs import check_outputs
from ._parser import build_parser

_BRAKED = ("drive", "record")  # look after signals themselves: an arm is braked first
_PAGES = ("view", "teach")  # are ended by signals, and by nothing else


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line `arguments`, by default the process's own, and return its exit code."""
    parser = build_parser()
    parsed, rest = parser.parse_known_args(arguments)
    if rest and not getattr(parsed, "takes_overrides", False):
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    parsed.command_line = list(sys.argv[1:] if arguments is None else arguments)
    # JAX's persistent compilation cache, unless the user has set one: it halves the time of a second run.
    if parsed.command != "completion" and not os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        import jax

        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxrmp"
        jax.config.update("jax_compilation_cache_dir", str(cache))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    try:
        codes = dict.fromkeys(CODES, 0) if parsed.command in _PAGES else CODES
        ending = contextlib.nullcontext() if parsed.command in _BRAKED else ended_by_signals(codes)
        with ending, warnings.catch_warnings():
            warnings.showwarning = _show_warning
            check_outputs(parsed)
            importlib.import_module(f"._{parsed.command}", __package__).run(parsed, rest)
    except JaxrmpError as error:
        print(f"jaxrmp: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(
            f"jaxrmp: cannot write or read {error.filename or 'a file'!r}: {error.strerror or error}.", file=sys.stderr
        )
        return 1
    except KeyboardInterrupt as interrupt:
        if isinstance(interrupt, Ended):
            end_at_once(interrupt.code, "" if parsed.command in _PAGES else INTERRUPTED)
        print(INTERRUPTED, file=sys.stderr)
        return 130
    return 0


def _show_warning(message, category, filename, lineno, file=None, line=None) -> None:
    if issubclass(category, UserWarning):
        from ._output import tell

        tell(str(message))
