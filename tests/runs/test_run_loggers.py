"""TensorBoard and Weights & Biases show curves, configuration and film."""

import io
import json
import os
import struct
import subprocess
import sys

import pytest
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from wandb.proto import wandb_internal_pb2

from locomotion import train
from locomotion.rendering.graphics import has_graphics
from locomotion.runs.checkpoints import path_of
from locomotion.training.execute import execute

pytestmark = pytest.mark.slow

TINY = ("ppo.iterations=2", "ppo.steps=4", "ppo.minibatch_size=6", "seed=5")


@pytest.fixture
def drawing():
    if not has_graphics():
        pytest.skip("no OpenGL; apt install libegl1 libgl1-mesa-dri")


def events_of(folder):
    events = EventAccumulator(str(folder / "tensorboard"), size_guidance={"images": 0})
    events.Reload()
    return events


def test_tensorboard_has_curves_configuration_and_film(configured, drawing, tmp_path):
    config = configured(*TINY, "logger=tensorboard", "logger.video_seconds=0.5")
    train(config, tmp_path)
    events = events_of(tmp_path)
    assert [event.step for event in events.Scalars("mean_reward")] == [12, 24]
    (text,) = events.Tensors("configuration/text_summary")
    assert b"seed: 5\n" in text.tensor_proto.string_val[0]
    (film,) = events.Images("gait")
    with Image.open(io.BytesIO(film.encoded_image_string)) as picture:
        assert (picture.format, picture.n_frames, film.step) == ("GIF", 5, 24)


@pytest.mark.parametrize("stop", [4, 7])
def test_tensorboard_shows_each_row_once(configured, outcome, stop_after, whole, tmp_path, stop):
    config = configured("logger=tensorboard", "logger.video_seconds=0")
    folder = tmp_path / "run"
    stop_after(stop, config, folder)
    train(config, folder)
    # As if the last two checkpoints had been lost too.
    path_of(folder, 8).unlink()
    path_of(folder, 6).unlink()
    train(config, folder)
    assert outcome(folder) == outcome(whole)
    events = events_of(folder)
    assert [event.step for event in events.Scalars("mean_reward")] == [24 * i for i in range(1, 9)]
    rewards = [event.value for event in events.Scalars("mean_reward")]
    rows = outcome(whole)[0]
    assert rewards == pytest.approx([float(row["mean_reward"]) for row in rows])


def test_wandb_has_curves_configuration_and_film_and_resumes_under_its_name(
    configured, drawing, tmp_path, monkeypatch
):
    monkeypatch.setenv("WANDB_MODE", "offline")
    overrides = [*TINY, "logger=wandb", "logger.video_seconds=0.5"]
    train(configured(*overrides), tmp_path)
    execute(configured(*overrides, "ppo.iterations=3"), tmp_path, resumed=True)
    rewards, films, seeds, names = [], [], [], set()
    for path in sorted(tmp_path.glob("wandb/offline-run-*/*.wandb")):
        names.add(path.stem)
        for found in records(path):
            for item in found.history.item:
                key = item.key or "/".join(item.nested_key)
                if key == "mean_reward":
                    rewards.append(json.loads(item.value_json))
                if key == "gait/path":
                    films.append(json.loads(item.value_json))
            seeds += [
                item.value_json
                for update in (found.run.config, found.config)
                for item in update.update
                if "seed" in (item.key, *item.nested_key)
            ]
    assert len(rewards) == 3
    assert len(films) == 2
    assert all(path.endswith(".mp4") for path in films)
    assert set(seeds) == {"5"}
    assert len(names) == 1


def records(path):
    """The records of W&B's file: LevelDB's log format behind a header of seven bytes."""
    data, place, parts = path.read_bytes(), 7, b""
    while place + 7 <= len(data):
        left = 2**15 - place % 2**15
        if left < 7:  # a header never crosses blocks
            place += left
            continue
        length, kind = struct.unpack("<HB", data[place + 4 : place + 7])
        parts += data[place + 7 : place + 7 + length]
        place += 7 + length
        if kind in (1, 4):  # whole, or the last part
            record = wandb_internal_pb2.Record()
            record.ParseFromString(parts)
            yield record
            parts = b""


def test_without_an_account_the_line_says_what_works(small, tmp_path):
    line = [sys.executable, "-m", "locomotion.train", "logger=wandb", "hydra.run.dir=run", *small]
    bare = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    result = subprocess.run(
        line, env=bare, cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 2
    assert result.stderr.startswith("error: logger=wandb: ")
    assert result.stderr.endswith(" WANDB_MODE=offline works without an account\n")


def test_without_a_logger_nothing_is_logged_elsewhere(configured, tmp_path):
    train(configured(*TINY), tmp_path)
    assert not list(tmp_path.glob("tensorboard")) and not list(tmp_path.glob("wandb*"))
