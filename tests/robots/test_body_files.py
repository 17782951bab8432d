"""Files of bodies as people write them."""

import codecs

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from locomotion import compose
from locomotion.options import ConfigError
from locomotion.robots import BodyError, load_robot, parse_body

pytestmark = pytest.mark.slow

BODY = "body: {module: core, children: {left: {module: hinge%s}}}\n"
PLAIN = BODY % ""


@pytest.fixture(params=["by path", "from Python", "from a folder"])
def load(request, tmp_path):
    """Writes a body file and loads it, in each of the ways there are."""
    (tmp_path / "robot").mkdir()

    def loaded(content, name="mine"):
        path = tmp_path / "robot" / f"{name}.yaml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        if request.param == "from Python":
            return load_robot(path)
        if request.param == "by path":
            return compose(f"robot={path}").robot
        return compose(f"robot={name}", config_dir=tmp_path).robot

    return loaded


def test_a_file_without_a_name_is_called_like_its_file(load):
    assert load(PLAIN, "Lizard-2").name == "Lizard-2"
    assert load(f"name: red\n{PLAIN}", "Lizard-2").name == "red"


def test_a_byte_order_mark_is_skipped(load):
    assert load(codecs.BOM_UTF8 + f"name: Käfer\n{PLAIN}".encode()).name == "Käfer"


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-16-le", "cp1252"])
def test_a_file_in_another_encoding_is_named(encoding, load):
    with pytest.raises(ConfigError) as refused:
        load(f"name: Käfer\n{PLAIN}".encode(encoding))
    assert "mine.yaml" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["\\a", "a\\nb", "\\e[31m", "a\\u202Eb", "\\0", "", "a/b"])
def test_a_name_that_cannot_be_printed_is_refused(name, load):
    with pytest.raises(ConfigError) as refused:
        load(f'name: "{name}"\n{PLAIN}')
    assert "a name of printable characters without '/'" in str(refused.value)
    assert str(refused.value).isprintable()


@pytest.mark.parametrize("rotation", ["1:30", "3:00", "+1:30", "4:30", "1:30.0"])
def test_a_rotation_in_base_60_is_refused(rotation, load):
    with pytest.raises(ConfigError) as refused:
        load(f"name: red\n{BODY % f', rotation: {rotation}'}")
    assert f"mine.yaml, line 2: {rotation} is a number in base 60 to YAML" in str(refused.value)
    with pytest.raises(ConfigError, match="rotation '1:30' is not a quarter turn"):
        load(BODY % ", rotation: '1:30'")
    assert load(BODY % ", rotation: 90").body["children"]["left"]["rotation"] == 90


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (f"name: red\nname: blue\n{PLAIN}", 2),
        (f"{PLAIN}{PLAIN}", 2),
        (BODY % ", rotation: 90, rotation: 0", 1),
        (BODY % ", module: brick", 1),
    ],
)
def test_a_key_that_is_there_twice_is_named(text, line, load):
    with pytest.raises(ConfigError, match=f"mine.yaml, line {line}: ") as refused:
        load(text)
    assert "duplicate key" in str(refused.value)


@given(
    st.integers(-8, 8),
    st.sampled_from([int, float, np.int64, np.float32, np.float64, np.int16]),
)
def test_a_rotation_is_a_number_of_any_kind(quarters, kind):
    def body(degrees):
        return {"module": "core", "children": {"left": {"module": "hinge", "rotation": degrees}}}

    assert parse_body(body(kind(90 * quarters))).children["left"].quarter_turns == quarters % 4
    assert load_robot({"name": "red", "body": body(kind(90 * quarters))}).name == "red"
    with pytest.raises(BodyError, match="is not a quarter turn"):
        parse_body(body(kind(90 * quarters + 1)))
    with pytest.raises(BodyError, match="is not a quarter turn"):
        parse_body(body(np.bool_(False)))


@pytest.mark.parametrize("group", ["experiment", "task"])
@pytest.mark.parametrize("chosen", [[], ["robot=ant"], ["robot.body.children.back.rotation=270"]])
def test_a_body_in_another_file_is_not_merged_into_the_robots(group, chosen, tmp_path):
    (tmp_path / group).mkdir()
    (tmp_path / group / "mine.yaml").write_text(
        "# @package _global_\nrobot: {body: {children: {front: {module: hinge}}}}\n"
        "task: {rewards: {distance: {}}}\n"
    )
    with pytest.raises(
        ConfigError, match="^robot.body of another file would be merged into that of"
    ):
        compose(f"+{group}=mine", *chosen, config_dir=tmp_path)


def test_an_experiment_may_choose_a_robot_and_keys_may_change_its_body(tmp_path):
    for folder in ("experiment", "robot"):
        (tmp_path / folder).mkdir()
    (tmp_path / "robot" / "red.yaml").write_text(PLAIN)
    (tmp_path / "experiment" / "mine.yaml").write_text(
        "# @package _global_\ndefaults: [{override /robot: red}]\nseed: 3\n"
    )
    changed = ["+experiment=mine", "+robot.body.children.front.module=hinge"]
    config = compose(*changed, config_dir=tmp_path)
    assert (config.robot.name, config.seed) == ("red", 3)
    assert [*config.robot.body["children"]] == ["left", "front"]


def test_an_unknown_choice_says_how_a_folder_is_laid_out(tmp_path):
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot" / "mine.yaml").write_text(PLAIN)
    with pytest.raises(ConfigError) as refused:
        compose("robot=mine", config_dir=tmp_path / "robot")
    assert str(refused.value).startswith("robot=mine is unknown; choose from ant, ")
    assert str(refused.value).endswith(f"; in {tmp_path / 'robot'} it would be robot/mine.yaml")
    assert compose("robot=mine", config_dir=tmp_path).robot.name == "mine"
