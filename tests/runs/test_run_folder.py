"""A run's folder says which run is in it, and whether it is finished."""

import pytest

from locomotion.config import as_dict
from locomotion.runs import RunError, differences, is_finished, read_config, read_record, record


def test_the_record_is_the_configuration(configured, tmp_path):
    config = configured("obs.hinge_position.scale=0.5", "network=gru")
    record(tmp_path, config=as_dict(config))
    assert read_config(tmp_path) == as_dict(config)
    found = read_record(tmp_path)
    assert (found["ppo.steps"], found["network.name"], found["physics.threads"]) == (8, "gru", 1)
    assert found["obs.hinge_position.scale"] == 0.5
    assert differences(tmp_path, config) == {}


def test_differences_are_named_by_key_unless_they_change_no_number(configured, tmp_path):
    record(tmp_path, config=as_dict(configured()))
    asked = ["seed=3", "env.time_limit=null", "ppo.gamma=0.5", "physics.threads=7", "logger=csv"]
    found = differences(tmp_path, configured(*asked, "checkpoint_interval=5"))
    assert found == {
        "seed": ("seed=0", "seed=3"),
        "env.time_limit": ("env.time_limit=5.0", "env.time_limit=null"),
        "ppo.gamma": ("ppo.gamma=0.99", "ppo.gamma=0.5"),
    }
    found = differences(tmp_path, configured("network=gru"))
    assert found["network.hidden_size"] == ("no network.hidden_size", "network.hidden_size=64")
    assert found["network.hidden"] == ("network.hidden=[32]", "no network.hidden")


@pytest.mark.slow
def test_a_run_is_finished_when_all_of_it_is_there(configured, whole, left_after, tmp_path):
    assert is_finished(whole, configured())
    assert not is_finished(tmp_path / "not there", configured())
    folder = left_after(tmp_path / "run", 8)
    (folder / "metrics.csv").write_bytes((whole / "metrics.csv").read_bytes())
    assert not is_finished(folder, configured())
    (folder / "learning_curve.png").write_bytes(b"")
    assert is_finished(folder, configured())
    (folder / "checkpoints" / "000008.ckpt").unlink()
    assert not is_finished(folder, configured())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, r"holds no \.hydra/config\.yaml, so it is not a run's folder"),
        (b"- a\n- b\n", r"config\.yaml holds no configuration"),
        (b"robot: {", r"config\.yaml cannot be read"),
        (b"\xff\xfe\x00", r"config\.yaml cannot be read"),
        (b"seed: ${gone}", r"config\.yaml cannot be read"),
        (b"a: " + b"[" * 5000, r"config\.yaml is nested too deeply"),
    ],
    ids=["missing", "a list", "cut", "not text", "broken reference", "deep"],
)
def test_what_is_no_record_is_named_in_one_line(tmp_path, content, words):
    if content is not None:
        (tmp_path / ".hydra").mkdir()
        (tmp_path / ".hydra" / "config.yaml").write_bytes(content)
    with pytest.raises(RunError, match=words) as caught:
        read_config(tmp_path)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)
