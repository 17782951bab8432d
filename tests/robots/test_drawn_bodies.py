"""Bodies that are drawn, and bodies that go into files and come back."""

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from locomotion import compose
from locomotion.options import ConfigError
from locomotion.robots import (
    ModularRobot,
    as_tree,
    load_robot,
    parse_body,
    random_body,
    read_revolve2,
    save_robot,
)

BODIES = json.loads(Path(__file__).with_name("revolve2_v1.json").read_text(encoding="utf-8"))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31 - 1), st.integers(1, 12), st.integers(0, 12))
def test_a_drawn_body_can_be_built_and_keeps_its_limits(seed, max_hinges, max_bricks):
    tree = random_body(seed, max_hinges, max_bricks)
    kinds = [module.kind for module in parse_body(tree).walk()]  # which refuses what overlaps
    assert 1 <= kinds.count("hinge") <= max_hinges
    assert kinds.count("brick") <= max_bricks
    assert random_body(seed, max_hinges, max_bricks) == tree


def test_drawn_bodies_differ_and_use_what_they_may():
    trees = [random_body(seed) for seed in range(40)]
    assert len({json.dumps(tree) for tree in trees}) == 40
    kinds = [[module.kind for module in parse_body(tree).walk()] for tree in trees]
    hinges = {found.count("hinge") for found in kinds}
    bricks = {found.count("brick") for found in kinds}
    assert max(hinges) == max(bricks) == 8 and min(hinges) >= 2 and min(bricks) <= 1


def test_a_seed_is_a_robot_wherever_robots_are_named():
    config = compose("robot=random", "robot.seed=7")
    assert config.robot.name == "random7"
    assert config.robot.body == random_body(7)
    assert len(ModularRobot(config.robot.body).hinges) > 0
    assert load_robot({"name": "r", "seed": 3, "max_hinges": 2}).body == random_body(3, 2)
    # As it is recorded, and read again.
    recorded = {"name": "random7", "seed": 7, "body": config.robot.body}
    assert load_robot(recorded) == config.robot
    with pytest.raises(ConfigError, match="robot.seed=7 must be null for a body that is not drawn"):
        compose("robot=gecko", "robot.seed=7")
    with pytest.raises(ConfigError, match="robot.body is missing"):
        load_robot({"name": "nobody"})


@pytest.mark.parametrize("name", ["gecko", "salamander", "blokky"])
def test_a_body_goes_into_a_file_and_comes_back(name, tmp_path):
    config = load_robot(name)
    for number, robot in enumerate([config, parse_body(config.body), ModularRobot(config.body)]):
        path = tmp_path / f"körper {number}.yaml"
        save_robot(robot, path)
        assert load_robot(path).name == path.stem
        assert parse_body(load_robot(path).body) == parse_body(config.body)


@pytest.mark.parametrize("name", BODIES)
def test_revolve2s_trees_come_in(name, tmp_path):
    path = tmp_path / f"{name}.json"
    for content in (BODIES[name], BODIES[name]["core"]):
        path.write_text(json.dumps(content), encoding="utf-8")
        found = read_revolve2(path)
        assert found.name == name
        assert found.body == as_tree(parse_body(load_robot(name).body))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not JSON"),
        ("[]", "core: expected a module"),
        ('{"module": "core", "quarter_turns": "x"}', "core: quarter_turns 'x' is not a whole"),
        ('{"module": "core", "children": {"left": {"module": "leg"}}}', "unknown module 'leg'"),
        ('{"module": "core"}', "the body has no hinge"),
        ("[" * 100_000, "is not JSON"),
        ('{"ant": {"core": {}}}', "unknown key 'ant'"),
    ],
)
def test_a_tree_that_is_no_body_is_refused_in_one_line(content, message, tmp_path):
    path = tmp_path / "body.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        read_revolve2(path)
    assert message in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.slow
def test_the_command_lists_draws_and_writes(command, tmp_path):
    result = command("robots", cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    rows = {line.split()[0]: line.split() for line in result.stdout.splitlines() if line}
    assert BODIES.keys() <= rows.keys()
    assert rows["spider"][1:4] == ["8", "8", "1.04"] and rows["gecko"][-1] == "yes"
    assert (tmp_path / "robots.png").read_bytes().startswith(b"\x89PNG")
    drawn = ("robot=random", "robot.seed=7", "save=seven.yaml", "output=null")
    assert command("robots", *drawn, cwd=tmp_path).stderr == ""
    assert load_robot(tmp_path / "seven.yaml").body == as_tree(parse_body(random_body(7)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["robot=spyder"], "robot=spyder is unknown; choose from ant"),
        (["robots=ant"], "robots is not a key; allowed are output, robot, save, robot.seed"),
        (["save=a.yaml"], "save=a.yaml must be null unless robot names one"),
        (["robot.seed=1"], "robot.seed needs robot=NAME"),
        (["output=a.txt"], "a.txt: not the ending of a picture"),
        (["robot=random", "robot.seed=x"], "robot.seed"),
    ],
)
def test_the_command_refuses_in_one_line(arguments, message, command, tmp_path):
    result = command("robots", *arguments, cwd=tmp_path)
    assert result.returncode == 2, result.stderr
    assert result.stderr.startswith("error: ") and message in result.stderr
    assert result.stderr.count("\n") == 1
