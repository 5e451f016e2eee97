"""The arguments of every command. Imports none of the modules that do the work, so that help comes at once."""

import argparse
from pathlib import Path
from typing import Any

from .. import __version__
from ..scenes import SCENES

EXIT_CODES = "exit codes: 0 done, 1 error (explained), 2 wrong usage; ended: 129, 130, 143"
TASKS = ("drawer_closing", "door_reaching")
_SCENE = f"{', '.join(SCENES)}, or your own: FILE.py or FILE.py:FUNCTION"
_DEMOS = "demonstrations, a folder or a file, or synthetic:TASK; default "
_LEARNED_FROM = _DEMOS + "those it was learned from"
_SKILL = "skill file written by jaxrmp learn"
_MOVED = "robot file, if it is no longer where the skill was learned"
_DRAWER = "out/drawer_closing/drawer_closing.skill.npz"
# By what stands for the value of an argument; a default's own type comes first.
_TYPES = dict(K=int, N=int, I=int, INDEX=int, RAD=float, HZ=float, FILE=Path, DIR=Path, OUT=Path)


def _argument(name: str, help: str, default: Any = None, **settings: Any) -> tuple[str, dict[str, Any]]:
    """An argument `NAME`, `--name VALUE`, or, where nothing stands for its value, a switch; help tells the default."""
    flag, _, value = name.partition(" ")
    if not flag.startswith("--"):
        flag, value = flag.lower(), flag
    if not value and "choices" not in settings:
        return flag, {"action": "store_true", "help": help}
    if default is not None and "default" not in help:
        help += f", default {default if isinstance(default, str) else format(default, 'g')}"
    kind = _TYPES.get(value, str) if default is None else type(default)
    return flag, {"metavar": value or None, "type": kind, "default": default, "help": help, **settings}


_PAGE = (
    _argument("--port P", "of the page; default 8080, 0 for any", 8080),
    _argument("--host ADDRESS", "to listen at; any but this machine's own needs --password", "127.0.0.1"),
    _argument(
        "--password WORD", "ask for it before the page is shown (8 characters at least; not encrypted)", type=str
    ),
    _argument("--until-closed", "end when the page is closed, not by Ctrl-C only"),
)
_RECORDED = (
    _argument(
        "--units UNITS",
        "of the demonstrations, where they do not say: rad, degrees or normalised; of poses m, cm or mm",
        type=str,
    ),
    _argument("--group NAME", "which of several groups of joints: a feature, topic or dataset", type=str),
    _argument("--rate HZ", "samples a second, where the demonstrations do not say", type=float),
    _argument("--quaternion ORDER", "of poses, where they do not say: wxyz or xyzw", type=str),
)
_ARM = (
    _argument("--host ADDRESS", "of a Franka", type=str),
    _argument(
        "--realtime",
        "scheduling: enforce, as an arm needs, or ignore, for simulators",
        "enforce",
        choices=("enforce", "ignore"),
    ),
    _argument("--recover", "let the arm leave the state that an error left it in, first"),
    _argument("--tracker udp:[HOST:]PORT", "where poses of the object come to, as datagrams of JSON", type=str),
)
_CAMERA = (
    _argument(
        "--camera",
        "the policy knows of the object what a camera overhead sees of it: depth, as a Kinect's, instead of a tracker",
        choices=("depth",),
    ),
    _argument("--camera-distance M", "from what the object's joint moves, default 1", type=float),
    _argument("--camera-at X,Y,Z", "where it stands, m, instead of where the arm hides least", type=str),
)
_FIX = _argument("--fix PATTERN", "lock joints, such as '*_finger_*' or elbow=0.5; may be given again", action="append")
# Of each command: what it does, in a few words and in more, an example, and its arguments.
_COMMANDS: dict[str, tuple[str, str, str, list[tuple[str, dict[str, Any]]]]] = {
    "learn": (
        "learn a skill from demonstrations",
        "Learn a skill; write it with its report and pictures. Every key of the configuration can be given "
        "after CONFIG as --KEY VALUE, sections with dots.",
        "configs/drawer_closing.toml --out out/drawer --metric.updates 500",
        [
            _argument(
                "CONFIG", "TOML configuration, or the name of an example: drawer_closing, door_reaching, openbox"
            ),
            _argument(
                "--demos DIR", _DEMOS + "$JAXRMP_DATA/franka/NAME or poses/NAME.npz if set, else synthetic", type=str
            ),
            *_RECORDED,
            _argument("--out DIR", "output folder, default out/NAME"),
            _argument("--validate", "learn with each demonstration left out in turn too, and reproduce that one"),
            _argument("--groups", "learn one skill of each family of demonstrations that part, in OUT/group_0, ..."),
            _argument("--json FILE", "write the report here as well, with the skill's file"),
        ],
    ),
    "reproduce": (
        "roll a skill out from each demonstration's start and measure it",
        "Kinematic rollouts of the whole policy from each demonstration's first configuration, compared "
        "with that demonstration: DTW, discrete Frechet and final distance of control points in the object's frame.",
        f"{_DRAWER} --json errors.json",
        [
            _argument("SKILL", _SKILL),
            _argument("--demos DIR", _LEARNED_FROM, type=str),
            _argument("--robot FILE", _MOVED, type=str),
            _argument("--json FILE", "write the errors as JSON"),
            _argument("--save FILE", "write the rollouts as NPZ: time_K, q_K, qd_K"),
            _argument("--figures DIR", "draw the reproductions"),
            _argument(
                "--targets",
                "where the subtasks end: where each demonstration ended (default), or the skill's mean",
                "own",
                choices=("own", "skill"),
            ),
            _argument("--duration S", "of rollouts, by default three times the longest way's, at least 20", type=float),
            _argument("--dt S", "seconds a step", 0.005),
        ],
    ),
    "run": (
        "run a skill or a sequence in physics",
        "Trials in MuJoCo at 1 kHz with contacts and torque limits: first from every demonstration's "
        "start, then with seeded variations of them. What varies and what success is, the scene says: the drawer "
        "closed to 5 mm; the hand at the standoff pose to 1 cm and 10 degrees, nothing touched. Of a sequence: its "
        "states one after the other in one simulation, how each ended, and its energy.",
        f"{_DRAWER} --scene drawer --video out/drawer.mp4",
        [
            _argument("SKILL", _SKILL + ", or a sequence, FILE.toml"),
            _argument("--scene SCENE", _SCENE, required=True),
            _argument("--trials N", "how many trials, default 6, of a sequence 1"),
            _argument("--trial K", "run trial K of these alone: replays it"),
            _argument("--displace", "move the object by 10 cm during execution"),
            _argument("--demos DIR", _LEARNED_FROM, type=str),
            _argument("--json FILE", "write the outcomes as JSON, and their page beside it"),
            _argument("--html FILE", "write the page, default beside --json"),
            _argument("--video FILE", "film the first three trials: .mp4 or .gif"),
            _argument("--figures DIR", "draw the trials"),
            _argument("--seed S", "random seed", 0),
            _argument("--limit S", "seconds a trial may take", 30.0),
            _argument("--strict", "exit with 1 if a trial fails or diverges"),
            _argument("--interface", "of the arm", "torque", choices=("torque", "velocity", "position")),
            _argument(
                "--detour",
                "look ahead for a way round the scene's obstacles before each trial, and lead the hand by it",
            ),
            _argument("--learned-rate HZ", "evaluate learned leaves this often and hold"),
            _argument(
                "--tracker",
                "30 Hz camera with the recordings' noise; auto: if the skill's object is tracked or displaced",
                "auto",
                choices=("auto", "on", "off"),
            ),
            _argument("--tracker-delay S", "seconds", 0.0),
            _argument("--tracker-dropouts P", "share of frames", 0.0),
            _argument("--tracker-bias M", "constant error, m", 0.0),
            _argument("--tracker-silent-after S", "when it goes silent, default never", float("inf")),
            *_CAMERA,
        ],
    ),
    "evaluate": (
        "roll a skill out from thousands of starts and judge it",
        "Rollouts of the whole policy from many initial configurations, all at once: how each ends, rest "
        "points away from the goal, energy, clearance, joint limits, and stability as mathematics.",
        f"{_DRAWER} --starts 4096 --json report.json",
        [
            _argument("SKILL", _SKILL),
            _argument("--starts N", "how many starts", 4096),
            _argument("--seed S", "random seed of the starts", 0),
            _argument("--margin RAD", "distance of starts from joint limits", 0.05),
            _argument("--around RAD", "start within RAD of demonstrated starts, not all over the range"),
            _argument("--demos DIR", "for --around: " + _LEARNED_FROM, type=str),
            _argument("--start-file FILE", "NPY file of starts [N, n] instead"),
            _argument(
                "--physics",
                "what moves the joints: the policy itself (default), native MuJoCo, or MJX",
                "kinematic",
                choices=("kinematic", "mujoco", "mjx"),
            ),
            _argument("--scene SCENE", _SCENE + "; default the arm alone"),
            _argument("--robot FILE", _MOVED, type=str),
            _argument("--dt S", "seconds a step", 0.001),
            _argument("--duration S", "seconds until a rollout is given up", 120.0),
            _argument("--tolerance M", "distance from the targets that counts", 0.01),
            _argument("--batch N", "starts at a time", 1024),
            _argument("--json FILE", "write the report as JSON, and its page beside it"),
            _argument("--resume", "go on with an evaluation to this --json that was cut short"),
            _argument("--html FILE", "write the page, default beside --json"),
            _argument("--strict", "exit code 1 if any start fails or diverges"),
            _argument("--replay INDEX", "roll out from this one start again and say how"),
            _argument("--save FILE", "write every start and end as NPZ; with --replay its states on the way"),
            _argument("--devices N", "use N virtual devices on a CPU, such as its cores"),
            _argument("--processes N", "share the starts among N processes", 1),
            _argument("--process I", "be number I of them (else all are started here)"),
            _argument("--coordinator HOST:PORT", "with --process: where process 0 listens"),
        ],
    ),
    "demonstrate": (
        "write synthetic demonstrations to a folder",
        "Write demonstrations of the scripted demonstrator, in the layout that jaxrmp learn --demos reads.",
        "drawer_closing out/demonstrations",
        [
            _argument("TASK", " or ".join(TASKS)),
            _argument("OUT", "folder to write to"),
            _argument("--count N", "how many demonstrations", 6),
            _argument("--seed S", "random seed", 0),
            _argument("--overwrite", "replace demonstrations that are there"),
        ],
    ),
    "export": (
        "write a skill as a file that other programs run",
        "The whole policy of a skill on its robot. As one C99 file and its header, with nothing beside them: no "
        "allocation, no state, a fixed number of steps; with them a CMakeLists.txt, a program that runs it at 1 kHz "
        "and an example in C++. Or as StableHLO, in single precision and without obstacles, run by "
        "jax.export.deserialize(content).call where jax and flatbuffers are installed.",
        f"{_DRAWER} --c out/drawer_c",
        [
            _argument("SKILL", _SKILL),
            _argument("--c DIR", "folder to write C to"),
            _argument("--stablehlo FILE", "write the program of StableHLO here"),
            _argument("--precision", "of the numbers in C", "float", choices=("float", "double")),
            _argument("--obstacles N", "in C, slots for spheres that the arm keeps off", 0),
            _argument("--while-count N", "in C, steps that a loop without a fixed number may take at most", type=int),
            _argument("--certificate", "in C, give the energy V and its dissipation, too"),
            _argument("--robot FILE", _MOVED, type=str),
            _argument("--demos DIR", "where the C program starts: " + _LEARNED_FROM, type=str),
        ],
    ),
    "drive": (
        "drive an arm by a skill",
        "A skill on an arm: a Franka over its network interface, or one in a scene of MuJoCo, cycle by cycle, within "
        "its limits, watched, and stopped when something is wrong. It starts only near a stated posture. Exit code 0 "
        "if it came to rest at the goal.",
        f"{_DRAWER} --robot franka --host 172.16.0.2 --speed 0.3 --go --log out/drives",
        [
            _argument("SKILL", _SKILL),
            _argument("--robot", "which arm: franka or mujoco", required=True, choices=("franka", "mujoco")),
            *_ARM,
            _argument("--scene SCENE", "for mujoco: " + _SCENE + "; default the arm alone"),
            _argument(
                "--start Q", "where it must start: joint positions with commas between, or K, as demonstration K", "0"
            ),
            _argument("--at Q", "for mujoco: where the arm is at first, default at the start", type=str),
            _argument("--near RAD", "how near every joint must be to the start", 0.1),
            _argument(
                "--go", "take the arm to the start first, slowly, off itself; it knows nothing of what stands around"
            ),
            _argument("--speed S", "times the policy's own", 1.0),
            _argument("--interface", "of the arm", "velocity", choices=("velocity", "torque")),
            _argument("--object-still", "the skill's object is not tracked, but stands where it was demonstrated"),
            _argument("--keep S", "how old the tracker's last pose may be, seconds", 0.5),
            _argument("--late S", "how late a cycle may come, default 0.01 s, for mujoco 0.2", type=float),
            _argument("--obstacles N", "slots for spheres that the tracker tells", 0),
            _argument("--duration S", "seconds until it is stopped", 60.0),
            _argument("--tolerance M", "distance from the goal that counts, m", 0.01),
            _argument("--dry-run", "print what would be sent from where the arm is, and send nothing"),
            _argument("--demos DIR", _LEARNED_FROM, type=str),
            _argument("--log DIR", "add every cycle to this folder as its next demo_K.npz, and as MCAP"),
            _argument("--json FILE", "write how it went as JSON"),
        ],
    ),
    "record": (
        "record demonstrations on an arm guided by hand",
        "Joint positions of a Franka that somebody guides, into a folder that jaxrmp learn --demos takes. Enter begins "
        "and ends a demonstration.",
        "--robot franka --host 172.16.0.2 --out out/cup",
        [
            _argument("--robot", "which arm", "franka", choices=("franka",)),
            *_ARM,
            _argument("--out DIR", "folder to add demonstrations to", required=True),
            _argument("--model FILE", "the arm's kinematics: panda, or an MJCF, URDF or TOML robot file", "panda"),
            _argument("--rate HZ", "samples a second", 100.0),
            _argument("--object NAME", "what the tracker tracks", type=str),
            _argument("--seconds S", "record one demonstration of so many seconds, without a terminal", type=float),
            _argument("--stdin", "take lines from a pipe in place of a terminal"),
        ],
    ),
    "calibrate": (
        "find where a depth camera is, by the robot that it saw",
        "Of depth images of a robot in several postures with known joints: the pose of the camera in the world of the "
        "robot's model, from a rough guess. Written as TOML, which jaxrmp track takes as --camera, or into a copy of "
        "the frames. Exit code 1 if the robot is not seen, or its postures do not fix the pose.",
        "postures.npz --robot ur5.urdf --guess 1.0,0.2,0.9,-2.1,0.0,1.6 --out camera.toml",
        [
            _argument("FRAMES", "NPZ of depth images, with the robot's joints: docs/guides/depth_camera.md", type=Path),
            _argument(
                "--robot FILE", "panda, or an MJCF, URDF or TOML robot file with its geometry", required=True, type=str
            ),
            _argument(
                "--guess POSE", "of the camera: x,y,z,roll,pitch,yaw or a file; default the frames' own", type=str
            ),
            _argument("--postures N", "images to use, as different as there are", 10),
            _argument("--collision", "the robot looks as its collision geometry, not as its visual one"),
            _argument("--out FILE", "write the pose: .toml, or .npz, the frames with it", required=True),
        ],
    ),
    "track": (
        "follow an object in recorded depth images",
        "The pose and the joints of an object, of simple shapes or meshes, in each image of a file.",
        "frames.npz --object cabinet.xml:cabinet --guess 0.6,0,0.4,0,0,3.1 --robot ur5.urdf --out estimates.npz",
        [
            _argument("FRAMES", "NPZ of depth images: docs/guides/depth_camera.md", type=Path),
            _argument("--object FILE", "MJCF or URDF of the object, or FILE:BODY", required=True, type=str),
            _argument(
                "--guess POSE",
                "of the object's base, within 5 cm and 15 degrees: x,y,z,roll,pitch,yaw, m and rad, or a file",
                required=True,
                type=str,
            ),
            _argument("--joints Q", "the object's joints at first, with commas between, default 0", type=str),
            _argument("--robot FILE", "panda, or a robot file: what it hides is not looked at", type=str),
            _argument("--camera FILE", "where the camera is, by jaxrmp calibrate; default the frames' own", type=str),
            _argument("--out FILE", "write the estimates: .npz or .csv", required=True),
        ],
    ),
    "view": (
        "watch a policy run live in the browser, drag and push it",
        "A page on this machine, with the policy running at 1 kHz in it: drag its goal, its object and "
        "obstacles, push the arm, turn gains, switch leaves off, watch its energy. With SKILL a learned one, without a "
        "hand-designed one. Ctrl-C ends it.",
        f"{_DRAWER} --scene drawer",
        [
            _argument("SKILL", "skill file; default a hand-designed policy", nargs="?"),
            _argument(
                "--robot FILE", "robot file (MJCF, URDF, TOML), default the Panda, or the skill's robot", type=str
            ),
            _argument("--frame FRAME", "without SKILL: the frame that is taken to the goal"),
            _FIX,
            _argument("--scene SCENE", "furniture around the skill: " + _SCENE),
            *_CAMERA,
            _argument("--demos DIR", _LEARNED_FROM, type=str),
            _argument(
                "--replay FILE", "play a demo_K.npz first, such as a log of jaxrmp drive; the policy takes over then"
            ),
            _argument(
                "--balls N",
                "obstacles at first, of the three that there can be: default 1, in a scene none yet; 0: none at all",
                choices=(0, 1, 2, 3),
            ),
            _argument("--gains FILE", "begin with the gains of this TOML file, as the page saves them"),
            *_PAGE,
        ],
    ),
    "teach": (
        "demonstrate in the browser, with no robot at hand",
        "A page on this machine on which the robot's hand is dragged: record, replay, discard, mark the "
        "target, and save a set that jaxrmp learn takes, with a configuration beside it. Ctrl-C ends it.",
        "--robot panda --out out/cup",
        [
            _argument("--robot FILE", "panda (default), or an MJCF, URDF or TOML robot file", "panda"),
            _argument("--frame FRAME", "the frame that is dragged, default the hand"),
            _FIX,
            _argument("--out DIR", "folder to save demonstrations to", required=True),
            _argument("--overwrite", "replace demonstrations that are there"),
            *_PAGE,
        ],
    ),
    "check": (
        "say what is read of a file, and what looks wrong",
        "Of a robot (MJCF, URDF), demonstrations, a configuration, a skill or an XRDF: its facts as a "
        "table, what is left out of it and why, and what looks wrong. Exit code 1 if anything of it is unsafe.",
        "robot.urdf --json check.json",
        [
            _argument("FILE", "the file, or the folder", type=Path),
            _argument("--robot FILE", "of demonstrations, a sequence or XRDF: its robot", type=str),
            _argument("--demos DIR", "of a configuration: demonstrations to check with it", type=str),
            *_RECORDED,
            _argument("--rmpflow FILE", "of an XRDF: the RMPflow configuration beside it"),
            _argument("--json FILE", "write the same as JSON; what could not be checked is null"),
        ],
    ),
    "completion": (
        "print a script that makes a shell complete all this",
        "Print a script that completes commands, options and their values in a shell.",
        "bash > ~/.local/share/bash-completion/completions/jaxrmp",
        [
            _argument("SHELL", "bash, zsh or fish", choices=("bash", "zsh", "fish")),
        ],
    ),
}


def build_parser() -> argparse.ArgumentParser:
    """The parser of `jaxrmp`; `command` is the name of the module in this package whose `run` does the work."""
    parser = argparse.ArgumentParser(
        prog="jaxrmp",
        description="Stable motion policies for robots: learn, evaluate, run, watch, export them.",
        epilog=EXIT_CODES,
    )
    parser.add_argument("--version", action="version", version=f"jaxrmp {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (help, description, example, arguments) in _COMMANDS.items():
        command = commands.add_parser(
            name, help=help, description=description, epilog=f"example: jaxrmp {name} {example}"
        )
        for flag, settings in arguments:
            command.add_argument(flag, **settings)
        command.add_argument("-q", "--quiet", action="store_true", help="show no progress, results and errors only")
    learn = commands.choices["learn"]
    learn.usage = "jaxrmp learn CONFIG [--demos DIR] [--out DIR] [--validate] [--groups] [--KEY VALUE ...]"
    learn.set_defaults(takes_overrides=True)
    return parser
