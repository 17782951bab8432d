"""Proof that a run which is killed at random moments ends as one that was never stopped.

``python -m benchmarks.kill_and_resume`` trains twice with the same seed: once undisturbed, once with
SIGKILLs, every other one while a checkpoint is being written, each followed by ``resume=FOLDER``. Then
it compares the metrics, timings aside, and all that is in the last checkpoint, bit for bit.
"""

from __future__ import annotations

import argparse
import csv
import io
import random
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from tqdm import trange

#: Columns of ``metrics.csv`` that say how long something took.
TIMINGS = ("collect_seconds", "update_seconds")

RUN = (
    *("robot=ant", "+obs=history3", "env.num_envs=16", "env.time_limit=20", "ppo.steps=32"),
    *("ppo.minibatch_size=100", "checkpoint_interval=3", "physics.threads=1"),
)


def main() -> None:
    """Kills and resumes, prints what came of it, and exits with status 1 if the runs differ."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.kill_and_resume", description=__doc__.split("\n", 1)[0]
    )
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--iterations", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        whole, killed = Path(place, "whole"), Path(place, "killed")
        settings = [*RUN, f"ppo.iterations={arguments.iterations}"]
        started = time.perf_counter()
        subprocess.run(
            command(*settings, f"hydra.run.dir={whole}"), check=True, capture_output=True
        )
        print(f"undisturbed: {time.perf_counter() - started:.0f} s")
        writing = kill(settings, killed, arguments.kills, random.Random(arguments.seed))
        last = subprocess.run(command(f"resume={killed}"), capture_output=True, text=True)
        print(last.stdout + last.stderr, end="")
        same = last.returncode == 0 and outcome(killed) == outcome(whole)
    verdict = "the same" if same else "NOT THE SAME"
    print(f"{arguments.kills} kills, {writing} of them while a checkpoint was written: {verdict}")
    sys.exit(not same)


def kill(settings: list[str], folder: Path, kills: int, moments: random.Random) -> int:
    """Starts a run, or resumes it, and kills it, again and again.

    Returns:
        How often it was killed while a checkpoint was being written.
    """
    writing = 0
    for number in trange(kills, desc="kills"):
        there = (folder / ".hydra" / "config.yaml").is_file()
        arguments = [f"resume={folder}"] if there else [*settings, f"hydra.run.dir={folder}"]
        process = subprocess.Popen(
            command(*arguments), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        rows = count_rows(folder)
        while process.poll() is None and count_rows(folder) == rows:
            time.sleep(0.01)  # until it has started to learn
        if number % 2:
            while process.poll() is None and not list((folder / "checkpoints").glob(".*")):
                time.sleep(0.0001)
        else:
            time.sleep(moments.uniform(0, 1.5))
        if process.poll() is not None:
            raise SystemExit("the run was over before all kills; give it more --iterations")
        process.kill()
        process.wait()
        writing += bool(list((folder / "checkpoints").glob(".*")))
    return writing


def count_rows(folder: Path) -> int:
    """The number of lines of metrics."""
    path = folder / "metrics.csv"
    return path.read_bytes().count(b"\n") if path.is_file() else 0


def command(*overrides: str) -> list[str]:
    """The command line of a training run."""
    return [sys.executable, "-m", "locomotion.train", *overrides]


def outcome(folder: Path) -> tuple[list[dict[str, str]], str, dict[str, Any]]:
    """The outcome of a run: rows but for timings, its last checkpoint's name and all that is in it."""
    with (folder / "metrics.csv").open() as file:
        rows = [
            {key: value for key, value in row.items() if key not in TIMINGS}
            for row in csv.DictReader(file)
        ]
    last = max((folder / "checkpoints").glob("*.ckpt"))
    with zipfile.ZipFile(last) as archive:
        states = {
            name: torch.load(io.BytesIO(archive.read(name)), weights_only=True)
            for name in archive.namelist()
            if name.endswith(".pt")
        }
    return rows, last.name, dict(_leaves(states))


def _leaves(content: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Tensors as bytes, everything else as it is, by where it is in nested containers."""
    if isinstance(content, torch.Tensor):
        yield place, (content.dtype, content.shape, content.numpy().tobytes())
    elif isinstance(content, (dict, list, tuple)):
        items = content.items() if isinstance(content, dict) else enumerate(content)
        for key, value in items:
            # Of the generators only torch's is used; the others differ from process to process.
            if key not in ("python", "numpy"):
                yield from _leaves(value, f"{place}/{key}")
    else:
        yield place, content


if __name__ == "__main__":
    main()
