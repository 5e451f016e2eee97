"""Writes the built-in Panda's spheres as plain numbers: after every change of its file, or of how covers are found.

python -m jaxrmp.world._make_panda_cover
"""

import json

from ..kinematics import panda
from ._own_spheres import carried_by, found_spheres
from ._panda_cover import PANDA_COVER, Cover, cover_to_dict
from ._self_pairs import found_ignored, link_of


def found_cover() -> Cover:
    """The cover of the built-in Panda as it is found from its file."""
    robot = panda()
    links = {link_of(robot, "panda_hand")}
    whole, fine = found_spheres(robot), found_spheres(robot, links)
    carried = carried_by(robot, links, fine.frames)
    return Cover(whole, fine.rows([i for i, name in enumerate(fine.frames) if name in carried]), found_ignored(robot))


if __name__ == "__main__":
    content = cover_to_dict(found_cover())
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in content.items()]
    PANDA_COVER.write_text("{\n" + ",\n".join(lines).replace("], ", "],\n  ") + "\n}\n", encoding="utf-8")
