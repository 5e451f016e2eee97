"""A page with a live arm on it: the server, the policy's loop, what is drawn, and what can be changed."""

import threading
import time
from collections import deque
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import JaxrmpError
from .._pytree import single
from ..simulation import Motion
from ..world import World
from ._arm import ArmView
from ._claims import AVOIDS, avoidance_words, banners, energy_words, lacking
from ._depth import DepthView
from ._furniture import FurnitureView, camera_of
from ._gain_file import place_for_gains, save_gains
from ._goal import GoalNumbers, Resting, goal_words
from ._inputs import GainSliders, LeafSwitches
from ._lines import Trace
from ._live import Look, Situation, examine
from ._loop import Frame, LiveLoop
from ._obstacles import ObstacleGizmos, at_first
from ._plots import Plots
from ._poses import place, pose_of
from ._push import Push
from ._push_gizmo import PushGizmo
from ._server import Access, open_server
from ._switched import switches

_LOOKS = 0.25  # seconds from one look at the leaves to the next
_FAR = 0.5  # m, beyond which a distance is no news


class Content(NamedTuple):
    """What a session is about. `policy`, with `robot` and `tree(T_world_target, world)`; `T_world_target` [4, 4] and
    `target`, what it is called; `world`, whose capsules can be dragged; `q` [n], where the arm starts; `hand`, its last
    frame; `furniture`, a `scenes.Scene` or None; `balls` [N, 3], places of obstacles that can be dragged and changed,
    how many of them are `shown` at first; `frames`, more of the robot's to be drawn; `hints`, of the first leaves,
    beside their names; `camera`, a function without arguments, within whose result there is a
    `perception.DepthTracker` over the furniture, by which alone the policy knows where the object is, and
    `camera_spheres`, which hold the robot as the camera sees it."""

    policy: Any
    T_world_target: np.ndarray
    target: str
    world: World
    q: np.ndarray
    hand: str
    furniture: Any = None
    balls: np.ndarray = np.zeros((0, 3))
    shown: int = 0
    frames: tuple[str, ...] = ()
    hints: tuple[str, ...] = ()
    camera: Any = None
    camera_spheres: Any = None


class Session:
    """A viser page and the policy that it shows, both running from `start` to `stop`.

    `drawn` counts the frames that the page was told of.

    **Arguments**: `content`; `port`, 0 for any that is free; `label`, the page's; `folder`, the name of a folder above
    the tabs, to be filled by who asks for it; `access`, who may see it, by default this machine alone.
    **Raises** `ConfigurationError` for a port that cannot be had, `MissingDependencyError` without viser.
    """

    def __init__(self, content: Content, port: int, label: str, folder: str = "", access: Access | None = None):
        self.content, self.access = content, access or Access()
        self._opened_server = open_server(port, label, self.access)
        self.server = server = self._opened_server.server
        self.drawn = 0
        self._end, self._threads = threading.Event(), list[threading.Thread]()
        self._opened = threading.Event()  # whether there ever was a page
        server.on_client_connect(lambda _: self._opened.set())
        self._failure: BaseException | None = None
        self._said = "leaves and distances: not checked yet"  # of the goal and of what is avoided
        self._resting = Resting()
        try:
            self._build(server, folder)
        except BaseException:
            self._opened_server.stop()
            raise

    def _build(self, server: Any, folder: str) -> None:
        content = self.content
        server.gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        server.scene.configure_default_lights(cast_shadow=False)  # without a graphics card, five times the pictures
        server.scene.add_grid("/floor", width=4.0, height=4.0, cell_size=0.1, section_size=0.5, plane="xy")
        server.scene.world_axes.visible = False
        server.scene.set_up_direction("+z")
        eye, looked_at = (1.35, -1.15, 0.95), (0.25, 0.0, 0.35)
        if content.furniture is not None:
            eye, looked_at = camera_of(content.furniture)
        server.initial_camera.position, server.initial_camera.look_at = eye, looked_at
        policy = single(content.policy)
        spheres = getattr(policy, "spheres", None)
        world = at_first(content.balls, content.world)
        names = switches(policy.tree(content.T_world_target, single(world)))
        self.arm = ArmView(server, policy.robot, spheres, (content.hand, *content.frames))
        self.target = server.scene.add_transform_controls("/target", scale=0.22, line_width=3.0, depth_test=False)
        place(self.target, content.T_world_target)
        self.furniture = FurnitureView(server, content.furniture) if content.furniture is not None else None
        self.trace = Trace(server)
        self.status = server.gui.add_markdown("compiling the policy ...")
        looks = [f"The arm is {self.arm.note}"] if self.arm.note else []
        offered = ("to obstacles",) if world.size else ()
        self._wanted = (*offered, "to itself")
        told = looks + banners(names, offered, spheres is not None)
        if content.furniture is not None and not content.world.size:
            told.append("The policy is not told of the furniture: nothing keeps it off, and its distance is for you.")
        self.notes = [server.gui.add_markdown(f"**{note}**") for note in told]
        self.play = server.gui.add_button("Pause", icon="player-pause")
        self.reset = server.gui.add_button("Reset", icon="player-skip-back")
        self.speed = server.gui.add_slider("speed", 0.1, 4.0, step=0.1, initial_value=1.0)
        self.folder = server.gui.add_folder(folder) if folder else None
        tabs = server.gui.add_tab_group()
        with tabs.add_tab("Scene"):
            self.goal = GoalNumbers(server, self.target, content.target)
            self.shown = self._show_controls(server)
            self.depth = None
            if content.camera is not None:
                with server.gui.add_folder("Depth camera"):
                    given = content.furniture, content.camera, content.camera_spheres
                    self.depth = DepthView(server, *given, lambda: (self.loop.q, pose_of(self.target)))
            with server.gui.add_folder("Push the arm"):
                self.push = PushGizmo(server, np.zeros(3))
            self.obstacles = None
            if world.size:
                with server.gui.add_folder("Obstacles"):
                    self.obstacles = ObstacleGizmos(server, content.balls, content.shown, content.world)
        with tabs.add_tab("Gains"):
            self.gains = GainSliders(server, policy)
            self._gain_controls(server)
        with tabs.add_tab("Leaves"):
            server.gui.add_markdown("A leaf switched off counts for nothing, in force and in energy.")
            self.switches = LeafSwitches(server, names, content.hints)
        missing = lacking(names, self._wanted)
        self._distances = tuple(what for what in self._wanted if what not in missing)
        self._distances += ("to furniture",) if content.furniture is not None and content.furniture.keeps_off else ()
        self.plots = Plots(server, names, self._distances)
        self._kept = _Kept()
        self.loop = LiveLoop(self.read, content.q, self.arm.frames, content.hand, self.on_frame, self.notify)

        @self.play.on_click
        async def _(_: Any) -> None:
            self.set_playing(not self.loop.playing)

        @self.reset.on_click
        async def _(_: Any) -> None:
            self.restart()

    def _show_controls(self, server: Any) -> dict[str, Any]:
        boxes = {"hand's trace": True}
        boxes |= {"collision spheres": False} if getattr(self.content.policy, "spheres", None) is not None else {}
        return {name: server.gui.add_checkbox(name, value) for name, value in boxes.items()}

    @property
    def url(self) -> str:
        """Where the page is."""
        return f"http://{self.access.name}:{self._opened_server.port}"

    def start(self) -> None:
        """Compile the policy and begin to run and draw it."""
        if self.depth is not None:
            self.depth.start()
        looking = threading.Thread(target=self._guarded, args=(self._look,), name="_look", daemon=True)
        self._first = self.read()
        looking.start()  # two programs, on two cores; the arm moves as soon as its own is there
        self._threads.append(looking)
        self.loop.prepare()
        if self.depth is not None:
            self.depth.ready.wait()
            if self.depth.failure is not None:
                raise self.depth.failure
        self.loop.start()
        drawing = threading.Thread(target=self._guarded, args=(self._draw,), name="_draw", daemon=True)
        drawing.start()
        self._threads.append(drawing)

    def stop(self) -> None:
        """End it all; the page shows that it is gone."""
        self._end.set()
        self.loop.stop()
        if self.depth is not None:
            self.depth.stop()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(timeout=60.0)  # one that compiles cannot be ended sooner
        self._opened_server.stop()

    def wait(self, until_closed: bool = False) -> None:
        """Return when the session has ended: by `stop`, or, if `until_closed`, three seconds after the last page was
        closed. **Raises** what ended it otherwise."""
        last_seen = time.monotonic()
        while not self._end.wait(0.2):
            failure = self._failure or self.loop.failure or (self.depth and self.depth.failure)
            if failure is not None:
                raise failure
            if self.server.get_clients():
                last_seen = time.monotonic()
            elif until_closed and self._opened.is_set() and time.monotonic() - last_seen > 3.0:
                return

    def set_playing(self, playing: bool) -> None:
        """Run the policy, `playing`, or hold the arm still."""
        self.loop.playing = playing
        self.play.label, self.play.icon = ("Pause", "player-pause") if playing else ("Play", "player-play")

    def restart(self) -> None:
        """The arm at rest where it started."""
        self.loop.reset(self.content.q)

    def notify(self, message: str) -> None:
        """Show `message` to the person on the page."""
        self.set_playing(self.loop.playing)
        for client in self.server.get_clients().values():
            client.add_notification("jaxrmp", message)

    def on_frame(self, frame: Frame) -> None:
        """Called with every `frame`, in the policy's thread."""

    def policy(self) -> Any:
        """The policy with its gains as they stand."""
        return self.gains.read()

    def read(self) -> Situation:
        """The situation as the page has it now. The page is read, not listened to: however fast a gizmo is dragged,
        the policy takes its newest place once a frame."""
        self.loop.speed = float(self.speed.value)
        policy = self.policy()
        T = pose_of(self.target)
        T = T if self.depth is None else self.depth.told(T)
        world = self.obstacles.read(self.loop.passed()) if self.obstacles else self.content.world
        shares, push = self.switches.read(), self.push.read()
        kept = self._kept
        return Situation(
            kept("policy", id(policy), policy),
            kept("target", T.tobytes(), T),
            kept("world", id(world), world),
            kept("shares", shares.tobytes(), shares),
            kept("push", (push[0].tobytes(), *push[1:]), Push(*push)),
        )

    def pose(self, frame: Frame, name: str) -> np.ndarray:
        """The pose [4, 4] at `frame` of the arm's drawn frame `name`."""
        return frame.poses[self.arm.frames.index(name)]

    def object_pose(self, frame: Frame) -> np.ndarray:
        """Where the object is at `frame`, [4, 4], whatever the policy was told."""
        if self.depth is not None:
            return pose_of(self.target)
        return np.asarray(frame.situation.T_world_target, float)

    def _guarded(self, work: Any) -> None:
        try:
            work()
        except BaseException as error:
            if not self._end.is_set():
                self._failure = error

    def _draw(self) -> None:
        """Put every new frame on the page."""
        number, drawn, told = -1, deque[float](), 0.0
        while not self._end.is_set():
            frame = self.loop.next_frame(number)
            if frame.number == number:
                continue
            number = frame.number
            with self.server.atomic():
                self.draw(frame)
            now = time.monotonic()
            drawn.append(now)
            self.drawn += 1
            while now - drawn[0] > 1.0:
                drawn.popleft()
            if now - told > 0.25:
                told = now
                self.status.content = self.status_text(frame, len(drawn))

    def draw(self, frame: Frame) -> None:
        """What `frame` changes on the page."""
        self.arm.move(frame.poses)
        if self.obstacles:
            self.obstacles.draw(frame.situation.world)
        hand = self.pose(frame, self.content.hand)[:3, 3]
        self.push.follow(frame.time, hand)
        if self.furniture is not None:
            self.furniture.move(self.object_pose(frame))
        if "collision spheres" in self.shown:
            self.arm.show_spheres(bool(self.shown["collision spheres"].value))
        self.trace.show(bool(self.shown["hand's trace"].value))

    def status_text(self, frame: Frame, updates: int) -> str:
        """The line at the top of the controls, at `frame`, with `updates` of the page a second."""
        rates = frame.rates
        running = f"{rates.steps:,.0f} steps/s" if self.loop.playing else "paused"
        late = f" · **{rates.lost:.1f} s given up in the last 5 s**" if rates.lost > 0.05 else ""
        return f"**{running}** · real time ×{rates.factor:.2f} · {updates} updates/s{late}\n\n{self._said}"

    def _look(self) -> None:
        """Ask the leaves what they do, a few times a second, and plot it."""
        self._examined(self._first, self.content.q, np.zeros_like(self.content.q))
        self.loop.ready.wait()
        at = time.monotonic()
        while not self._end.is_set():
            frame = self.loop.frame
            self.look(frame, self._examined(frame.situation, frame.q, frame.qd))
            at = max(at + _LOOKS, time.monotonic())
            self._end.wait(at - time.monotonic())

    def _examined(self, situation: Situation, q: np.ndarray, qd: np.ndarray) -> Look:
        q, qd = np.asarray(q, np.float32), np.asarray(qd, np.float32)
        motion = Motion(q, np.zeros_like(q), qd)
        return jax.tree.map(np.asarray, examine(situation, motion, self.content.hand, self.switches.names))

    def look(self, frame: Frame, found: Look) -> None:
        """Plot what was `found` at `frame`."""
        self.push.weight = float(found.weight) if np.isfinite(found.weight) else 1.0
        self.trace.add(self.pose(frame, self.content.hand)[:3, 3])
        watched, names, near = frame.watched, self.switches.names, {}
        gaps = dict(zip(names, found.gap.tolist(), strict=True))
        for what in self._distances:
            near[what] = gaps[AVOIDS[what]] if what in AVOIDS else self._to_furniture(frame)
        if np.isfinite((watched.energy, watched.allowed)).all():
            energies = watched.energy, watched.allowed
            self.plots.add(frame.time, energies, found.share, [min(near[what], _FAR) for what in self._distances])
        resting = self._resting.see(frame.time, frame.qd, self.loop.replaying or not self.loop.playing)
        there = self.obstacles is not None and self.obstacles.present
        avoided = tuple(what for what in self._wanted if what != "to obstacles" or there)
        shares, ignored = np.asarray(frame.situation.shares), int(found.ignored)
        lost = avoidance_words(names, avoided, shares, self.gains.values, ignored)
        goal = goal_words(float(found.goal), resting, near, not shares.all())
        goal += self.depth.by if self.depth is not None else ""
        self._said = goal + (f" · **{lost}**" if lost else "")
        energy = energy_words(found.uncertified, watched.energy, watched.violations)
        self.plots.certificate.content = energy + (f" · **{lost}**" if lost else "")

    def _to_furniture(self, frame: Frame) -> float:
        assert self.furniture is not None
        return self.furniture.clearance(frame.q, self.object_pose(frame))

    def _gain_controls(self, server: Any) -> None:
        """A name and a button, to save the gains."""
        skill = getattr(self, "skill", None)
        name = "gains" if skill is None else f"{skill.configuration.name}_gains"
        hint = "Ends in .toml" + ("." if skill is None else ", or in .npz for a copy of the skill.")
        self.gain_file = server.gui.add_text("file", f"{name}.toml", hint=hint)
        self.gain_replace = server.gui.add_checkbox("may replace a file that is there", False)
        button = server.gui.add_button("Save gains", icon="device-floppy")
        self.gain_told = server.gui.add_markdown("")

        @button.on_click
        def _(_: Any) -> None:
            try:
                place = place_for_gains(self.gain_file.value)
                self.gain_told.content = save_gains(self.gains.changed, place, skill, bool(self.gain_replace.value))
            except (JaxrmpError, OSError) as error:
                self.gain_told.content = f"**Not saved:** {error}"


class _Kept:
    """Values as single-precision JAX arrays, carried over anew only when their keys change."""

    def __init__(self):
        self._values: dict[str, tuple[Any, Any, Any]] = {}

    def __call__(self, name: str, key: Any, value: Any) -> Any:
        known = self._values.get(name)
        if known is None or known[0] != key:
            # The value too, for its identity may be the key.
            known = self._values[name] = (key, value, jax.tree.map(jnp.asarray, single(value)))
        return known[2]
