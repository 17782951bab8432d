"""Choices by name: the project's own, registered ones, and those of installed packages."""

import dataclasses
import string
import subprocess
import sys
import types

import pytest
from hypothesis import given
from hypothesis import strategies as st

from locomotion.options import (
    Checked,
    ConfigError,
    arenas,
    chosen,
    import_plugins,
    key,
    learners,
    networks,
    readings,
    rewards,
)
from locomotion.options.registry import Registry

REGISTRIES = {
    "readings": (readings, "hinge_position"),
    "rewards": (rewards, "distance"),
    "arenas": (arenas, "ground"),
    "networks": (networks, "mlp"),
    "learners": (learners, "ppo"),
}


def registry():
    return Registry("toy", "locomotion.toys", "string")


@given(st.dictionaries(st.text(), st.integers()))
def test_what_is_registered_is_found_by_its_name_whatever_that_is(choices):
    toys = registry()
    for name, choice in choices.items():
        assert toys.register(name)(choice) is choice
    assert toys.names() == sorted(choices)
    assert {name: toys.get(name) for name in toys.names()} == choices


@given(st.sets(st.text(string.ascii_lowercase, min_size=1), min_size=1), st.data())
def test_what_is_not_there_is_refused_with_all_that_is(names, data):
    toys = registry()
    for name in names:
        toys.register(name)(name)
    asked = data.draw(st.text(string.ascii_lowercase).filter(lambda name: name not in names))
    with pytest.raises(ConfigError) as refusal:
        toys.get(asked, "box.toy")
    text = str(refusal.value)
    assert text.startswith(f"box.toy={asked} is unknown; ")
    assert text.endswith(f"choose from {', '.join(sorted(names))}")


def test_a_name_that_is_nearly_right_is_suggested():
    toys = registry()
    toys.register("train")("choo choo")
    with pytest.raises(ConfigError, match="^toy=trian is unknown; did you mean train[?] choose"):
        toys.get("trian")


@pytest.mark.parametrize("name", REGISTRIES)
def test_the_projects_own_are_there_without_an_import(name):
    group, choice = REGISTRIES[name]
    assert choice in group.names()
    assert group.get(choice) is not None


def test_two_modules_cannot_use_one_name_and_one_may_be_loaded_again(tmp_path):
    for name in ("first_gaits", "second_gaits"):
        (tmp_path / f"{name}.py").write_text(
            "from locomotion.options import rewards\n@rewards.register('gait_of_a_test')\nclass Gait: pass\n"
            "rewards.register('number_of_a_test')(object())\n"
        )
    code = (
        "import importlib, first_gaits; from locomotion.options import rewards, import_plugins\n"
        "before = rewards.get('gait_of_a_test'), rewards.get('number_of_a_test')\n"
        "importlib.reload(first_gaits)\n"
        "after = rewards.get('gait_of_a_test'), rewards.get('number_of_a_test')\n"
        "print(*(a is not b for a, b in zip(before, after)), after[0] is first_gaits.Gait)\n"
        "try: import_plugins(['second_gaits'])\n"
        "except ValueError as error: print(error)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert result.stdout == "True True True\nthere are two rewards called gait_of_a_test\n", (
        result.stderr
    )


@pytest.fixture
def installed(monkeypatch, tmp_path):
    """Installs a package that offers a toy, by its entry point's value."""

    def install(value, content):
        (tmp_path / "toy_makers.py").write_text(content)
        place = tmp_path / "toy_makers-1.dist-info"
        place.mkdir()
        (place / "METADATA").write_text("Metadata-Version: 2.1\nName: toy_makers\nVersion: 1\n")
        (place / "entry_points.txt").write_text(f"[locomotion.toys]\nball = {value}\n")
        monkeypatch.syspath_prepend(tmp_path)

    yield install
    sys.modules.pop("toy_makers", None)


def test_an_installed_package_is_imported_when_its_choice_is_asked_for(installed):
    toys = registry()
    toys.register("doll")("a doll")
    installed("toy_makers:ball", "ball = 'a ball'")
    assert toys.names() == ["ball", "doll"]
    assert "toy_makers" not in sys.modules
    assert toys.get("doll") == "a doll"
    assert "toy_makers" not in sys.modules
    assert toys.get("ball") == "a ball"


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("", "AttributeError: module 'toy_makers' has no attribute 'ball'"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
    ],
)
def test_a_package_that_cannot_be_loaded_is_named(installed, content, reason):
    installed("toy_makers:ball", content)
    with pytest.raises(ConfigError) as refusal:
        registry().get("ball")
    assert str(refusal.value) == f"the toy ball of toy_makers:ball cannot be loaded: {reason}"


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("raise RuntimeError('two\\nlines')", "RuntimeError: two lines"),
        ("a = (", "SyntaxError: '[(]' was never closed"),
        ("import no_such_module", "ModuleNotFoundError"),
    ],
)
def test_a_plugin_that_cannot_be_imported_is_named(monkeypatch, tmp_path, content, reason):
    (tmp_path / "broken_gaits.py").write_text(content)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match=f"^plugins=broken_gaits cannot be imported: {reason}"):
        import_plugins(["string", "broken_gaits"])
    for name in ("", ".relative", "no module"):
        with pytest.raises(ConfigError, match="cannot be imported"):
            import_plugins([name])


@dataclasses.dataclass
class Ball(Checked):
    PREFIX = "toy."
    radius: float = key("how large (m)", default=0.1, above=0)


def test_a_choice_is_made_of_the_options_next_to_its_name():
    toys = registry()
    toys.register("ball")(Ball)
    assert chosen(toys, {"name": "ball", "radius": 2}, "toy") == Ball(2.0)
    assert chosen(toys, types.MappingProxyType({"name": "ball"}), "toy") == Ball()
    for options, message in {
        "name is missing": ({}, "toy.name is missing; choose from ball"),
        "name is unknown": ({"name": ["ball"]}, r"toy.name=\['ball'\] is unknown"),
        "key is unknown": ({"name": "ball", "radios": 1}, "toy.radios is not a key; did you mean"),
        "out of range": ({"name": "ball", "radius": 0}, "toy.radius=0.0 must be above 0"),
        "wrong type": ({"name": "ball", "radius": "big"}, "toy.radius: Value 'big' of type 'str'"),
    }.values():
        with pytest.raises(ConfigError, match=f"^{message}"):
            chosen(toys, options, "toy")
