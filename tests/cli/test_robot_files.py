"""Bodies from files: by path, in sweeps, from a folder of one's own, and what is wrong with some."""

import pytest
import yaml

from locomotion import compose
from locomotion.config import typed_config
from locomotion.runs import read_config
from locomotion.training.build import make_env

pytestmark = pytest.mark.slow

HINGE = "{module: hinge}"
RED = f"name: red\nbody: {{module: core, children: {{left: {HINGE}}}}}\n"
BLUE = f"name: blue\nbody: {{module: core, children: {{front: {HINGE}, back: {HINGE}}}}}\n"


@pytest.mark.parametrize("folder", [".", "a folder", "Möbel/für (2)", "it's, here"])
def test_a_file_is_a_robot_wherever_it_is(folder, write, monkeypatch, tmp_path):
    path = write(f"{folder}/mine.yaml", RED)
    monkeypatch.chdir(tmp_path)
    for shown in (path, path.relative_to(tmp_path)):
        robot = compose(f"robot={shown}").robot
        assert (robot.name, robot.body) == ("red", yaml.safe_load(RED)["body"])


def test_a_file_may_be_called_like_another_robot(write):
    path = write("gecko.yaml", BLUE)
    write("robot/gecko-mine.yaml", RED)
    assert compose(f"robot={path}").robot.name == "blue"
    assert compose("robot=gecko").robot.name == "gecko"
    mine = write("gecko-mine.yaml", BLUE)
    assert compose(f"robot={mine}", config_dir=path.parent).robot.name == "blue"
    assert compose("robot=gecko-mine", config_dir=path.parent).robot.name == "red"


def test_a_file_is_read_anew_each_time(write):
    path = write("mine.yaml", RED)
    assert compose(f"robot={path}").robot.name == "red"
    write("mine.yaml", BLUE)
    assert compose(f"robot={path}").robot.name == "blue"


def test_files_are_trained_in_a_sweep(command, small, write, tmp_path):
    write("Möbel für alle/blue.yaml", BLUE)
    write("red.yml", RED)
    robots = f"robot='{tmp_path}/Möbel für alle/blue.yaml',gecko,red.yml"
    place = ["hydra.sweep.dir=sweep", "hydra.sweep.subdir=${robot.name}"]
    result = command("train", "--multirun", robots, *small, *place, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    hinges = {"blue": 2, "gecko": 6, "red": 1}
    assert sorted(path.name for path in (tmp_path / "sweep").iterdir() if path.is_dir()) == [
        *hinges
    ]
    for name, count in hinges.items():
        config = typed_config(read_config(tmp_path / "sweep" / name))
        assert make_env(config).action_spec.shape[-1] == count


def test_two_files_of_one_name_are_refused(refusal, write):
    first, second = write("a/mine.yaml", RED), write("b/mine.yaml", BLUE)
    line = refusal("--multirun", f"robot={first},{second}")
    assert line == f"{first} and {second} would both be robot=mine-file; rename one"


def test_a_file_that_is_not_there_is_named(refusal, tmp_path):
    line = refusal(f"robot={tmp_path}/mine.yaml")
    assert line == f"{tmp_path}/mine.yaml: No such file or directory"


FAULTS = {
    "name: twin\nbody:\n  module: core\n  children:\n    left:\n      module: brick\n      children:\n"
    "        front: {module: hinge}\n        front: {module: brick}\n": (
        "core/left: two children on the face 'front'"
    ),
    "name: red\nbody: {module: core}\ncolour: red\n": "robot.colour is not a key; allowed are name",
    "name: red\n": "robot.body is missing",
    "name: red\nbody: core\n": "robot.body",
    "name: red\nbody: {module: core, children: [hinge]}\n": "core: children must map faces",
    "name: red\nbody: {module: core}\n": "core: the body has no hinge",
    "name: red\nbody: {module: wheel}\n": "core: unknown module 'wheel'; choose from core, brick",
    "name: [\n": "red.yaml, line 2",
    "name: red\nbody: {module: core, children: {left: {module: hinge, children: {attachment: "
    "{module: core}}}}}\n": "core/left/attachment: a body has one core",
    "name: \x07": "special characters are not allowed",
}


@pytest.mark.parametrize("content", FAULTS)
@pytest.mark.parametrize("chosen", ["by path", "from a folder"])
def test_a_faulty_body_is_named(content, chosen, refusal, write, tmp_path):
    path = write("robot/red.yaml", content)
    arguments = (
        [f"robot={path}"] if chosen == "by path" else [f"--config-dir={tmp_path}", "robot=red"]
    )
    wanted = FAULTS[content]
    if chosen == "from a folder" and wanted.endswith("is missing"):
        wanted = wanted.split(" ")[0]  # the gecko's is there no more, says Hydra
    assert wanted in refusal(*arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["robot.body.module=wheel"], "unknown module 'wheel'; choose from core, brick"),
        (["robot.body.children.back.rotation=30"], "core/back: rotation 30 is not a quarter turn"),
        (["+robot.body.children.top.module=hinge"], "core: a core has no face 'top'"),
        (["+robot.body.colour=red"], "core: unknown key 'colour'; allowed are module"),
        (["+robot.body._target_=os.system"], "core: unknown key '_target_'"),
    ],
)
def test_a_body_can_be_changed_by_keys_and_is_checked(arguments, message, refusal):
    assert refusal(*arguments).startswith("robot gecko: core")
    assert message in refusal(*arguments)
    assert "front" in compose("+robot.body.children.front.module=hinge").robot.body["children"]


@pytest.mark.parametrize(
    ("pairs", "message"), [(20, "more than 40 modules"), (100, "nested too deeply")]
)
@pytest.mark.parametrize("chosen", ["by path", "from a folder"])
def test_a_body_without_end_is_refused(pairs, message, chosen, refusal, write, tmp_path):
    body = HINGE
    for _ in range(pairs):
        brick = f"{{module: brick, children: {{front: {body}}}}}"
        body = f"{{module: hinge, children: {{attachment: {brick}}}}}"
    text = f"name: tower\nbody: {{module: core, children: {{front: {body}}}}}\n"
    path = write("robot/tower.yaml", text)
    folder = [f"--config-dir={tmp_path}", "robot=tower"]
    assert message in refusal(*([f"robot={path}"] if chosen == "by path" else folder))


def test_a_folder_of_ones_own_may_have_any_name(refusal, write, tmp_path):
    folder = write("a,b (c) [d]/robot/red.yaml", RED).parents[1]
    arguments = [f"--config-dir={folder}", "robot=red", "seed=-1"]
    assert refusal(*arguments).startswith("seed=-1 must be")
    (tmp_path / "other").mkdir()
    search = f"hydra.searchpath=['file://{tmp_path}/other']"
    assert refusal(*arguments, search).startswith("seed=-1 must be")
