"""A run is a function: three lines, in a folder that need not be there."""

import csv
import subprocess
import sys
import threading

import pytest
import torch

from locomotion import compose, train
from locomotion.plots import read_run
from locomotion.runs import RunError, read_config
from locomotion.runs.checkpoints import Checkpoints
from locomotion.training.build import make_env, make_learner

pytestmark = pytest.mark.slow


def test_it_leaves_a_record_metrics_checkpoints_and_a_picture(configured, rows, tmp_path):
    folder = tmp_path / "not" / "yet" / "there"
    config = configured("+obs=history3", "robot=ant", "ppo.iterations=5", "checkpoint_interval=2")
    result = train(config, str(folder))
    assert (result.folder, result.skipped) == (folder, False)
    found = rows(folder)
    assert list(found[0])[:4] == ["iteration", "frames", "mean_reward", "mean_value"]
    assert [row["frames"] for row in found] == [60, 120, 180, 240, 300]
    assert result.reward == pytest.approx(sum(row["mean_reward"] for row in found) / 5)
    assert read_run(folder).mean_reward == pytest.approx([row["mean_reward"] for row in found])
    names = sorted(path.name for path in (folder / "checkpoints").iterdir())
    assert names == ["000002.ckpt", "000004.ckpt", "000005.ckpt"]
    assert read_config(folder)["robot"]["name"] == "ant"
    assert (folder / "learning_curve.png").read_bytes().startswith(b"\x89PNG")
    torch.manual_seed(1)
    policy = make_learner(config, make_env(config)).policy
    before = {name: value.clone() for name, value in policy.state_dict().items()}
    assert Checkpoints(folder, policy=policy).load_latest() == 5
    for name, value in policy.state_dict().items():
        assert not torch.equal(before[name], value)


def test_the_final_reward_is_that_of_the_last_ten_iterations(configured, rows, tmp_path):
    result = train(configured("ppo.iterations=13", "ppo.epochs=1"), tmp_path / "run")
    rewards = [row["mean_reward"] for row in rows(result.folder)]
    assert result.reward == pytest.approx(sum(rewards[-10:]) / 10)
    assert result.reward != pytest.approx(sum(rewards) / 13)


def test_a_finished_run_is_skipped_and_another_one_refused(configured, tmp_path):
    result = train(configured(), tmp_path / "run")
    before = {path: path.stat().st_mtime_ns for path in result.folder.rglob("*")}
    again = train(configured("physics.threads=2", "checkpoint_interval=1"), tmp_path / "run")
    assert (again.reward, again.skipped) == (result.reward, True)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    with pytest.raises(RunError, match=r"holds a run with ppo.gamma=0.99; with ppo.gamma=0.5"):
        train(configured("ppo.gamma=0.5"), tmp_path / "run")


def test_a_picture_that_is_missing_is_drawn_without_training(configured, rows, tmp_path):
    result = train(configured(), tmp_path / "run")
    found = (result.folder / "metrics.csv").read_bytes()
    (result.folder / "learning_curve.png").unlink()
    again = train(configured(), tmp_path / "run")
    assert (again.reward, again.skipped) == (result.reward, False)
    assert (result.folder / "metrics.csv").read_bytes() == found
    assert (result.folder / "learning_curve.png").is_file()


@pytest.mark.parametrize("network", ["mlp", "gru"])
def test_runs_in_one_process_do_not_touch_one_another(configured, rows, tmp_path, network):
    small = ["env.time_limit=2", f"network={network}"]
    first = train(configured(*small), tmp_path / "first")
    other = train(configured(*small, "seed=1", "robot=ant", "+obs=history3"), tmp_path / "other")
    torch.rand(7)
    again = train(configured(*small), tmp_path / "again")
    threads = train(configured(*small, "physics.threads=3"), tmp_path / "threads")
    assert rows(first.folder) == rows(again.folder) == rows(threads.folder)
    assert rows(first.folder) != rows(other.folder)


def test_torch_keeps_the_threads_that_it_had(configured, tmp_path):
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        train(configured(), tmp_path / "run")
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_it_runs_in_a_thread_where_no_signal_can_be_handled(configured, rows, tmp_path):
    results = []
    thread = threading.Thread(
        target=lambda: results.append(train(configured(), tmp_path / "thread"))
    )
    thread.start()
    thread.join(120)
    alone = train(configured(), tmp_path / "alone")
    assert results[0].reward == alone.reward


def test_train_stays_callable_after_its_module_was_imported(tmp_path):
    code = f"""
import locomotion
from locomotion import train
import locomotion.train
import locomotion.evaluate
config = locomotion.compose(
    "env.num_envs=2", "ppo.steps=4", "ppo.minibatch_size=8", "ppo.iterations=2"
)
first = train(config, {str(tmp_path / "first")!r})
rows = []
second = locomotion.train(config, {str(tmp_path / "second")!r}, callbacks=[rows.append])
assert first.reward == second.reward and len(rows) == 2
print("fine")
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout == "fine\n", result.stderr


def test_it_prints_nothing(configured, tmp_path, capfd):
    train(configured("+obs=history3", "network=gru"), tmp_path / "run")
    assert capfd.readouterr() == ("", "")


def test_a_run_that_needs_more_memory_than_there_is_says_so(configured, tmp_path):
    from locomotion.runs import RunStopped

    class Greedy:
        def __init__(self, env):
            self.policy = make_learner(configured(), env).policy

        def update(self, batch):
            torch.empty(2**55)

        def state_dict(self):
            return {}

        def load_state_dict(self, state_dict):
            pass

    with pytest.raises(RunStopped, match=r"not enough memory for env.num_envs=5 .* ppo.steps=12"):
        train(configured(), tmp_path / "run", learner=Greedy)


def test_a_gecko_learns_within_seconds(tmp_path):
    config = compose("+obs=history3", "+experiment=quick", "ppo.iterations=60")
    result = train(config, tmp_path / "run")
    with (result.folder / "metrics.csv").open() as file:
        rewards = [float(row["mean_reward"]) for row in csv.DictReader(file)]
    # Chance is 0.02.
    assert rewards[0] < 0.03 and max(rewards) > 0.08
