"""`jaxrmp check`: facts, what is left out, and an exit code that tells what must not be used."""

import json
import math

import h5py
import numpy as np
import pytest

from jaxrmp.cli import main

ARM = """<robot name="arm"><link name="base"/>
<link name="upper"><collision><geometry><box size="0.1 0.1 0.3"/></geometry></collision></link><link name="tool0"/>
<joint name="pan" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="2" velocity="1.5" effort="9"/></joint>
<joint name="flange" type="fixed"><parent link="upper"/><child link="tool0"/><origin xyz="0 0 0.3"/></joint></robot>"""
RECORDED = "time,pan\n" + "".join(f"{0.1 * k:.1f},{{0}}{0.01 * k:.3f}\n" for k in range(60))


@pytest.fixture
def check(tmp_path, capsys):
    def check(name, text, *more):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        of = file
        if file.suffix == ".csv":
            file.with_name("demo_1.csv").write_text(text)
            of = file.parent
        code = main(["check", str(of), "--json", str(tmp_path / "found.json"), *map(str, more)])
        said = capsys.readouterr()
        found = tmp_path / "found.json"
        return code, json.loads(found.read_text()) if found.exists() else None, said.out + said.err

    return check


def test_a_sound_robot(check):
    code, found, said = check("arm.urdf", ARM)
    assert code == 0 and found["safe"] and found["findings"] == [] and "nothing looks wrong" in said
    (joint,) = found["read"]["joints"]
    assert joint == {"name": "pan", "kind": "revolute", "lower": -1.0, "upper": 2.0, "velocity": 1.5}
    assert found["read"]["hand"] == "tool0" and found["read"]["spheres"]["number"] > 0


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (('lower="-1" upper="2"', 'lower="2" upper="-1"'), "pan"),
        (('<box size="0.1 0.1 0.3"/>', '<mesh filename="absent.stl"/>'), "absent.stl"),
        ((' velocity="1.5"', ""), "pan"),
        (('<collision><geometry><box size="0.1 0.1 0.3"/></geometry></collision>', ""), "no sphere"),
    ],
)
def test_what_is_unsafe_of_a_robot(change, named, check):
    code, found, said = check("arm.urdf", ARM.replace(*change))
    assert code == 1 and not found["safe"]
    assert any(named in finding["what"] for finding in found["findings"] if finding["severity"] != "note")
    assert named in said and ("velocity" in change[0] or found["read"].get("spheres") is None)


def test_a_long_link_without_geometry_is_unsafe(check):
    more = """<link name="rod"/><joint name="tilt" type="continuous"><parent link="tool0"/><child link="rod"/>
    <limit velocity="1" effort="1"/></joint><link name="tip"/><joint name="end" type="fixed"><parent link="rod"/>
    <child link="tip"/><origin xyz="0.3 0 0"/></joint></robot>"""
    code, found, said = check("arm.urdf", ARM.replace("</robot>", more))
    assert code == 1 and "rod" in said and found["read"]["links without spheres"] == ["rod"]


def test_demonstrations_with_their_robot_and_without(check, tmp_path):
    code, found, _ = check("demos/demo_0.csv", RECORDED.format(""))
    assert code == 0 and found["read"]["fit the robot"] is None and "--robot" in found["findings"][0]["what"]
    (tmp_path / "arm.urdf").write_text(ARM)
    code, found, _ = check("demos/demo_0.csv", RECORDED.format(""), "--robot", tmp_path / "arm.urdf")
    assert code == 0 and found["read"]["fit the robot"] == "arm" and found["findings"] == []
    code, found, said = check("demos/demo_0.csv", RECORDED.format("9"), "--robot", tmp_path / "arm.urdf")
    assert code == 1 and "degrees" in said and found["read"]["fit the robot"] is None


def test_demonstrations_that_go_two_ways(check, tmp_path):
    (tmp_path / "arm.urdf").write_text(
        ARM.replace('name="flange" type="fixed"', 'name="tilt" type="revolute"').replace(
            '<origin xyz="0 0 0.3"/></joint>',
            '<origin xyz="0 0 0.3"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="2" effort="1"/></joint>',
        )
    )
    text = 'name = "turn"\nrobot = "arm.urdf"\n[[subtasks]]\nname = "tip"\nframe = "tool0"\noffset = [0.3, 0.0, 0.2]\n'
    for k in range(6):
        rows = [(0.1 * t, 0.02 * t + 0.01 * k, (-1) ** k * 0.5 * math.sin(0.05 * t * math.pi) ** 2) for t in range(21)]
        recorded = "time,pan,tilt\n" + "".join(f"{t:.1f},{pan:.4f},{tilt:.4f}\n" for t, pan, tilt in rows)
        (tmp_path / "demos").mkdir(exist_ok=True)
        (tmp_path / "demos" / f"demo_{k}.csv").write_text(recorded)
    code, found, said = check("turn.toml", text, "--demos", tmp_path / "demos")
    assert code == 0 and found["read"]["ways to go"] == 2 and "go 2 ways: 0, 2, 4 | 1, 3, 5." in said
    assert main(["check", str(tmp_path / "demos"), "--robot", str(tmp_path / "arm.urdf")]) == 0


def test_recordings_that_do_not_say_all(tmp_path, capsys):
    """What is missing is named with the option that says it; poses and paths are known by their content."""
    file, s = tmp_path / "pour.npz", np.linspace(0, 1, 20)[:, None]
    poses = {f"positions_{k}": 30 * s * [[1, k, 0]] for k in range(2)}
    np.savez(file, **poses, **{f"quaternions_{k}": np.tile([1.0, 0, 0, 0], (20, 1)) for k in range(2)})
    for more, said in (
        ([], "Say --units"),
        (["--units", "cm"], "Say --quaternion"),
        (["--units", "cm", "--quaternion", "wxyz"], "0.4243"),
    ):
        assert main(["check", str(file), "--rate", "10", *more]) == (1 if "Say" in said else 0)
        out = capsys.readouterr().out
        assert said in out and "poses of a hand" in out
    np.savez(tmp_path / "e.npz", positions_0=s * [[3, 4]], positions_1=s * [[6, 8]])
    assert main(["check", str(tmp_path / "e.npz")]) == 0
    assert "20       10" in capsys.readouterr().out
    (tmp_path / "arm.urdf").write_text(ARM)
    with h5py.File(tmp_path / "two.hdf5", "w") as content:
        for k in range(2):
            content[f"data/demo_{k}/obs/robot0_joint_pos"] = s
    command = ["check", str(tmp_path / "two.hdf5"), "--robot", str(tmp_path / "arm.urdf"), "--group"]
    assert main([*command, "obs/robot0_joint_pos"]) == 1 and "recording.rate" in capsys.readouterr().out
    assert main([*command, "obs/robot1_joint_pos", "--rate", "10"]) == 1
    assert "Did you mean 'obs/robot0_joint_pos'" in capsys.readouterr().out
    assert main([*command, "obs/robot0_joint_pos", "--rate", "10"]) == 0
    assert "are taken for ['pan']" in capsys.readouterr().out
    text = 'name = "turn"\nrobot = "arm.urdf"\n[[subtasks]]\nname = "tip"\nframe = "tool0"\n[recording]\nrate = 10\n'
    (tmp_path / "turn.toml").write_text(text)
    command = [str(tmp_path / "turn.toml"), "--demos", str(tmp_path / "two.hdf5")]
    main(["check", *command])
    assert "are taken for ['pan']" in capsys.readouterr().out
    assert main(["learn", *command, "--units", "grads", "--out", str(tmp_path / "out")]) == 1
    assert "unknown recording.units 'grads'" in capsys.readouterr().err


def test_a_configuration_with_its_robot(check, tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    text = 'name = "turn"\nrobot = "arm.urdf"\n[[subtasks]]\nname = "tip"\nframe = "{}"\n'
    code, found, _ = check("turn.toml", text.format("tool0"))
    assert code == 0 and found["read"]["subtasks"] and found["read"]["hand"] == "tool0"
    code, found, said = check("turn.toml", text.format("tool"))
    assert code == 1 and "tool0" in said


def test_a_robot_by_its_own_toml_file(check, tmp_path):
    (tmp_path / "arm.urdf").write_text(ARM)
    text = 'file = "arm.urdf"\n[tools.tcp]\nframe = "tool0"\npose = [0, 0, 0.1]\n'
    code, found, _ = check("held.toml", text)
    assert code == 0 and found["kind"] == "robot" and found["read"]["hand"] == "tcp"


def test_what_is_no_such_file(check, tmp_path, capsys):
    for name in ("a.npz", "a.toml", "a.xrdf", "a.urdf"):
        code, found, _ = check(name, "nothing of the kind: [")
        assert code == 1 and [finding["severity"] for finding in found["findings"]].count("error") == 1
    assert main(["check", str(tmp_path / "absent.urdf")]) == 1
    assert "absent.urdf" in capsys.readouterr().out


def test_an_rmpflow_configuration_is_not_taken_for_a_robots_description(check):
    code, found, said = check("arm_rmpflow.yaml", "joint_limit_buffers: [0.01]\nrmp_params:\n  damping_rmp: {}\n")
    assert code == 1 and found is None and "--rmpflow" in said
