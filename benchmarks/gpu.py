"""Measures how fast MuJoCo Warp trains on a GPU: ``python -m benchmarks.gpu``.

For growing numbers of robots: control steps a second of training's collector, and of the same on two
cores with threaded physics, what share of bare MuJoCo Warp that is, memory, and where the time goes.
Then the update with captured gradient steps, and whole runs: the report's, its control steps with 4,096
robots, and ``+experiment=gpu`` with and without captured steps. Without a GPU it says so.
"""

from __future__ import annotations

import json
import statistics
import time

from tqdm import tqdm

from benchmarks.arguments import Parser
from benchmarks.gpu_measures import FULL, QUICK, Effort, apart, measure_run, measure_training
from benchmarks.rows import Row, load, machine, table

DESCRIPTION = "Measures training on a GPU and on two cores, in one table."

NOTES = """\
Control steps a second: of training's collector, with policy, observations and storage; the networks
learn in between. Bare: the same model from the same states under the same actions, a captured graph a
control step and nothing else. Memory: of the device, at its peak. Whole runs are commands, from start to
the last file; kernels were compiled by a run before. For good: the mean reward stayed there to the end."""


def main() -> None:
    """Measures, and prints the table."""
    parser = Parser("benchmarks.gpu", DESCRIPTION, "few turns and robots")
    parser.add_argument("--device", default="cuda:0", help="cuda:0 and so on; cpu only to try it")
    arguments = parser.parse_args()

    from locomotion import compose
    from locomotion.options import ConfigError

    try:
        compose("physics=warp", f"physics.device={arguments.device}").physics.require()
    except ConfigError as error:
        print(f"nothing was measured: {error}")
        return
    effort = QUICK if arguments.quick else FULL
    about = {**machine(), "GPU": _gpu(arguments.device), "load at the start": load()}
    started = time.perf_counter()
    rows = measure(effort, arguments.device)
    print("\n".join(f"{key}: {value}" for key, value in about.items()))
    print(f"\n{table(rows)}\n\n{NOTES}\n{time.perf_counter() - started:.0f} s in all")
    if arguments.json is not None:
        results = {"machine": about, "rows": [row.record() for row in rows]}
        arguments.json.write_text(json.dumps(results, indent=2) + "\n")


def measure(effort: Effort, device: str) -> list[Row]:
    """All rows of the table."""
    threaded = apart(measure_training, effort.rivals, effort, "cpu", "physics.threads=2")
    name = f"control steps/s, two cores, {effort.rivals} robots"
    rows = [Row(name, threaded["speed"], form="{:,.0f}")]
    warp = ("physics=warp", f"physics.device={device}")
    sizes = {}
    for num_envs in tqdm(effort.robots, desc="robots", leave=False):
        try:
            sizes[num_envs] = apart(measure_training, num_envs, effort, device, *warp)
        except RuntimeError as error:  # no memory left, among others
            reason = str(error).splitlines()[0]
            rows.append(Row(f"control steps/s, {num_envs:,} robots", [], context=reason))
        else:
            rows += _rows_of_size(num_envs, sizes[num_envs])
    if sizes:
        rows += _rows_of_best(sizes, statistics.median(threaded["speed"]))
    if effort.captured in sizes and device == "cuda:0":
        graphs = (*warp, "ppo.cudagraphs=true")
        name = f"update with captured gradient steps / without, {effort.captured:,} robots"
        try:
            captured = apart(measure_training, effort.captured, effort, device, *graphs)
        except RuntimeError as error:
            rows.append(Row(name, [], context=str(error).splitlines()[0]))
        else:
            rows.append(_row_of_graphs(name, captured, sizes[effort.captured]))
    return rows + [measure_run(name, asked, device) for name, asked in effort.runs.items()]


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


def _gpu(device: str) -> str:
    if device == "cpu":
        return "none: Warp's CPU device"
    import torch

    return torch.cuda.get_device_name(device)


if __name__ == "__main__":
    main()
