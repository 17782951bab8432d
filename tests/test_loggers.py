"""TensorBoard and Weights & Biases show curves, configuration and film."""

import io
import json
import os
import struct
import subprocess
import sys

import pytest
from omegaconf import OmegaConf
from PIL import Image
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from wandb.proto import wandb_internal_pb2

from locomotion.command_line.composing import compose
from locomotion.rendering.graphics import has_graphics
from locomotion.runs import record
from locomotion.train import train

SMALL = ["env.num_envs=3", "ppo.steps=4", "ppo.minibatch_size=6", "ppo.iterations=2"]
needs_graphics = pytest.mark.skipif(
    not has_graphics(), reason="no OpenGL; apt install libegl1 libgl1-mesa-dri"
)


def run(folder, *overrides):
    config = compose(*SMALL, "logger.video_seconds=0.5", "seed=5", *overrides)
    record(folder, config=OmegaConf.structured(config))
    train(config, folder)


@needs_graphics
def test_tensorboard_has_curves_configuration_and_film(tmp_path):
    run(tmp_path, "logger=tensorboard")
    events = EventAccumulator(str(tmp_path / "tensorboard"), size_guidance={"images": 0})
    events.Reload()
    assert [event.step for event in events.Scalars("mean_reward")] == [12, 24]
    (text,) = events.Tensors("configuration/text_summary")
    assert b"seed: 5\n" in text.tensor_proto.string_val[0]
    (film,) = events.Images("gait")
    with Image.open(io.BytesIO(film.encoded_image_string)) as picture:
        assert (picture.format, picture.n_frames, film.step) == ("GIF", 5, 24)


@needs_graphics
def test_wandb_has_curves_configuration_and_film_and_goes_on_under_its_name(tmp_path, monkeypatch):
    monkeypatch.setenv("WANDB_MODE", "offline")
    run(tmp_path, "logger=wandb")
    run(tmp_path, "logger=wandb", "ppo.iterations=3")
    rewards, films, seeds, names = [], [], [], set()
    for path in sorted(tmp_path.glob("wandb/offline-run-*/*.wandb")):
        names.add(path.stem)
        for found in _records(path):
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


def _records(path):
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


def test_without_an_account_the_line_says_what_works(tmp_path):
    command = [
        sys.executable,
        "-m",
        "locomotion.train",
        "logger=wandb",
        "hydra.run.dir=run",
        *SMALL,
    ]
    bare = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    result = subprocess.run(
        command, env=bare, cwd=tmp_path, capture_output=True, text=True, timeout=300
    )
    assert result.returncode == 2
    assert result.stderr.startswith("error: logger=wandb: ")
    assert result.stderr.endswith(" WANDB_MODE=offline works without an account\n")
