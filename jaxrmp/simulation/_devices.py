"""The devices of this process, and a batch of starts spread over them."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec


class Devices:
    """Devices that share batches of starts: the leading axis of every array is cut into equal parts, one a device.

    `devices`, by default all of this process. Starts do not depend on each other, so the devices never talk.
    """

    def __init__(self, devices: list[Any] | None = None):
        self.mesh = Mesh(np.array(jax.local_devices() if devices is None else devices), ("starts",))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Devices) and self.mesh == other.mesh

    def __hash__(self) -> int:
        return hash(self.mesh)

    @property
    def count(self) -> int:
        """How many there are; batches must be multiples of it."""
        return self.mesh.size

    def split(self, batch: Any) -> Any:
        """`batch`, a pytree of arrays [B, ...], cut along the first axis."""
        return jax.device_put(batch, NamedSharding(self.mesh, PartitionSpec("starts")))

    def copied(self, values: Any) -> Any:
        """`values`, a pytree of arrays, whole on every device; numbers in the precision of JAX."""
        return jax.device_put(jax.tree.map(np.asarray, values), NamedSharding(self.mesh, PartitionSpec()))

    def each(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """`function` of what is whole on every device, and of a split batch, its last argument: each device by itself.

        They never talk, and what is called in C is not cut into parts by XLA.
        """

        def on_each(*arguments):
            specs = (*(PartitionSpec() for _ in arguments[1:]), PartitionSpec("starts"))
            of_devices = {"in_specs": specs, "out_specs": PartitionSpec("starts"), "check_vma": False}
            return jax.shard_map(function, mesh=self.mesh, **of_devices)(*arguments)

        return on_each

    def free_memory(self) -> int | None:
        """Bytes that are free on the fullest device, its share of the machine's memory on a CPU; None if not known."""
        free = []
        for device in self.mesh.devices.flat:
            stats = device.memory_stats() if device.platform != "cpu" else None
            if stats and "bytes_limit" in stats:
                free.append(stats["bytes_limit"] - stats.get("bytes_in_use", 0))
        if free:
            return min(free)
        # What a process could still take of main memory, a container's limit included.
        try:
            with open("/proc/meminfo") as file:
                free += [1024 * int(line.split()[1]) for line in file if line.startswith("MemAvailable:")]
        except OSError:
            pass
        try:
            with open("/sys/fs/cgroup/memory.max") as limit, open("/sys/fs/cgroup/memory.current") as used:
                free.append(max(int(limit.read()) - int(used.read()), 0))
        except (OSError, ValueError):  # no such control group, or "max": no limit
            pass
        return min(free) // self.count if free else None
