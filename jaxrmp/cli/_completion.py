"""`jaxrmp completion`: what makes a shell complete the command line, from the parser itself."""

import argparse
import shlex
from collections.abc import Iterator

from ..scenes import SCENES
from ._parser import TASKS, build_parser

_WORDS = {"TASK": TASKS, "SCENE": tuple(SCENES)}  # of arguments whose values are checked later, by metavar


def run(arguments: argparse.Namespace, rest: list[str]) -> None:
    print({"bash": bash_script, "zsh": zsh_script, "fish": fish_script}[arguments.shell](), end="")


def bash_script() -> str:
    """Completion for bash; where there are no words, it completes files."""
    names = " ".join(name for name, _, _ in _commands())
    values, flags, positionals = [], [], []
    for name, _, parser in _commands():
        options = [action for action in parser._actions if action.option_strings]
        values += [
            f'    "{name} {flag}") words="{" ".join(_words(action))}"; value=1;;'
            for action in options
            for flag in action.option_strings
            if _takes_value(action)
        ]
        flags.append(f'      {name}) words="{" ".join(f for action in options for f in action.option_strings)}";;')
        words = [word for action in parser._actions if not action.option_strings for word in _words(action)]
        positionals.append(f'      {name}) words="{" ".join(words)}";;')
    return "\n".join(
        [
            "# bash completion of jaxrmp",
            "_jaxrmp() {",
            '  local cur="${COMP_WORDS[COMP_CWORD]}" words="" value=""',
            "  COMPREPLY=()",
            '  if [ "$COMP_CWORD" -eq 1 ]; then',
            f'    COMPREPLY=($(compgen -W "{names} --help --version" -- "$cur")); return',
            "  fi",
            '  case "${COMP_WORDS[1]} ${COMP_WORDS[COMP_CWORD-1]}" in',
            *values,
            "  esac",
            '  if [ -z "$value" ]; then',
            '    case "$cur" in',
            '    -*) case "${COMP_WORDS[1]}" in',
            *flags,
            "      esac;;",
            '    *) case "${COMP_WORDS[1]}" in',
            *positionals,
            "      esac;;",
            "    esac",
            "  fi",
            '  COMPREPLY=($(compgen -W "$words" -- "$cur"))',
            "}",
            "complete -o default -F _jaxrmp jaxrmp",
            "",
        ]
    )


def zsh_script() -> str:
    """Completion for zsh, to be found as `_jaxrmp` in `fpath`."""
    described = "\n".join(f"    {shlex.quote(f'{name}:{text}')}" for name, text, _ in _commands())
    cases = []
    for name, _, parser in _commands():
        specs = [shlex.quote(spec) for action in parser._actions for spec in _zsh_specs(action)]
        cases.append(f"    {name}) _arguments " + " ".join(specs) + ";;")
    return "\n".join(
        [
            "#compdef jaxrmp",
            "_jaxrmp() {",
            "  local -a commands",
            "  commands=(",
            described,
            "  )",
            "  if (( CURRENT == 2 )); then _describe command commands; return; fi",
            "  local name=$words[2]",
            "  shift words; (( CURRENT-- ))",
            "  case $name in",
            *cases,
            "  esac",
            "}",
            'if [ "$funcstack[1]" = _jaxrmp ]; then _jaxrmp "$@"; else compdef _jaxrmp jaxrmp; fi',
            "",
        ]
    )


def fish_script() -> str:
    """Completion for fish."""
    names = " ".join(name for name, _, _ in _commands())
    lines = ["# fish completion of jaxrmp"]
    for name, text, parser in _commands():
        here = f'-n "__fish_seen_subcommand_from {name}"'
        lines.append(
            f'complete -c jaxrmp -f -n "not __fish_seen_subcommand_from {names}" -a {name} -d {shlex.quote(text)}'
        )
        for action in parser._actions:
            words = " ".join(_words(action))
            values = f" -r{f' -f -a {shlex.quote(words)}' if words else ''}" if _takes_value(action) else ""
            flags = " ".join(f"-l {f[2:]}" if f.startswith("--") else f"-s {f[1:]}" for f in action.option_strings)
            if flags:
                lines.append(f"complete -c jaxrmp {here} {flags}{values} -d {shlex.quote(action.help or '')}")
            elif words:
                lines.append(f"complete -c jaxrmp -f {here} -a {shlex.quote(words)}")
    return "\n".join([*lines, ""])


def _commands() -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Every command: its name, what it does, its parser."""
    parser = build_parser()
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    for listed in commands._choices_actions:
        yield listed.dest, listed.help or "", commands.choices[listed.dest]


def _takes_value(action: argparse.Action) -> bool:
    return bool(action.option_strings) and action.nargs != 0


def _words(action: argparse.Action) -> tuple[str, ...]:
    """What an argument may be, as far as that is known beforehand."""
    return tuple(str(word) for word in action.choices or _WORDS.get(str(action.metavar), ()))


def _zsh_specs(action: argparse.Action) -> list[str]:
    words = _words(action)
    values = f"({' '.join(words)})" if words else "_files"
    label = action.metavar or action.dest
    if not action.option_strings:
        return [f":{label}:{values}"]
    text = (action.help or "").replace("[", "(").replace("]", ")").replace(":", ",")
    after = f":{label}:{values}" if _takes_value(action) else ""
    return [f"{flag}[{text}]{after}" for flag in action.option_strings]
