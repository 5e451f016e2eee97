"""What a shell completes, with bash itself, and that the scripts for the others name all there is."""

import re
import shlex
import shutil
import subprocess

import pytest

from jaxrmp.cli import build_parser, main
from jaxrmp.cli._completion import script

BASH = shutil.which("bash")


def completed(*words: str, folder=None) -> list[str]:
    """What bash offers for the last of the words of a command line in a folder."""
    if BASH is None:
        pytest.skip("needs bash")
    line = " ".join(f"'{word}'" for word in ("jaxrmp", *words))
    ask = f'COMP_WORDS=({line}); COMP_CWORD={len(words)}; _shtab_jaxrmp; printf "%s\\n" "${{COMPREPLY[@]}}"'
    asked = [BASH, "-c", f"{script('bash')}\n{ask}"]
    done = subprocess.run(asked, cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_commands_are_completed():
    assert completed("re") == ["reproduce", "record"]
    assert {"learn", "run", "evaluate", "demonstrate", "completion"} <= set(completed(""))
    assert {"--help", "--version"} <= set(completed("-"))


def test_options_and_their_values_are_completed():
    assert completed("run", "skill.npz", "--tracker-d") == ["--tracker-delay", "--tracker-dropouts"]
    assert completed("run", "skill.npz", "--scene", "") == ["drawer", "drawer_obstacle", "door"]
    assert completed("evaluate", "skill.npz", "--scene", "do") == ["door"]
    assert completed("evaluate", "skill.npz", "--physics", "m") == ["mujoco", "mjx"]
    assert completed("demonstrate", "door") == ["door_reaching"]
    assert completed("completion", "") == ["bash", "zsh", "fish"]


def test_files_are_completed(tmp_path):
    (tmp_path / "drawer.skill.npz").touch()
    assert completed("reproduce", "dr", folder=tmp_path) == ["drawer.skill.npz"]
    assert completed("learn", "c.toml", "--out", "", folder=tmp_path) == ["drawer.skill.npz"]
    assert completed("reproduce", "out/", folder=tmp_path) == []
    assert script("bash").rstrip().splitlines()[-1].startswith("complete -o default")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_every_shell_has_every_option(shell, capsys):
    assert main(["completion", shell]) == 0
    printed = capsys.readouterr().out
    assert printed.strip() == script(shell).strip()
    help_of_all = build_parser().format_help()
    for command in re.findall(r"^    (\w+)", help_of_all, re.MULTILINE):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        for flag in re.findall(r"--([a-z][a-z-]+)", capsys.readouterr().out.split("options:")[1].split("example:")[0]):
            assert re.search(rf"(--|-l ){flag}\b", printed), f"{command} --{flag}"


def test_the_script_for_zsh_is_made_of_whole_words():
    words = shlex.split(script("zsh"), comments=True)  # an unbalanced quotation mark is an error
    assert "run:run a skill or a sequence in physics" in words
    assert any(w.startswith("--scene[") and w.endswith(":SCENE:(drawer drawer_obstacle door)") for w in words)
    assert "{-q,--quiet}[show no progress, results and errors only]" in words


@pytest.mark.skipif(shutil.which("fish") is None, reason="needs fish")
def test_fish_completes(tmp_path):
    file = tmp_path / "jaxrmp.fish"
    file.write_text(script("fish"))

    def offered(line):
        done = subprocess.run(
            ["fish", "--no-config", "-c", f"source {file}; complete -C '{line}'"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        return [word.split("\t")[0] for word in done.stdout.splitlines()]

    assert offered("jaxrmp repr") == ["reproduce"]
    assert offered("jaxrmp run skill.npz --tracker-d") == ["--tracker-delay", "--tracker-dropouts"]
    assert offered("jaxrmp run skill.npz --scene d") == ["drawer", "drawer_obstacle", "door"]
    assert offered("jaxrmp completion ") == ["bash", "zsh", "fish"]
    assert offered("jaxrmp reproduce jax") == ["jaxrmp.fish"]


@pytest.mark.skipif(shutil.which("zsh") is None, reason="needs zsh")
def test_zsh_is_told_what_to_complete(tmp_path):
    file = tmp_path / "_jaxrmp"
    file.write_text(script("zsh"))
    subprocess.run(["zsh", "-n", str(file)], check=True)
    # zsh's own functions need a terminal: here they print what they are given.
    stand_ins = (
        "_arguments() { print -rl -- $@; state=jaxrmp; line=($words[2]) }; _describe() { print -rl -- ${(P)2} }; "
        "compdef() { : }"
    )

    def told(function, *words):
        line = f'{stand_ins}; eval "$(<{file})"; words=(jaxrmp {" ".join(words)}); CURRENT={len(words) + 1}; {function}'
        return subprocess.run(["zsh", "-f", "-c", line], capture_output=True, text=True, check=True).stdout.splitlines()

    assert any(line.startswith("reproduce:") for line in told("_shtab_jaxrmp_commands", "re"))
    run = told("_shtab_jaxrmp", "run", "skill.npz", "--scene", "d")
    assert any(line.startswith("--scene[") and line.endswith(":(drawer drawer_obstacle door)") for line in run)
    assert any(
        line.startswith("--frame[") and line.endswith(":FRAME:_files")
        for line in told("_shtab_jaxrmp", "teach", "--frame", "p")
    )
