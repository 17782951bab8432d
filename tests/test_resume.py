"""Runs that are interrupted in every way, and go on as if they never had been."""

import os
import resource
import signal
import subprocess
import sys
import time
import zipfile

import pytest
import torch
from filelock import FileLock
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from benchmarks.kill_and_resume import command, outcome
from locomotion import assembly
from locomotion import train as training
from locomotion.agents import PPO, make_actor
from locomotion.command_line.composing import compose
from locomotion.config import load
from locomotion.runs import RunError, RunStopped, record
from locomotion.runs.checkpoints import Checkpoints, path_of

SMALL = [
    *("robot=ant", "+obs=history3", "env.num_envs=3", "env.time_limit=5", "ppo.steps=8"),
    *("ppo.minibatch_size=10", "ppo.iterations=8", "checkpoint_interval=2", "physics.threads=1"),
]


def run(*overrides, **keywords):
    return subprocess.run(
        command(*overrides), capture_output=True, text=True, timeout=300, **keywords
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that was never stopped."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    training.train(*started(folder))
    return folder


def started(folder, *overrides):
    """What ``train`` is called with when the command line asks for a run in a folder."""
    config = compose(*SMALL, *overrides)
    folder.mkdir()
    record(folder, config=config)
    return config, folder


def copy(source, folder, iterations):
    """The same run as it was after so many iterations and a bit of the next ones."""
    config, _ = started(folder)
    (folder / "checkpoints").mkdir()
    for path in (source / "checkpoints").iterdir():
        if int(path.stem) <= iterations:
            (folder / "checkpoints" / path.name).write_bytes(path.read_bytes())
    rows = (source / "metrics.csv").read_bytes().splitlines(keepends=True)
    (folder / "metrics.csv").write_bytes(b"".join(rows[: iterations + 2])[:-7])
    return config


@pytest.mark.parametrize("iterations", [0, 2, 6])
def test_a_resumed_run_ends_as_one_that_was_never_stopped(whole, tmp_path, iterations):
    config = copy(whole, tmp_path / "run", iterations)
    (tmp_path / "run" / "checkpoints" / ".partial-000008.ckpt").write_text("half")
    training.train(config, tmp_path / "run")
    assert outcome(tmp_path / "run") == outcome(whole)
    assert not list(tmp_path.rglob(".partial*"))


def test_killed_at_any_moment(whole, tmp_path):
    """The short form of ``python -m benchmarks.kill_and_resume``."""
    folder = tmp_path / "run"
    arguments = [*SMALL, f"hydra.run.dir={folder}"]
    # After its first checkpoint, and while a later one may be being written.
    for wanted in ("000002.ckpt", "000004.ckpt"):
        process = subprocess.Popen(command(*arguments), stderr=subprocess.PIPE)
        while not (folder / "checkpoints" / wanted).exists() and process.poll() is None:
            time.sleep(0.001)
        process.kill()
        process.wait()
        arguments = [f"resume={folder}"]
    assert run(*arguments).returncode == 0
    assert outcome(folder) == outcome(whole)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_asked_to_stop_it_saves_and_says_how_to_go_on(whole, tmp_path, number):
    folder = tmp_path / "run"
    process = subprocess.Popen(
        command(*SMALL, f"hydra.run.dir={folder}", "ppo.iterations=100000"),
        stderr=subprocess.PIPE,
        text=True,
    )
    while not (folder / "checkpoints").exists() and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    rows, last, _ = outcome(folder)
    assert last == f"{len(rows):06d}.ckpt"
    lines = errors.strip().splitlines()
    assert lines[-1] == f"stopped after {len(rows)} iterations; resume={folder} goes on"
    assert "Traceback" not in errors


def test_more_iterations_do_what_their_schedule_says(whole, tmp_path):
    folder = tmp_path / "run"
    copy(whole, folder, 6)
    assert run(f"resume={folder}", "ppo.iterations=10", "physics.threads=2").returncode == 0
    rows, last, _ = outcome(folder)
    assert last == "000010.ckpt" and len(rows) == 10
    assert rows[:6] == outcome(whole)[0][:6]
    rate = load("ppo/report").actor_lr
    rates = [float(row["actor_lr"]) for row in rows]
    assert rates == pytest.approx(
        [rate * (1 - i / 8) for i in range(6)] + [rate * (1 - i / 10) for i in range(6, 10)]
    )
    # What the command line said is what the next one goes on with.
    done = run(f"resume={folder}")
    assert (done.returncode, done.stdout) == (0, f"{folder}: finished before, skipped\n")


@pytest.mark.parametrize("damage", ["cut", "emptied", "flipped", "not one", "removed"])
def test_a_damaged_checkpoint_is_named_and_the_one_before_taken(whole, tmp_path, damage, capsys):
    folder = tmp_path / "run"
    config = copy(whole, folder, 6)
    path = path_of(folder, 6)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    damages = {
        "cut": content[: len(content) // 2],
        "emptied": b"",
        "flipped": content,
        "not one": b"gecko" * 99,
    }
    path.write_bytes(damages[damage]) if damage in damages else path.unlink()
    training.train(config, folder)
    warnings = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
    if damage == "removed":
        assert warnings == []
    else:
        assert len(warnings) == 1 and str(path) in warnings[0]
    assert outcome(folder) == outcome(whole)


def test_every_flipped_bit_of_a_checkpoint_is_found(whole, tmp_path):
    folder = tmp_path / "run"
    config = copy(whole, folder, 2)
    path = path_of(folder, 2)
    content = path.read_bytes()
    actor = make_actor(*specs(config))
    checkpoints = Checkpoints(folder, actor=actor)
    assert checkpoints.load_latest() == 2
    expected = actor.state_dict()["module.0.log_scale"].clone()
    directory = content.rindex(b"PK\x05\x06") - 700  # the end of the archive's table of contents
    some = [*range(0, directory, directory // 60), *range(directory, len(content), 3)]
    found = 0
    for place in some:
        changed = bytearray(content)
        changed[place] ^= 1 << place % 8
        path.write_bytes(changed)
        with torch.no_grad():
            actor.module[0].log_scale.zero_()
        try:
            checkpoints.load_latest()
        except RunError as error:
            assert str(folder) in str(error)
            found += 1
        else:  # a date, or what is repeated elsewhere
            assert torch.equal(actor.state_dict()["module.0.log_scale"], expected)
    assert found > len(some) / 2


@pytest.mark.parametrize(("done", "share"), [(2, 0.99), (0, 0.2)])
def test_a_full_disk_stops_the_run_and_leaves_what_was_there(whole, tmp_path, done, share):
    folder = tmp_path / "run"
    copy(whole, folder, done)
    room = int(share * path_of(whole, 2).stat().st_size)  # for all files but a checkpoint

    def limit():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # a write then fails, as on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    stopped = run(f"resume={folder}", preexec_fn=limit)
    assert stopped.returncode == 1
    assert stopped.stderr.count("\n") == 1 and stopped.stderr.startswith("error: ")
    assert path_of(folder, done + 2).name in stopped.stderr
    assert sorted(path.name for path in (folder / "checkpoints").iterdir()) == [
        path_of(whole, iteration).name for iteration in range(2, done + 1, 2)
    ]
    assert run(f"resume={folder}").returncode == 0
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


@pytest.mark.parametrize("where", ["loss", "weight"])
def test_a_learner_that_turns_nan_stops_with_the_last_good_checkpoint(tmp_path, monkeypatch, where):
    config, folder = started(tmp_path / "run")
    learn, updates = PPO.update, iter(range(99))

    def spoiled(self, batch):
        if next(updates) == 5:
            if where == "loss":
                batch["action_log_prob"][0, 0] = float("nan")
            else:
                self.optimizer.register_step_post_hook(
                    lambda *_: self.optimizer.param_groups[1]["params"][0].data.fill_(float("inf"))
                )
        return learn(self, batch)

    monkeypatch.setattr(PPO, "update", spoiled)
    with pytest.raises(RunStopped, match=r"finite number in iteration 5; the last good checkpoint"):
        training.train(config, folder)
    rows, last, _ = outcome(folder)
    assert len(rows) == 5 and last == "000004.ckpt"
    assert "nan" not in (folder / "metrics.csv").read_text()


def test_a_checkpoint_of_another_robot_is_refused(whole, tmp_path):
    config, folder = started(tmp_path / "run", "robot=gecko")
    (folder / "checkpoints").mkdir()
    path_of(folder, 8).write_bytes(path_of(whole, 8).read_bytes())
    with pytest.raises(RunError, match="000008.ckpt does not fit this run"):
        training.train(config, folder)


def test_two_processes_do_not_train_in_one_folder(whole, tmp_path):
    folder = tmp_path / "run"
    copy(whole, folder, 2)
    before = {path: path.read_bytes() for path in folder.rglob("*.c*") if path.is_file()}
    with FileLock(folder / ".lock"):
        refused = run(f"resume={folder}")
    assert refused.returncode == 2
    assert refused.stderr == f"error: {folder}: another process is training there\n"
    assert {path: path.read_bytes() for path in before} == before


def test_what_a_time_or_a_number_decided_stays_when_resumed(tmp_path):
    small = [text for text in SMALL if not text.startswith("ppo.iterations")]
    overrides = [*small, "ppo.iterations=1", "seed=${now:%S}", f"hydra.run.dir={tmp_path / 'run'}"]
    assert run(*overrides).returncode == 0
    assert "$" not in (tmp_path / "run" / ".hydra" / "config.yaml").read_text()
    assert run(f"resume={tmp_path / 'run'}", "ppo.iterations=2").returncode == 0


class Bomb:
    """Unpickled, it leaves a file behind."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_a_checkpoint_from_a_stranger_runs_no_code(whole, tmp_path):
    folder = tmp_path / "run"
    config = copy(whole, folder, 2)
    good = path_of(folder, 2)
    actor = make_actor(*specs(config))
    bombs = {
        "components/0000-actor/state.pt": None,
        "components/0000-actor/state/other.pickle": b"",
    }
    for name in bombs:
        crater = tmp_path / "crater"
        torch.save(Bomb(crater), tmp_path / "bomb.pt")
        with zipfile.ZipFile(path_of(whole, 2)) as source, zipfile.ZipFile(good, "w") as target:
            for member in source.namelist():
                if member != name:
                    target.writestr(member, source.read(member))
            target.writestr(name, (tmp_path / "bomb.pt").read_bytes())
        with pytest.raises(RunError):
            Checkpoints(folder, actor=actor).load_latest()
        assert not crater.exists()
    torch.load(tmp_path / "bomb.pt", weights_only=False)
    assert crater.exists()  # it would have gone off


def specs(config):
    env = assembly.make_env(config)
    return env.observation_spec, env.action_spec, assembly.policy_keys(config)


def test_tensorboard_shows_each_row_once(whole, tmp_path):
    folder = tmp_path / "run"
    config, _ = started(folder, "logger=tensorboard", "logger.video_seconds=0")
    training.train(config, folder)
    path_of(folder, 8).unlink()
    path_of(folder, 6).unlink()
    training.train(config, folder)
    assert outcome(folder) == outcome(whole)
    events = EventAccumulator(str(folder / "tensorboard"))
    events.Reload()
    (tag,) = [tag for tag in events.Tags()["scalars"] if tag.endswith("mean_reward")]
    assert [event.step for event in events.Scalars(tag)] == [24 * i for i in range(1, 9)]
