"""A full disk and a learner that turns nan stop a run, and leave what was good."""

import resource
import signal
import subprocess
import sys

import numpy as np
import pytest

from locomotion import train
from locomotion.envs import LocomotionEnv
from locomotion.runs import RunStopped
from locomotion.runs.checkpoints import path_of, saved
from locomotion.training.build import make_learner

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("done", "share"), [(2, 0.99), (0, 0.2)])
def test_a_full_disk_stops_the_run_and_leaves_what_was_there(
    outcome, whole, left_after, tmp_path, done, share
):
    folder = left_after(tmp_path / "run", done)
    room = int(share * path_of(whole, 2).stat().st_size)  # for all files but a checkpoint

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # a write then fails, as on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    def resume(**keywords):
        line = [sys.executable, "-m", "locomotion.train", f"resume={folder}"]
        return subprocess.run(line, capture_output=True, text=True, timeout=300, **keywords)

    stopped = resume(preexec_fn=limit)
    assert stopped.returncode == 1
    assert stopped.stderr.count("\n") == 1 and stopped.stderr.startswith("error: ")
    assert path_of(folder, done + 2).name in stopped.stderr
    names = sorted(path.name for path in (folder / "checkpoints").iterdir())
    assert names == [path_of(whole, iteration).name for iteration in range(2, done + 1, 2)]
    assert resume().returncode == 0
    assert outcome(folder) == outcome(whole)


def test_a_row_is_written_whole_or_not_at_all(tmp_path):
    code = f"""
import resource, signal
from pathlib import Path
from locomotion.runs.metrics import MetricsWriter
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (40, 40))
writer = MetricsWriter(Path({str(tmp_path)!r}))
for iteration in range(9):
    writer.write(dict(iteration=iteration, frames=0.125))
"""
    stopped = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "OSError" in stopped.stderr and "metrics.csv" in stopped.stderr
    assert (tmp_path / "metrics.csv").read_text() == "iteration,frames\n0,0.125\n1,0.125\n"


@pytest.mark.parametrize("where", ["experience", "weight", "elsewhere"])
def test_a_learner_that_turns_nan_stops_with_the_last_good_checkpoint(
    configured, outcome, whole, tmp_path, where
):
    """In the sixth iteration a probability, a weight, or a learner of one's own is spoiled."""
    config = configured()

    def spoiled(env):
        learner = make_learner(config, env)
        learn, updates = learner.update, iter(range(99))

        def update(batch):
            if next(updates) == 5:
                if where == "experience":
                    batch["action_log_prob"][0, 0] = float("nan")
                elif where == "weight":
                    weight = next(learner.critic.parameters())
                    learner.optimizer.register_step_post_hook(
                        lambda *_: weight.data.fill_(float("inf"))
                    )
                else:
                    raise FloatingPointError("the plan is no longer a finite number")
            return learn(batch)

        learner.update = update
        return learner

    folder = tmp_path / "run"
    with pytest.raises(RunStopped, match=r"a finite number in iteration 5; the last good \S+ is"):
        train(config, folder, learner=spoiled)
    rows, last, _ = outcome(folder)
    assert rows == outcome(whole)[0][:5]
    assert last == "000004.ckpt"
    assert "nan" not in (folder / "metrics.csv").read_text()


def test_before_the_first_checkpoint_there_is_none_to_name(configured, tmp_path):
    class Lost:
        def __init__(self, env):
            self.policy = make_learner(configured(), env).policy

        def update(self, batch):
            raise FloatingPointError("a loss is no longer a finite number")

        def state_dict(self):
            return {}

        def load_state_dict(self, state_dict):
            pass

    with pytest.raises(RunStopped, match=r"in iteration 0; the last good checkpoint is none$"):
        train(configured(), tmp_path / "run", learner=Lost)
    assert saved(tmp_path / "run") == []


class Kicked(LocomotionEnv):
    """Throws one robot higher than any gets by itself, before its fourteenth step."""

    def reward(self, before, after):
        self.paid = getattr(self, "paid", 0) + 1
        if self.paid == 13:
            self.physics.qvel[1, 2] = 500.0
        return super().reward(before, after)


def test_robots_that_diverge_are_kept_to_look_at(configured, tmp_path, capsys):
    folder = tmp_path / "run"
    env = Kicked("gecko", 3, seed=0, physics={"threads": 1})
    train(configured("+obs=hinges"), folder, env=env, in_keys=["hinge_position"])
    with np.load(folder / "diverged" / "000001.npz") as found:
        assert found["robot"].tolist() == [1]
        assert found["qvel"][0, 2] == 500.0
        assert found["action"].shape == (1, 6)
    assert [path.name for path in (folder / "diverged").iterdir()] == ["000001.npz"]
    lines = (folder / "metrics.csv").read_text().splitlines()
    column = lines[0].split(",").index("diverged")
    assert [line.split(",")[column] for line in lines[1:]] == ["0", "1", *["0"] * 6]
    assert "simulations diverged" in capsys.readouterr().err
    assert np.isfinite([float(value) for value in lines[2].split(",")]).all()
