"""`jaxrmp completion`: what makes a shell complete the command line, from the parser itself, by shtab."""

import argparse

from .._errors import importing
from ..scenes import SCENES
from ._parser import TASKS, build_parser

_WORDS = {"TASK": TASKS, "SCENE": tuple(SCENES)}  # of arguments whose values are checked later, by metavar


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    print(script(arguments.shell))


def script(shell: str) -> str:
    """Completion for a `shell`: bash, zsh or fish. Where there are no words, files are completed.

    **Raises** `MissingDependencyError` without shtab.
    """
    with importing("shtab", "learning"):
        import shtab
    parser = build_parser()
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    for listed in commands._choices_actions:
        command = commands.choices[listed.dest]
        command.description = listed.help  # which shells show
        for action in command._actions:
            action.choices = action.choices or _WORDS.get(str(action.metavar))
            if action.nargs != 0 and not action.choices:
                action.complete = shtab.FILE  # pyright: ignore[reportAttributeAccessIssue]
    # bash falls back to files where no word fits: a scene may be a file, too.
    fallback = "\ncomplete -o default -o bashdefault -F _shtab_jaxrmp jaxrmp" if shell == "bash" else ""
    return shtab.complete(parser, shell) + fallback
