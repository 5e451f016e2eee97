"""Families of demonstrations: what disagrees is found and said, what people vary is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jaxrmp import FileWarning, ShapeError
from jaxrmp.kinematics import panda
from jaxrmp.learning import DemonstrationSet, families, learn, load_configuration, prepare
from jaxrmp.synthetic import synthetic_demonstrations

CONFIGS = Path(__file__).parents[2] / "configs"
HAND = 0.1 * (np.eye(3) - 1 / 3)  # m, three points that show its turn


def recording(rng, aside=(0.0, 0.0, 0.0), turn=0.0, spread=0.05):
    """A hand goes about 70 cm to a goal from a start that varies by `spread`, m, wandering by a centimetre; half way it
    is `aside`, m, of the straight line, and turned by `turn`, rad."""
    samples = int(rng.integers(60, 200))
    s = np.linspace(0, 1, samples)[:, None]
    start = np.array([-0.6, 0.3, 0.2]) + rng.normal(size=3) * spread
    wander = sum(rng.normal(size=3) * 0.01 / k * np.sin(k * np.pi * s) for k in (1, 2, 3))
    middle = start * (1 - s) + wander + np.asarray(aside) * np.sin(np.pi * s) ** 2
    a = turn * np.sin(np.pi * s[:, 0]) ** 2
    R = np.array([[np.cos(a), -np.sin(a), 0 * a], [np.sin(a), np.cos(a), 0 * a], [0 * a, 0 * a, 1 + 0 * a]])
    return middle[:, None] + np.einsum("ijt,kj->tki", R, HAND)


def recordings(*ways, seed=0, **more):
    rng = np.random.default_rng(seed)
    return [recording(rng, **({"aside": way} if isinstance(way, tuple) else way), **more) for way in ways]


LEFT, RIGHT, UP, STRAIGHT = (0.03, 0.06, 0.0), (-0.03, -0.06, 0.0), (0.0, 0.0, 0.12), (0.0, 0.0, 0.0)


@pytest.mark.parametrize("spread", [0.01, 0.1, 0.3])
def test_those_that_go_one_way_agree_wherever_they_start(spread):
    for seed in range(5):
        found = families(recordings(*[STRAIGHT] * 7, seed=seed, spread=spread))
        assert found.agree and found.certain and found.groups == (tuple(range(7)),)
        assert "one way" in str(found) and found.within < 0.1 * found.length


@pytest.mark.parametrize("task", ["drawer_closing", "door_reaching"])
def test_the_scripted_demonstrations_agree(task):
    configuration = load_configuration(CONFIGS / f"{task}.toml")
    assert families(prepare(configuration, panda(), synthetic_demonstrations(task)).points).agree


def test_two_ways_are_told_with_where_and_by_how_much():
    found = families(recordings(LEFT, RIGHT, LEFT, RIGHT, LEFT, RIGHT))
    assert found.groups == ((0, 2, 4), (1, 3, 5)) and found.certain and not found.odd
    (parting,) = found.parting
    assert parting.near < 0.1 and 0.12 < parting.apart < 0.25 and parting.near_at < parting.at
    assert 0.3 < parting.at < 0.7 and not parting.turned
    said = str(found)
    assert "go 2 ways: 0, 2, 4 | 1, 3, 5." in said and f"{100 * parting.apart:.1f} cm at {parting.at:.0%}" in said
    assert "learn --groups" in said


def test_three_ways_and_the_larger_group_first():
    found = families(recordings(LEFT, UP, RIGHT, LEFT, RIGHT, UP, UP))
    assert found.groups == ((1, 5, 6), (0, 3), (2, 4)) and len(found.parting) == 3


def test_an_odd_one_out_is_named():
    found = families(recordings(*[STRAIGHT] * 3, (0.0, 0.0, 0.2), *[STRAIGHT] * 2, seed=1))
    assert found.groups == ((0, 1, 2, 4, 5),) and found.odd == (3,)
    assert "Like no other: 3. Leave out, or record more" in str(found)


def test_a_turn_of_the_hand_parts_them_too():
    found = families(recordings(*[{"turn": 1.5}, {"turn": 0.0}] * 3))
    assert found.groups == ((0, 2, 4), (1, 3, 5)) and found.parting[0].turned
    assert "by how the hand is turned" in str(found)
    places = [path.mean(1, keepdims=True) for path in recordings(*[{"turn": 1.5}, {"turn": 0.0}] * 3)]
    assert families(places).agree


def test_the_same_loop_the_other_way_round_is_another_way():
    a = np.linspace(0, 2 * np.pi, 100)[:, None]
    loop = np.concatenate([0.1 * a + 0.15 * np.sin(a), 0.15 * (1 - np.cos(a))], axis=1)[:, None]
    other = loop * [1.0, -1.0]
    assert families([loop, 1.02 * loop, other, 1.02 * other]).groups == ((0, 1), (2, 3))


def test_groups_are_a_guess_where_starts_lie_farther_apart_than_ways():
    both = [path for k in range(4) for path in recordings(LEFT, RIGHT, seed=k, spread=0.0)]
    moved = [path + [0, 0, 0.4 * (k // 2)] * np.linspace(1, 0, len(path))[:, None, None] for k, path in enumerate(both)]
    assert families(both).certain
    found = families(moved)
    assert not found.agree and not found.certain and "--groups" not in str(found)


def test_two_that_part_by_far_are_told_where_there_are_no_groups():
    starts = [np.array([0.0, 0.0, z]) for z in (0.0, 0.0, 0.4, 0.8, -0.4, -0.8)]
    paths = recordings(STRAIGHT, (0.0, 0.15, 0.0), *[STRAIGHT] * 4, spread=0.0)
    paths = [p + z * np.linspace(1, 0, len(p))[:, None, None] for p, z in zip(paths, starts, strict=True)]
    found = families(paths)
    assert [(p.first, p.second) for p in found.parting] == [(0, 1)] and len(found.groups) == 1
    assert not found.certain and "demonstrations part. 0 and 1 are" in str(found)


def test_few_and_still_ones_agree_and_shapes_are_checked():
    path = recordings(STRAIGHT)[0]
    assert families([path]).groups == ((0,),) and families([0 * path] * 3).agree
    assert families([path, path]).groups == ((0, 1),)
    two = families(recordings(LEFT, (-0.1, -0.2, 0.0)))
    assert two.groups == ((0, 1),) and not two.agree
    with pytest.raises(ShapeError, match=r"expected \[T, K, m\]"):
        families([path, path[:, :2]])


def both_ways(demonstrations: DemonstrationSet, by: float) -> DemonstrationSet:
    """Each demonstration twice, the first joint turned to either side by `by`, rad, on the way."""
    moved = []
    for d in demonstrations:
        for side in (by, -by):
            hump = side * np.sin(np.pi * np.linspace(0, 1, len(d.time))) ** 2
            moved.append(replace(d, q=d.q + np.eye(7)[0] * hump[:, None]))
    return replace(demonstrations, demonstrations=tuple(moved))


def test_learning_says_so_before_anything_is_optimised():
    class Begun(Exception):
        pass

    def progress(step, fraction):
        if step == "flow":
            raise Begun

    configuration = load_configuration(CONFIGS / "door_reaching.toml")
    two_ways = both_ways(synthetic_demonstrations("door_reaching", count=3), 0.25)
    with pytest.warns(FileWarning, match=r"go 2 ways: 0, 2, 4 \| 1, 3, 5"), pytest.raises(Begun):
        learn(configuration, panda(), two_ways, progress)
