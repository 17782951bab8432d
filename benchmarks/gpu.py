"""How fast MuJoCo Warp trains on a GPU: ``python -m benchmarks.gpu``.

For growing numbers of robots: control steps a second of training's collector beside the same on two
cores with threaded physics, what share of bare MuJoCo Warp that is, memory, and where the time goes.
Then the update with captured gradient steps, and whole runs: the report's, its control steps with 4,096
robots, and ``+experiment=gpu`` with and without captured steps. Without a GPU it says so.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import multiprocessing
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tqdm import tqdm

from benchmarks.report import Row, load, machine, table

DESCRIPTION = "Measures training on a GPU beside training on two cores, in one table."

NOTES = """\
Control steps a second: of training's collector, with policy, observations and storage; the networks
learn in between. Bare: the same model from the same states under the same actions, a captured graph a
control step and nothing else. Memory: of the device, at its peak. Whole runs are commands, from start to
the last file; kernels were compiled by a run before. For good: the mean reward stayed there to the end."""

#: The report's budget of control steps.
BUDGET = 64 * 128 * 200
#: The reward (m) that its Gecko ends with.
REPORTED = 0.087


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much is measured.

    Attributes:
        turns: batches that are timed.
        steps: control steps of each robot in a batch.
        robots: numbers of robots.
        rivals: robots stepped by two cores.
        captured: robots with which gradient steps are timed as CUDA graphs, too.
        runs: whole runs: a name, and what is asked for on the command line.
    """

    turns: int
    steps: int
    robots: tuple[int, ...]
    rivals: int
    captured: int
    runs: dict[str, tuple[str, ...]]


FULL = Effort(
    turns=5,
    steps=16,
    robots=(64, 256, 1024, 4096, 16384, 65536),
    rivals=1024,
    captured=4096,
    runs={
        "64 robots, the report's settings": ("+obs=history3", "physics=warp"),
        # 4,096 robots that take 400 control steps each.
        "4,096 robots, the report's budget": (
            "+obs=history3",
            "+experiment=gpu",
            "ppo.iterations=200",
        ),
        "+experiment=gpu": ("+obs=history3", "+experiment=gpu"),
        "+experiment=gpu ppo.cudagraphs=true": (
            "+obs=history3",
            "+experiment=gpu",
            "ppo.cudagraphs=true",
        ),
    },
)
QUICK = Effort(
    turns=2,
    steps=2,
    robots=(4, 8),
    rivals=8,
    captured=8,
    runs={
        "8 robots, little of a run": (
            "physics=warp",
            "env.num_envs=8",
            "ppo.steps=4",
            "ppo.minibatch_size=32",
            "ppo.iterations=2",
        )
    },
)


def main() -> None:
    """Measures, and prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gpu", description=DESCRIPTION)
    parser.add_argument("--device", default="cuda:0", help="cuda:0 and so on; cpu only to try it")
    parser.add_argument(
        "--quick", action="store_true", help="few turns and robots, only to see that it runs"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results there too")
    arguments = parser.parse_args()
    if arguments.json is not None:
        try:
            arguments.json.touch()
        except OSError as error:
            parser.exit(2, f"error: --json {arguments.json}: {error.strerror}\n")

    from locomotion.command_line.composing import compose
    from locomotion.config import ConfigError

    try:
        compose("physics=warp", f"physics.device={arguments.device}").physics.require()
    except ConfigError as error:
        print(f"nothing was measured: {error}")
        return
    effort = QUICK if arguments.quick else FULL
    about = {**machine(), "GPU": _gpu(arguments.device), "load at the start": load()}
    started = time.perf_counter()
    threaded = _apart(measure_training, effort.rivals, effort, "cpu", "physics.threads=2")
    rows = [
        Row(
            f"control steps/s, two cores, {effort.rivals} robots",
            threaded["speed"],
            form="{:,.0f}",
        )
    ]
    sizes = {}
    for num_envs in tqdm(effort.robots, desc="robots", leave=False):
        overrides = ("physics=warp", f"physics.device={arguments.device}")
        try:
            sizes[num_envs] = _apart(
                measure_training, num_envs, effort, arguments.device, *overrides
            )
        except RuntimeError as error:  # no memory left, among others
            reason = str(error).splitlines()[0]
            rows.append(Row(f"control steps/s, {num_envs:,} robots", [], context=reason))
        else:
            rows += _rows_of_size(num_envs, sizes[num_envs])
    if sizes:
        rows += _rows_of_best(sizes, statistics.median(threaded["speed"]))
    if effort.captured in sizes and arguments.device == "cuda:0":
        graphs = ("physics=warp", f"physics.device={arguments.device}", "ppo.cudagraphs=true")
        name = f"update with captured gradient steps / without, {effort.captured:,} robots"
        try:
            captured = _apart(measure_training, effort.captured, effort, arguments.device, *graphs)
        except RuntimeError as error:
            rows.append(Row(name, [], context=str(error).splitlines()[0]))
        else:
            rows.append(_row_of_graphs(name, captured, sizes[effort.captured]))
    for name, overrides in effort.runs.items():
        rows.append(measure_run(name, overrides, arguments.device))
    print("\n".join(f"{key}: {value}" for key, value in about.items()))
    print(f"\n{table(rows)}\n\n{NOTES}\n{time.perf_counter() - started:.0f} s in all")
    if arguments.json is not None:
        results = {"machine": about, "rows": [row.record() for row in rows]}
        arguments.json.write_text(json.dumps(results, indent=2) + "\n")


def _rows_of_size(num_envs: int, measured: dict) -> list[Row]:
    collect, bare, update = (
        1e3 * statistics.median(measured[part]) for part in ("collect", "bare", "update")
    )
    return [
        Row(
            f"control steps/s, {num_envs:,} robots",
            measured["speed"],
            form="{:,.0f}",
            context=f"{measured['memory'] / 2**30:.2f} GiB",
        ),
        Row(
            f"share of bare MuJoCo Warp, {num_envs:,} robots",
            _shares(measured),
            context=(
                f"ms a control step: {collect:.2f} to collect, {bare:.2f} bare,"
                f" {update:.2f} to learn"
            ),
        ),
    ]


def _rows_of_best(sizes: dict[int, dict], threaded: float) -> list[Row]:
    best = max(sizes, key=lambda num_envs: statistics.median(sizes[num_envs]["speed"]))
    return [
        Row(
            f"times two cores, at the best size, {best:,}",
            [speed / threaded for speed in sizes[best]["speed"]],
            target=50.0,
            form="{:.1f}",
        ),
        Row("share of bare MuJoCo Warp, there", _shares(sizes[best]), target=0.9),
    ]


def _row_of_graphs(name: str, captured: dict, eager: dict) -> Row:
    a, b = (1e3 * statistics.median(measured["update"]) for measured in (captured, eager))
    return Row(
        name,
        [x / y for x, y in zip(captured["update"], eager["update"], strict=True)],
        context=f"{a:.2f} / {b:.2f} ms a control step",
    )


def _shares(measured: dict) -> list[float]:
    return [a / b for a, b in zip(measured["bare"], measured["collect"], strict=True)]


def measure_training(
    num_envs: int, effort: Effort, device: str, *overrides: str
) -> dict[str, list[float] | float]:
    """Collects and learns.

    Returns:
        Turn by turn, ``speed`` (control steps of all robots a second) and the time (s) of a control
        step ``bare`` (on Warp), to ``collect`` and to ``update``; and ``memory``, in bytes.
    """
    import torch

    from benchmarks.ours import BareWarp, Training

    def finish() -> float:
        if device != "cpu":
            torch.cuda.synchronize(device)
        return time.perf_counter()

    free = torch.cuda.mem_get_info(device)[0] if device != "cpu" else 0
    training = Training(num_envs, effort.steps, *overrides)
    physics = training.env.base_env.physics
    bare = BareWarp(physics, training.substeps) if "physics=warp" in overrides else None
    batch, _ = training.collect()
    training.update(batch)  # the first ones take longer
    times: dict[str, list[float]] = {"bare": [], "collect": [], "update": []}
    for _ in range(effort.turns):
        qpos, qvel = physics.qpos.clone(), physics.qvel.clone()
        started = finish()
        batch, _ = training.collect()
        times["collect"].append((finish() - started) / effort.steps)
        if bare is not None:
            bare.load(qpos, qvel)
            started = finish()
            bare.replay(batch["action"])
            times["bare"].append((finish() - started) / effort.steps)
        started = finish()
        training.update(batch)
        times["update"].append((finish() - started) / effort.steps)
    used = free - torch.cuda.mem_get_info(device)[0] if device != "cpu" else 0
    training.close()
    return {
        "speed": [num_envs / seconds for seconds in times["collect"]],
        "memory": used,
        **times,
    }


def measure_run(name: str, overrides: tuple[str, ...], device: str) -> Row:
    """Wall time (s) of a whole run, beside the reward that it ended with."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "locomotion.train", *overrides]
        command += [f"physics.device={device}", f"hydra.run.dir={folder}/run"]
        started = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True)
        seconds = time.perf_counter() - started
        if done.returncode:
            return Row(f"s, whole run, {name}", [], context=done.stderr.strip().splitlines()[-1])
        with open(f"{folder}/run/metrics.csv", newline="") as file:
            rows = list(csv.DictReader(file))
    steps, rewards = int(rows[-1]["frames"]), [float(row["mean_reward"]) for row in rows]
    # For good: as long as all robots still face the way they started, a policy can be faster than it is.
    below = [i for i, reward in enumerate(rewards) if reward < REPORTED]
    there = below[-1] + 1 if below else 0
    taken = [float(row["collect_seconds"]) + float(row["update_seconds"]) for row in rows]
    passed = "never" if there == len(rows) else f"after {sum(taken[: there + 1]):.1f} s of training"
    return Row(
        f"s, whole run, {name}",
        [seconds],
        target=60.0 if steps == BUDGET else None,
        at_most=True,
        form="{:.1f}",
        context=(
            f"{steps:,} control steps, {statistics.mean(rewards[-10:]):.3f} m at the end;"
            f" {REPORTED} m for good {passed}"
        ),
    )


def _apart(measure, *arguments):
    """What a function returns, from a process of its own, whose memory nobody else has used."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        return pool.submit(measure, *arguments).result()


def _gpu(device: str) -> str:
    if device == "cpu":
        return "none: Warp's CPU device"
    import torch

    return torch.cuda.get_device_name(device)


if __name__ == "__main__":
    main()
