"""Parses the command line, runs the command, and turns errors into messages and exit codes."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from .. import __version__
from .._errors import JaxrmpError
from . import _demonstrate, _learn, _reproduce

EXIT_CODES = "exit codes: 0 done, 1 an error that the message explains, 2 wrong usage, 130 interrupted"


def build_parser() -> argparse.ArgumentParser:
    """The parser of `jaxrmp`, one subcommand a module."""
    parser = argparse.ArgumentParser(
        prog="jaxrmp", description="Stable reactive robot motion policies from demonstrations.", epilog=EXIT_CODES
    )
    parser.add_argument("--version", action="version", version=f"jaxrmp {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in (_learn, _reproduce, _demonstrate):
        module.add_parser(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = build_parser()
    parsed, rest = parser.parse_known_args(arguments)
    if rest and not getattr(parsed, "takes_overrides", False):
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    _keep_compiled_programs()
    try:
        parsed.run(parsed, rest)
    except JaxrmpError as error:
        print(f"jaxrmp: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("jaxrmp: interrupted; no file was left half-written", file=sys.stderr)
        return 130
    return 0


def _keep_compiled_programs() -> None:
    """Switch JAX's persistent compilation cache on, unless the user has set one: it halves the time of a second run."""
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return
    import jax

    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jaxrmp"
    jax.config.update("jax_compilation_cache_dir", str(cache))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
