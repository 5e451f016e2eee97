"""What a newcomer waits for: cold compilation of a reaching policy for an arm, and the page of `jaxrmp view`.

Arms are the built-in Panda and those of `robots` that are at hand; the policy is that of `policies.reaching_policy`, in
front of a ball: pose, obstacle, self-avoidance, limits. Every figure is of a fresh process with nothing compiled, but
for the page's second one, which finds what the first one kept. The machine has to be quiet.
"""

import signal
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from ._children import in_child
from ._page import Page, launch, served
from .robots import FOLDER, ROBOTS

_ARMS = ("UR10", "xArm7", "Kinova")


def rows() -> list[dict[str, Any]]:
    """One a policy and way of compiling, and two of the page."""
    files = {name: str(FOLDER / ROBOTS[name].file) for name in _ARMS}
    arms = {"Panda": "", **{name: file for name, file in files.items() if Path(file).is_file()}}
    found = []
    for name, file in arms.items():
        with tempfile.TemporaryDirectory() as empty:  # of what C compilers make, and of covers
            own = {"JAX_ENABLE_COMPILATION_CACHE": "false", "JAXRMP_CACHE": empty}
            found += in_child("benchmarks.waits:compiled", name, file, **own)
    with tempfile.TemporaryDirectory() as empty:
        found += [{"name": f"page of the Panda, {state}", **page(Path(empty))} for state in ("cold", "warm")]
    return found


def compiled(name: str, file: str) -> list[dict[str, Any]]:
    """Seconds until XLA has compiled the policy, a batch of 64 of it, and the gradient of 100 steps with it."""
    import jax
    import jax.numpy as jnp

    from jaxrmp import acceleration, policies
    from jaxrmp.kinematics import forward_kinematics, hand_frame, load_robot, panda
    from jaxrmp.simulation import rollout
    from jaxrmp.world import Spheres, World

    begun = time.perf_counter()
    robot = load_robot(file) if file else panda()
    hand = hand_frame(robot)
    policy = policies.reaching_policy(robot, hand)
    made = time.perf_counter() - begun
    q = jnp.asarray(0.5 * (np.clip(robot.lower, -3, 3) + np.clip(robot.upper, -3, 3)), jnp.float32)
    goal = jnp.asarray(forward_kinematics(robot, q, hand), jnp.float32)
    world = World(spheres=Spheres.of([((0.4, 0.15, 0.35), 0.06)], capacity=4))

    def asked(q, qd, goal):
        return acceleration(policy.tree(goal, world), q, qd)

    def end(goal):
        return jnp.sum(rollout(policy.tree(goal, world), q, duration=0.1, dt=0.001).q[-1])

    many = jnp.tile(q, (64, 1))
    ways = {
        "jit": (jax.jit(asked), (q, 0 * q, goal)),
        "vmap of 64": (jax.jit(jax.vmap(asked, (0, 0, None))), (many, 0 * many, goal)),
        "gradient of 100 steps": (jax.jit(jax.grad(end)), (goal,)),
    }
    found = []
    for way, (function, arguments) in ways.items():
        begun = time.perf_counter()
        function.lower(*arguments).compile()
        found.append({"name": f"{name}, {way}", "compile_s": time.perf_counter() - begun, "made_s": made})
    return found


def page(folder: Path) -> dict[str, Any]:
    """Seconds from `jaxrmp view` until its page moves when its goal is dragged; what it compiled is in `folder`."""
    caches = {"JAX_COMPILATION_CACHE_DIR": str(folder / "compiled"), "JAXRMP_CACHE": str(folder / "own")}
    with launch() as browser:
        begun = time.monotonic()
        with served((), caches, folder / "said.txt") as view:
            up = time.monotonic() - begun
            shown = Page(browser, view.url)
            hand, goal = f"/arm/{view.hand}", "/target"
            start, T = shown.nodes[hand][:3, 3].copy(), shown.nodes[goal].copy()
            T[2, 3] -= 0.1
            shown.drag(goal, T)
            shown.wait(lambda: np.linalg.norm(shown.nodes[hand][:3, 3] - start) > 1e-3, "the arm to move", 60)
            moved = time.monotonic() - begun
            shown.close()
            view.process.send_signal(signal.SIGINT)
            view.process.wait(timeout=60)
    return {"command_s": up, "moves_s": moved}
