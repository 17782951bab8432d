"""Reading ``conf/``, and files like those in it."""

import dataclasses

import pytest

from locomotion.options import Checked, ConfigError, choices, conf_dir, key, load_file, read_choice
from locomotion.options.files import read_yaml


@dataclasses.dataclass
class Toy(Checked):
    PREFIX = "toy."
    weight: float = key("how heavy (kg)", above=0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "toy.yaml: No such file or directory"),
        (b"\xff\xfe", "toy.yaml is not text in UTF-8"),
        (b"- a list", "toy.yaml does not hold keys and values"),
        (b"", "toy.yaml: toy.weight is missing"),
        (b"weight: [", "toy.yaml, line 1: "),
        (b"weight: 1\nweight: 2\n", "toy.yaml, line 2: found duplicate key weight"),
        (b"weight: \x07", "toy.yaml: "),
        (b"weight: !!python/object/apply:os.system [ls]", "toy.yaml, line 1: could not determine"),
        (b"weight: 0", "toy.yaml: toy.weight=0.0 must be above 0"),
        (b"weigth: 1", "toy.yaml: toy.weigth is not a key; did you mean toy.weight?"),
        (b"weight: ${nowhere}", "toy.yaml: "),
        (b"weight: " + b"[" * 3000, ""),
    ],
)
def test_a_faulty_file_is_named_in_one_line(tmp_path, content, message):
    path = tmp_path / "toy.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError) as refusal:
        load_file(path, Toy)
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_folder_is_not_a_file(tmp_path):
    with pytest.raises(ConfigError, match="Is a directory"):
        load_file(tmp_path, Toy)


def test_a_file_is_read_into_its_schema(tmp_path):
    path = tmp_path / "größe.yaml"
    path.write_text("weight: 3\n", encoding="utf-8")
    assert load_file(path, Toy) == Toy(3.0)
    assert read_yaml(path) == {"weight": 3}


def test_choices_are_the_files_of_their_group():
    assert choices("logger") == ["csv", "tensorboard", "wandb"]
    assert choices("robot") == sorted(path.stem for path in (conf_dir() / "robot").iterdir())
    assert read_choice("robot", "ant")["name"] == "ant"
    for name in ("paper", "../robot/ant", ""):
        with pytest.raises(
            ConfigError, match=f"^logger={name} is unknown; choose from csv, tensorb"
        ):
            read_choice("logger", name)
