"""README and docs/ put to the test: their code runs, their commands run and parse, their links lead somewhere."""

import dataclasses
import re
import shlex
import shutil
from functools import partial
from pathlib import Path

import jax
import pytest

from jaxrmp import evaluation, learning
from jaxrmp.cli import build_parser, main
from jaxrmp.learning import Configuration

from .blocks import code_blocks, run_blocks

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")
TEXTS = [
    *("README.md", "CONTRIBUTING.md", "CHANGELOG.md"),
    *(p.relative_to(ROOT).as_posix() for p in sorted((ROOT / "docs").rglob("*.md"))),
]


def command_lines(program: str) -> list[str]:
    lines = "\n".join(code_blocks(README, "sh") + code_blocks(COMMANDS, "sh")).splitlines()
    return [line for line in lines if line.startswith(program + " ")]


LINES = "".join(code_blocks(COMMANDS, "sh")).splitlines()
LESS_LEARNING = [
    "--flow.updates",
    "300",
    "--metric.updates",
    "100",
    "--potential.widths",
    "[0.05]",
    "--potential.basin_starts",
    "100",
]


def test_the_documented_commands_hold_those_of_the_readme():
    assert len(LINES) >= 5 and {line for line in command_lines("jaxrmp") if line in README} <= set(LINES)


@pytest.mark.parametrize("line", LINES)
def test_commands_run(line, request, monkeypatch, tmp_path, capsys, can_draw):
    """Each `jaxrmp` line of docs/command_line.md, after the first, with less work than it would do."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("JAXRMP_DATA", raising=False)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    arguments = shlex.split(line)[1:]
    if arguments[0] == "learn":
        arguments += LESS_LEARNING
    else:
        shutil.copytree(request.getfixturevalue("learned_drawer"), tmp_path / "out" / "drawer_closing")
    if arguments[0] == "run" and ".toml" not in line:
        arguments += ["--trials", "1", "--limit", "3"]
    if arguments[0] == "evaluate":
        arguments += ["--starts", "4", "--duration", "0.5"]
        few = partial(evaluation.stationary_points, starts=64)
        monkeypatch.setattr("jaxrmp.evaluation._report.stationary_points", few)
    if not can_draw and "--video" in arguments:
        at = arguments.index("--video")
        arguments[at : at + 2] = []
    assert main(arguments) == 0, f"{line}: {capsys.readouterr().err}"
    for written in (word for word in arguments if word.startswith("out/")):
        assert (tmp_path / written).exists(), f"{line} has not written {written}"


def test_every_configuration_key_is_documented():
    text = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
    sections = dict(
        zip(("", *re.findall(r"^## `\[(\w+)\]`", text, re.M)), re.split(r"^## ", text, flags=re.M), strict=True)
    )
    for f in dataclasses.fields(Configuration):
        if dataclasses.is_dataclass(f.default):
            for inner in dataclasses.fields(f.default):
                assert f"`{inner.name}`" in sections[f.name], f"{f.name}.{inner.name}"
        else:
            assert f"`{f.name}`" in sections[""] or f"`[[{f.name}]]`" in sections[""], f.name


def test_readme_code_runs(monkeypatch, capsys):
    """As written, but for what the learning is asked to do: less, as in the commands."""
    less = {"flow.updates": 300, "metric.updates": 100, "potential.widths": [0.05], "potential.basin_starts": 100}
    monkeypatch.setattr(learning, "load_configuration", partial(learning.load_configuration, overrides=less))
    monkeypatch.chdir(ROOT)
    namespace = run_blocks(README, "readme")
    assert namespace["qdd"].shape == (7,)
    assert namespace["jaxrmp"].uncertified_leaves(namespace["safer"]) == ()
    assert "Certificate(" in capsys.readouterr().out
    near, run = namespace["near"], namespace["run"]
    through, past = (jax.vmap(near)(run(namespace[name]).q).min() for name in ("tree", "safer"))
    assert through < -0.02 and past > 0  # the ball is in the way, and is avoided


@pytest.mark.parametrize("line", command_lines("jaxrmp"))
def test_commands_parse(line):
    words = shlex.split(line, comments=True)[1:]
    parsed, rest = build_parser().parse_known_args(words)
    assert parsed.command == words[0]
    assert not rest or parsed.takes_overrides
    configuration = getattr(parsed, "config", None)
    assert configuration is None or (ROOT / configuration).is_file()


def test_every_command_is_documented():
    text = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")
    commands = re.findall(r"^    (\w+)", build_parser().format_help(), re.MULTILINE)
    assert len(commands) >= 6
    for command in commands:
        assert f"| `jaxrmp {command}" in text, command


def test_there_are_commands_to_check():
    assert {shlex.split(line)[1] for line in command_lines("jaxrmp")} == {
        *("learn", "reproduce", "run", "evaluate", "demonstrate")
    }


@pytest.mark.parametrize("line", command_lines("make"))
def test_make_targets_exist(line):
    target = shlex.split(line, comments=True)[1]
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


def test_overrides_in_commands_are_configuration_keys():
    from jaxrmp.cli._overrides import parse_overrides
    from jaxrmp.learning import load_configuration

    checked = 0
    for line in command_lines("jaxrmp"):
        parsed, rest = build_parser().parse_known_args(shlex.split(line, comments=True)[1:])
        if rest:
            load_configuration(ROOT / parsed.config, parse_overrides(rest))
            checked += 1
    assert checked


@pytest.mark.parametrize("text", TEXTS)
def test_links_lead_to_files(text):
    path = ROOT / text
    for target in re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), f"{text} links to {target}"


def leaf_classes():
    """Public leaves by their address."""
    from jaxrmp import Leaf, leaves

    found = {f"{m.__name__}.{n}": v for m in (leaves, leaves.lula) for n, v in vars(m).items() if isinstance(v, type)}
    return [address for address, leaf in found.items() if issubclass(leaf, Leaf)]


@pytest.mark.parametrize("address", leaf_classes())
def test_every_leaf_has_a_row_that_leads_to_its_reference_and_if_ours_a_formula(address):
    text = (ROOT / "docs" / "leaves.md").read_text(encoding="utf-8")
    part, name = address.split(".")[-2:]
    label = name if part == "leaves" else f"lula.{name}"
    assert re.search(rf"^\| \[`{name}`\]\[{label}\] \| \w[^|]+ \|$", text, re.MULTILINE)
    assert f"\n[{label}]: reference/{part}.md#{address}\n" in text
    if part == "leaves":
        assert re.search(rf"^- `leaves\.{name}`[:,].*\$", text, re.MULTILINE)


def test_the_tables_of_leaves_are_narrow():
    text = (ROOT / "docs" / "leaves.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\|.*", text, re.MULTILINE)
    assert len(rows) > len(leaf_classes())
    for row in rows:
        assert row.count("|") == 3 and len(row) <= 120, row
        assert "$" not in row, f"a formula in a table: {row}"
