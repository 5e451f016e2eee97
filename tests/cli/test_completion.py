"""What a shell completes, with bash itself, and that the scripts for the others name all there is."""

import re
import shlex
import shutil
import subprocess

import pytest

from jaxrmp.cli import build_parser, main
from jaxrmp.cli._completion import bash_script, fish_script, zsh_script

BASH = shutil.which("bash")


def completed(*words: str) -> list[str]:
    """What bash offers for the last of the words of a command line."""
    if BASH is None:
        pytest.skip("needs bash")
    line = " ".join(f"'{word}'" for word in ("jaxrmp", *words))
    ask = f'COMP_WORDS=({line}); COMP_CWORD={len(words)}; _jaxrmp; printf "%s\\n" "${{COMPREPLY[@]}}"'
    done = subprocess.run([BASH, "-c", bash_script() + ask], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_commands_are_completed():
    assert completed("re") == ["reproduce"]
    assert {"learn", "run", "evaluate", "demonstrate", "completion", "--help"} <= set(completed(""))


def test_options_and_their_values_are_completed():
    assert completed("run", "skill.npz", "--tracker-d") == ["--tracker-delay", "--tracker-dropouts"]
    assert completed("run", "skill.npz", "--scene", "") == ["drawer", "drawer_obstacle", "door"]
    assert completed("evaluate", "skill.npz", "--scene", "do") == ["door"]
    assert completed("evaluate", "skill.npz", "--physics", "m") == ["mujoco", "mjx"]
    assert completed("demonstrate", "door") == ["door_reaching"]
    assert completed("completion", "") == ["bash", "zsh", "fish"]


def test_files_are_left_to_the_shell():
    assert completed("reproduce", "out/") == [] == completed("learn", "c.toml", "--out", "")
    assert "complete -o default" in bash_script()


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_every_shell_has_every_option(shell, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    assert script == {"bash": bash_script, "zsh": zsh_script, "fish": fish_script}[shell]()
    help_of_all = build_parser().format_help()
    for command in re.findall(r"^    (\w+)", help_of_all, re.MULTILINE):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        for flag in re.findall(r"--([a-z][a-z-]+)", capsys.readouterr().out.split("options:")[1].split("example:")[0]):
            assert re.search(rf"(--|-l ){flag}\b", script), f"{command} --{flag}"


def test_the_script_for_zsh_is_made_of_whole_words():
    words = shlex.split(zsh_script())  # an unbalanced quotation mark is an error
    assert "run:run a skill in physics" in words
    assert any(w.startswith("--scene[") and w.endswith(":SCENE:(drawer drawer_obstacle door)") for w in words)
    assert "--quiet[show no progress, results and errors only];;" in words


@pytest.mark.skipif(shutil.which("fish") is None, reason="needs fish")
def test_fish_completes(tmp_path):
    script = tmp_path / "jaxrmp.fish"
    script.write_text(fish_script())

    def offered(line):
        done = subprocess.run(
            ["fish", "--no-config", "-c", f"source {script}; complete -C '{line}'"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        return [word.split("\t")[0] for word in done.stdout.splitlines()]

    assert offered("jaxrmp repr") == ["reproduce"]
    assert offered("jaxrmp run skill.npz --tracker-d") == ["--tracker-delay", "--tracker-dropouts"]
    assert offered("jaxrmp run skill.npz --scene d") == ["door", "drawer", "drawer_obstacle"]
    assert offered("jaxrmp completion ") == ["bash", "fish", "zsh"]
    assert offered("jaxrmp reproduce jax") == ["jaxrmp.fish"]


@pytest.mark.skipif(shutil.which("zsh") is None, reason="needs zsh")
def test_zsh_is_told_what_to_complete(tmp_path):
    script = tmp_path / "_jaxrmp"
    script.write_text(zsh_script())
    subprocess.run(["zsh", "-n", str(script)], check=True)
    # zsh's own functions need a terminal: here they print what they are given.
    stand_ins = "_arguments() { print -rl -- $@ }; _describe() { print -rl -- ${(P)2} }; compdef() { : }"

    def told(*words):
        line = f"{stand_ins}; source {script}; words=(jaxrmp {' '.join(words)}); CURRENT={len(words) + 1}; _jaxrmp"
        return subprocess.run(["zsh", "-f", "-c", line], capture_output=True, text=True, check=True).stdout.splitlines()

    assert any(line.startswith("reproduce:") for line in told("re"))
    run = told("run", "skill.npz", "--scene", "d")
    assert any(line.startswith("--scene[") and line.endswith(":(drawer drawer_obstacle door)") for line in run)
    assert any(line.startswith("--frame[") and line.endswith(":FRAME:_files") for line in told("teach", "--frame", "p"))
