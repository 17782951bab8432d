"""Places of a run: links, files, folders that cannot be written; and a stranger's record."""

import sys
from pathlib import Path

import pytest

from locomotion import train
from locomotion.config import as_dict
from locomotion.options import ConfigError
from locomotion.runs import RunError, read_config, record, require_writable, typed_record

pytestmark = pytest.mark.slow


def test_a_link_to_a_folder_is_a_folder(configured, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there")
    require_writable(tmp_path / "link" / "run")
    record(tmp_path / "link", config=as_dict(configured()))
    assert read_config(tmp_path / "there") == as_dict(configured())
    assert (tmp_path / "link").is_symlink()


@pytest.mark.parametrize("below", ["", "/run/deep"])
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("dangling", "dangling is a link that leads nowhere"),
        ("circle", "Too many levels of symbolic links|circle is a link that leads nowhere"),
        ("file", "Not a directory"),
        ("x" * 300, "File name too long"),
        ("/proc/1", "No such file or directory|Permission denied"),
    ],
    ids=["dangling", "circle", "file", "long", "proc"],
)
def test_where_nothing_can_be_written_is_said_in_one_line(name, words, below, tmp_path):
    (tmp_path / "dangling").symlink_to("nothing")
    (tmp_path / "circle").symlink_to("circle")
    (tmp_path / "file").write_text("", encoding="utf-8")
    place = tmp_path / f"{name}{below}"
    with pytest.raises(RunError, match=words) as caught:
        require_writable(place)
    assert str(caught.value).startswith(f"{place} cannot be written: ")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "nothing").exists()


def test_a_strangers_record_imports_nothing_and_needs_no_logger(configured, tmp_path):
    saved = as_dict(configured("seed=7"))
    saved |= {"plugins": ["no_such_module"], "logger": {"backend": "fax"}}
    record(tmp_path, config=saved)
    config = typed_record(read_config(tmp_path))
    assert (config.seed, config.plugins) == (7, [])
    assert "no_such_module" not in sys.modules
    with pytest.raises(ConfigError, match="logger.backend"):
        typed_record(read_config(tmp_path), learning=True)


def test_a_record_is_changed_before_it_is_typed(configured):
    saved = as_dict(configured("seed=7"))
    config = typed_record(saved, lambda content: content.update(seed=8))
    assert (config.seed, saved["seed"]) == (8, 7)
    with pytest.raises(ConfigError, match="sed is not a key"):
        typed_record(saved, lambda content: content.update(sed=8))


@pytest.mark.parametrize("name", ["~root", "a=b, 'c'", "é\udcff", "50% #1 [a] {b} $HOME"])
def test_a_run_is_resumed_in_a_folder_of_any_name(configured, name, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    train(configured("ppo.iterations=1"), name)
    train(configured("ppo.iterations=2"), Path(name), resumed=True)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name / "checkpoints" / "000002.ckpt").is_file()
    assert (tmp_path / name / "learning_curve.png").is_file()
