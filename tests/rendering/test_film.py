"""Films: what is in the pictures, how many there are, and what is said of the gait."""

import av
import numpy as np
import pytest
from PIL import Image
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import nn
from torchrl.envs import CatTensors, Compose, RewardSum, StepCounter, TransformedEnv

from locomotion.envs import LocomotionEnv
from locomotion.evaluation import PolicyRunner
from locomotion.rendering import record_motion, write_film

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("drawing")]


def test_a_film_shows_the_robot_its_path_and_a_caption(run, is_like, tmp_path):
    result = run("watch", "seconds=5", "width=320", "height=180", "fps=10", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert result.stdout.endswith(" m/s: gecko.mp4, gecko.webp\n")
    with av.open(str(tmp_path / "gecko.mp4")) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
        assert film.streams.video[0].average_rate == 10
    assert len(frames) == 50
    assert frames[0].shape == (180, 320, 3)
    # The camera follows: the core's orange stays near the middle.
    for frame in (frames[0], frames[-1]):
        assert is_like(frame[45:135, 80:240], (220, 140, 40)) > 10
        assert is_like(frame[:20, :120], (255, 255, 255)) > 20  # letters
    # The path grows behind it, red on a ground that is rather blue.
    away = [frame[45:, np.r_[:80, 240:320]].astype(int) for frame in (frames[0], frames[-1])]
    red = [(pixels[..., 0] > pixels[..., 2] + 20).sum() for pixels in away]
    assert red[1] > red[0] + 50
    with Image.open(tmp_path / "gecko.webp") as small:
        assert small.n_frames == 50
    assert (tmp_path / "gecko.webp").stat().st_size < 500_000


@pytest.mark.parametrize("ending", ["webp", "gif"])
def test_a_moving_picture_alone_is_as_large_and_as_fluent_as_asked_for(ending, run, tmp_path):
    options = ["seconds=1", "width=128", "height=96", "fps=20", f"output=gait.{ending}"]
    result = run("watch", *options, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert [path.name for path in tmp_path.iterdir()] == [f"gait.{ending}"]
    with Image.open(tmp_path / f"gait.{ending}") as picture:
        assert picture.size == (128, 96)
        assert picture.n_frames == 20
        picture.seek(19)
        picture.load()
        assert picture.info["duration"] == 50  # ms


def test_a_policy_of_ones_own_is_filmed_in_an_environment_of_ones_own(is_like, tmp_path):
    both = CatTensors(["hinge_position", "hinge_velocity"], "both", del_keys=False)
    base = LocomotionEnv("ant", 3, physics={"threads": 1})
    env = TransformedEnv(base, Compose(both, StepCounter(), RewardSum()))
    policy = TensorDictSequential(
        TensorDictModule(nn.Linear(16, 8), ["both"], ["still"]),
        TensorDictModule(lambda still, n: still + n.sin(), ["still", "step_count"], ["action"]),
    )

    motion = record_motion(PolicyRunner(env, policy), seconds=1.5, fps=8)
    files = write_film(motion, str(tmp_path / "own.mp4"), width=320, height=180)

    assert files == [tmp_path / "own.mp4", tmp_path / "own.webp"]
    with av.open(str(files[0])) as film:
        frames = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(frames) == 12
    assert is_like(frames[-1], (45, 90, 160)) > 30  # bricks
    assert np.abs(frames[-1].astype(int) - frames[0]).max() > 100


def test_a_film_leaves_the_model_of_the_environment_alone(tmp_path):
    env = LocomotionEnv("gecko", 1, physics={"threads": 1})
    before = env.model.vis.global_.offwidth, env.model.light_type.tolist()
    motion = record_motion(PolicyRunner(env, env.rand_action), seconds=0.25, fps=4)
    write_film(motion, tmp_path / "gait.gif", width=64, height=64)
    assert (env.model.vis.global_.offwidth, env.model.light_type.tolist()) == before
