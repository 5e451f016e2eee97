"""Where the object and the obstacles are, as whatever watches them says: the newest word, and how old it is."""

import json
import socket
import time
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from .._errors import ConfigurationError, JaxrmpError
from .._task_map import check_rigid

_LARGEST = 65_536  # bytes of a datagram
_AT_ONCE = 64  # datagrams that are read in one cycle
_NOT_READ = (ValueError, TypeError, OverflowError, RecursionError, JaxrmpError)


class Sighting(NamedTuple):
    """`T_world_object` [4, 4]; `obstacles` [M, 4], spheres as centre and radius, m; `age`, s, since it was seen, zero
    for what does not change; `number`, of the last word, which tells one from the next."""

    T_world_object: np.ndarray
    obstacles: np.ndarray
    age: float
    number: int


class Sightings(Protocol):
    """What watches the object: asked in every cycle, so it never waits."""

    def newest(self) -> Sighting:
        """The last word there is."""
        ...

    def close(self) -> None:
        """Let go of what it listens to."""
        ...


class Fixed:
    """An object that nobody watches and that stays at `T_world_object` [4, 4], with `obstacles` [M, 4] or none."""

    def __init__(self, T_world_object: Any, obstacles: Any = ()):
        spheres = np.asarray(obstacles, float).reshape(-1, 4)
        self._sighting = Sighting(check_rigid(np.asarray(T_world_object, float)), spheres, 0.0, 0)

    def newest(self) -> Sighting:
        """Always the same."""
        return self._sighting

    def close(self) -> None:
        """Nothing to let go of."""


class UdpSightings:
    """Datagrams of JSON: `{"T_world_object": [[...], [...], [...], [...]], "obstacles": [[x, y, z, radius], ...]}`.

    Either may be left out, and stays as it was, ageing; `"age"`, s, how old it was as it was sent. The age of a
    sighting is that of the older of the two, once obstacles were told. The world is that of the
    robot's model. Until the first one arrives, nothing is known: `wait`. What cannot be read is passed over, counted in
    `unread`, and `why` says what was wrong with the last one.

    **Arguments**: `address`, host and port to listen at, the port 0 for any; `obstacles`, how many there may be.
    **Raises** `ConfigurationError` for an address that cannot be had.
    """

    def __init__(self, address: tuple[str, int], obstacles: int = 0):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind(address)
        except (OSError, OverflowError) as error:
            self._socket.close()
            raise ConfigurationError(f"cannot listen at {address[0]}:{address[1]} (UDP): {error}.") from error
        self.port: int = self._socket.getsockname()[1]
        self.unread, self.why = 0, ""
        self._most = obstacles
        self._T: np.ndarray | None = None
        self._obstacles = np.zeros((0, 4))
        self._seen, self._number = 0.0, 0
        self._obstacles_seen: float | None = None

    def wait(self, seconds: float, running: Callable[[], bool] = lambda: True) -> None:
        """Return as the first pose is there, or once `running` says no. **Raises** `ConfigurationError` if none comes
        in so many `seconds`."""
        until = time.perf_counter() + seconds
        while running():
            self._take()
            if self._T is not None:
                return
            if time.perf_counter() > until:
                detail = f" {self.unread} datagrams could not be read: {self.why}" if self.unread else ""
                raise ConfigurationError(
                    f"no pose of the object came to UDP port {self.port} within {seconds:g} s.{detail} Start what "
                    'sends it: a JSON object {"T_world_object": four rows of four numbers} in each datagram.'
                )
            time.sleep(0.002)

    def newest(self) -> Sighting:
        """The last datagram's, if it could be read."""
        self._take()
        if self._T is None:
            raise ConfigurationError("no pose of the object has come: call `wait` first.")
        oldest = self._seen if self._obstacles_seen is None else min(self._seen, self._obstacles_seen)
        return Sighting(self._T, self._obstacles, time.perf_counter() - oldest, self._number)

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()

    def _take(self) -> None:
        for _ in range(_AT_ONCE):
            try:
                content = self._socket.recv(_LARGEST)
            except BlockingIOError:
                return
            try:
                T, obstacles, age = self._read(content)
            except _NOT_READ as error:
                self.unread, self.why = self.unread + 1, str(error)[:200]
                continue
            seen = time.perf_counter() - age
            if T is not None:
                self._T, self._seen = T, seen
            if obstacles is not None:
                self._obstacles, self._obstacles_seen = obstacles, seen
            self._number += 1

    def _read(self, content: bytes) -> tuple[np.ndarray | None, np.ndarray | None, float]:
        said = json.loads(content)
        if not isinstance(said, dict):
            raise ValueError("expected a JSON object")
        if unknown := sorted(set(said) - {"T_world_object", "obstacles", "age"}):
            raise ValueError(f"{unknown} are unknown; T_world_object, obstacles and age are known")
        T = obstacles = None
        if "T_world_object" in said:
            T = np.asarray(said["T_world_object"], float)
            T = check_rigid(T.reshape(4, 4) if T.size == 16 else T)
        if "obstacles" in said:
            obstacles = np.asarray(said["obstacles"], float).reshape(-1, 4)
            if not np.isfinite(obstacles).all() or (obstacles[:, 3] < 0).any():
                raise ValueError("an obstacle is not finite, or has a negative radius")
            if len(obstacles) > self._most:
                raise ValueError(f"{len(obstacles)} obstacles came, and there are slots for {self._most}")
        age = float(said.get("age", 0.0))
        if not 0 <= age < np.inf:
            raise ValueError(f"age is {age}, expected seconds")
        return T, obstacles, age
