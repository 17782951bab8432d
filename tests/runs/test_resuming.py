"""A run that was stopped and resumed ends bit for bit as one that never was."""

import pytest
import torch
from torchrl.envs import (
    CatFrames,
    Compose,
    ObservationNorm,
    RewardScaling,
    RewardSum,
    StepCounter,
    TransformedEnv,
    VecNormV2,
)

from locomotion import train
from locomotion.envs import LocomotionEnv
from locomotion.runs import RunError
from locomotion.runs.checkpoints import path_of
from locomotion.transforms import HingeHistory, SensorNoise

# TorchRL finds its own VecNormV2 experimental for environments with a batch.
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:Support of VecNormV2")]
HINGES = "hinge_position"

#: By name: overrides, and makers of what is passed.
RUNS = {
    "gru": (["network=gru", "network.layers=2", "network.hidden_size=8"], {}),
    "no time limit": (["env.time_limit=null"], {}),
    "cpg": (
        ["algorithm=cpg", "env.num_envs=8", "cpg.population=4", "cpg.steps=20", "cpg.iterations=8"],
        {},
    ),
    "late targets": (["disturbances.latency=0.1", "disturbances.mass=[0.8,1.2]"], {}),
    "optimiser": (
        ["ppo.optimizer=sgd", "+ppo.optimizer_options.momentum=0.9", "ppo.max_grad_norm=0.1"],
        {},
    ),
    "CatFrames": (
        [],
        {"transforms": lambda: [CatFrames(3, -1, [HINGES], ["f"])], "in_keys": lambda: ["f"]},
    ),
    "VecNormV2": (
        [],
        {
            "transforms": lambda: [VecNormV2([HINGES, "reward"], ["n", "reward"])],
            "in_keys": lambda: ["n"],
        },
    ),
    "several, for a gru": (
        ["network=gru", "network.hidden_size=8"],
        {
            "transforms": lambda: [
                SensorNoise(0.01),
                VecNormV2([HINGES]),
                CatFrames(2, -1, [HINGES], ["frames"]),
                HingeHistory(2, "frames", "past"),
                ObservationNorm(0.1, 2.0, ["past"]),
                StepCounter(7),
                RewardScaling(0.0, 10.0),
                RewardSum(),
            ],
            "in_keys": lambda: ["past", "episode_reward", "core_orientation"],
        },
    ),
    "an environment of one's own": (
        [],
        {
            "env": lambda: TransformedEnv(
                LocomotionEnv("ant", 3, time_limit=4, seed=5, physics={"threads": 1}),
                Compose(VecNormV2([HINGES]), RewardSum()),
            )
        },
    ),
}


@pytest.mark.parametrize("name", RUNS)
def test_it_ends_as_one_that_was_never_stopped(configured, outcome, stop_after, tmp_path, name):
    overrides, passed = RUNS[name]
    config = configured(*overrides)

    def made():
        return {key: make() for key, make in passed.items()}

    train(config, tmp_path / "whole", **made())
    # Before the first checkpoint, and twice after one.
    for iterations in (1, 4, 6):
        torch.rand(5)
        stop_after(iterations, config, tmp_path / "run", **made())
    train(config, tmp_path / "run", **made())
    assert outcome(tmp_path / "run") == outcome(tmp_path / "whole")


def test_an_environment_of_ones_own_goes_on_from_its_state(
    configured, outcome, stop_after, target_env, tmp_path
):
    config = configured("network=gru", "network.hidden_size=8")
    passed = [{"env": target_env(3, 5, True), "in_keys": ["target"]} for _ in range(3)]
    train(config, tmp_path / "whole", **passed[0])
    stop_after(5, config, tmp_path / "run", **passed[1])
    train(config, tmp_path / "run", **passed[2])
    assert outcome(tmp_path / "run") == outcome(tmp_path / "whole")


@pytest.mark.parametrize("iterations", [0, 2, 6])
def test_what_was_half_written_is_removed(
    configured, outcome, whole, left_after, tmp_path, iterations
):
    folder = left_after(tmp_path / "run", iterations)
    (folder / "checkpoints" / ".partial-000008.ckpt").write_text("half")
    train(configured(), folder)
    assert outcome(folder) == outcome(whole)
    assert not list(tmp_path.rglob(".partial*"))


def test_more_iterations_do_what_their_schedule_says(
    configured, outcome, whole, left_after, tmp_path
):
    folder = left_after(tmp_path / "run", 6)
    longer = configured("ppo.iterations=10", "physics.threads=2")
    with pytest.raises(RunError, match=r"ppo.iterations=8; with ppo.iterations=10"):
        train(longer, folder)
    from locomotion.training.execute import execute

    execute(longer, folder, resumed=True)
    rows, last, _ = outcome(folder)
    assert last == "000010.ckpt" and len(rows) == 10
    assert rows[:6] == outcome(whole)[0][:6]
    rate = longer.learner.actor_lr
    rates = [float(row["actor_lr"]) for row in rows]
    expected = [rate * (1 - i / 8) for i in range(6)] + [rate * (1 - i / 10) for i in range(6, 10)]
    assert rates == pytest.approx(expected)
    # What was asked for then is what the folder holds now.
    assert train(longer, folder).skipped


def test_a_checkpoint_of_another_robot_is_refused(configured, whole, tmp_path):
    folder = tmp_path / "run"
    (folder / "checkpoints").mkdir(parents=True)
    path_of(folder, 8).write_bytes(path_of(whole, 8).read_bytes())
    with pytest.raises(RunError, match=r"000008.ckpt does not fit this run"):
        train(configured("robot=gecko"), folder)


def test_a_checkpoint_of_other_transforms_is_refused(configured, stop_after, tmp_path):
    stop_after(3, configured(), tmp_path / "run", transforms=[CatFrames(2, -1, [HINGES], ["f"])])
    other = [CatFrames(3, -1, [HINGES], ["f"])]
    with pytest.raises(RunError, match=r"000002.ckpt does not fit this run") as caught:
        train(configured(), tmp_path / "run", transforms=other)
    assert "\n" not in str(caught.value)


def test_metrics_that_lost_rows_are_named(configured, left_after, tmp_path):
    folder = left_after(tmp_path / "run", 4)
    lines = (folder / "metrics.csv").read_bytes().splitlines(keepends=True)
    (folder / "metrics.csv").write_bytes(b"".join(lines[:3]))
    with pytest.raises(RunError, match=r"metrics.csv has lost rows: the checkpoint .* after 4"):
        train(configured(), folder)


def test_free_keys_may_change_on_the_way(configured, outcome, whole, left_after, tmp_path):
    folder = left_after(tmp_path / "run", 2)
    train(configured("physics.threads=2", "checkpoint_interval=3"), folder)
    assert outcome(folder) == outcome(whole)
    names = sorted(path.name for path in (folder / "checkpoints").iterdir())
    assert names == [f"00000{iteration}.ckpt" for iteration in (2, 3, 6, 8)]
