"""Runs that are killed, or asked to stop, at any moment."""

import signal
import subprocess
import sys
import time

import pytest
from filelock import FileLock

from locomotion import train
from locomotion.runs import RunError
from locomotion.runs.checkpoints import path_of, saved

pytestmark = pytest.mark.slow


def line(*overrides):
    return [sys.executable, "-m", "locomotion.train", *overrides]


def wait(process, moment):
    while process.poll() is None and not moment():
        time.sleep(0.0005)
    assert process.poll() is None, process.communicate()


def test_killed_at_any_moment_it_ends_as_one_that_was_never_stopped(
    configured, small, outcome, command, tmp_path
):
    longer = ["ppo.iterations=60", "checkpoint_interval=3"]
    train(configured(*longer), tmp_path / "whole")
    folder = tmp_path / "run"
    moments = {
        "before the first checkpoint": lambda: (folder / "metrics.csv").is_file(),
        "while one is written": lambda: list((folder / "checkpoints").glob(".*")),
        "later": lambda: len(saved(folder)) > 8,
    }
    arguments = [*small, *longer, f"hydra.run.dir={folder}"]
    for moment in moments.values():
        process = subprocess.Popen(
            line(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        wait(process, moment)
        process.kill()
        process.communicate()
        arguments = [f"resume={folder}"]
    assert len(saved(folder)) < 20
    last = command("train", *arguments, cwd=tmp_path)
    assert last.returncode == 0, last.stderr
    assert outcome(folder) == outcome(tmp_path / "whole")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_is_asked_to_stop_saves_and_says_how_to_resume(
    small, outcome, tmp_path, number
):
    folder = tmp_path / "run"
    process = subprocess.Popen(
        line(*small, f"hydra.run.dir={folder}", "ppo.iterations=100000"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait(process, lambda: saved(folder))
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    rows, last, _ = outcome(folder)
    assert last == f"{len(rows):06d}.ckpt"
    lines = errors.strip().splitlines()
    assert lines[-1] == f"stopped after {len(rows)} iterations; resume={folder} continues"
    assert "Traceback" not in errors


@pytest.mark.parametrize(("network", "number"), [("mlp", signal.SIGTERM), ("gru", signal.SIGINT)])
def test_asked_to_stop_it_finishes_the_iteration_and_saves(
    configured, outcome, capfd, tmp_path, network, number
):
    config = configured("checkpoint_interval=100", f"network={network}")
    train(config, tmp_path / "whole")
    before = signal.getsignal(number)

    def ask(row):
        if row["iteration"] == 2:
            signal.raise_signal(number)

    with pytest.raises(
        KeyboardInterrupt, match=r"stopped after 3 iterations; resume=\S+ continues"
    ):
        train(config, tmp_path / "run", callbacks=[ask])
    assert signal.getsignal(number) is before
    assert "stopping after this iteration; once more stops at once" in capfd.readouterr().err
    assert [path.name for path in saved(tmp_path / "run")] == ["000003.ckpt"]
    train(config, tmp_path / "run")
    assert outcome(tmp_path / "run") == outcome(tmp_path / "whole")


def test_asked_twice_it_stops_at_once_and_loses_the_iteration(configured, outcome, whole, tmp_path):
    done = []

    def ask(row):
        if row["iteration"] == 4:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        done.append(row["iteration"])

    with pytest.raises(KeyboardInterrupt):
        train(configured(), tmp_path / "run", callbacks=[ask])
    assert done == [0, 1, 2, 3]
    assert [path.name for path in saved(tmp_path / "run")] == ["000002.ckpt", "000004.ckpt"]
    train(configured(), tmp_path / "run")
    assert outcome(tmp_path / "run") == outcome(whole)


def test_asked_to_stop_in_the_last_iteration_it_is_finished(configured, outcome, whole, tmp_path):
    def ask(row):
        if row["iteration"] == 7:
            signal.raise_signal(signal.SIGINT)

    result = train(configured(), tmp_path / "run", callbacks=[ask])
    assert outcome(result.folder) == outcome(whole)
    assert train(configured(), tmp_path / "run").skipped


def test_two_processes_do_not_train_in_one_folder(configured, left_after, command, tmp_path):
    folder = left_after(tmp_path / "run", 2)
    before = {path: path.read_bytes() for path in folder.rglob("*.c*") if path.is_file()}
    with FileLock(folder / ".lock"):
        refused = command("train", f"resume={folder}", cwd=tmp_path)
        with pytest.raises(RunError, match="another process is training there"):
            train(configured(), folder)
    assert refused.returncode == 2
    assert refused.stderr == f"error: {folder}: another process is training there\n"
    assert {path: path.read_bytes() for path in before} == before
    assert path_of(folder, 2) in before
