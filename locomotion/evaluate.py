"""Measures how well a policy walks: ``python -m locomotion.evaluate robot=gecko`` or ``run=FOLDER``."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from locomotion.cli.policies import Command
from locomotion.config import Config
from locomotion.evaluation.options import EvaluateConfig

if TYPE_CHECKING:
    from locomotion.evaluation import Interval, Robustness

_EXAMPLES = """\
  python -m locomotion.evaluate                                the gecko that ships
  python -m locomotion.evaluate robot=ant reality_check=true   under what a real robot would bring
  python -m locomotion.evaluate run=outputs/DATE/TIME env.num_envs=256 seconds=120
  python -m locomotion.evaluate physics.self_collision=true disturbances.push=0.5 json=true"""


def evaluate(run: Path, config: Config, options: EvaluateConfig) -> None:
    """Walks with the policy's mean action and with sampled ones, and prints what was measured.

    Args:
        run: folder of the run whose policy walks.
        config: the task it walks in; ``env.num_envs`` robots do.
        options: for how long, under what, and how to print it.

    Raises:
        RunError: if the run holds no checkpoint that can be read.
    """
    from tqdm import tqdm

    from locomotion.evaluation import (
        check_robustness,
        make_runner,
        measure,
        perturbed,
        summarise,
        walk,
    )

    runner = make_runner(run, config)
    walks = 2
    if options.reality_check:
        walks += len(perturbed(config))
    total = walks * max(1, round(options.seconds / runner.period))
    measured, checked = {}, []
    # No bar without a terminal. It goes to standard error, apart from the result.
    with tqdm(total=total, desc=config.robot.name, unit="step", disable=None, leave=False) as bar:
        for sampled in (False, True):
            walked = walk(runner, options.seconds, sampled, effort=True, progress=bar.update)
            measured["sampled" if sampled else "mean_action"] = measure(walked)
        runner.env.close()
        if options.reality_check:
            nominal = measured["mean_action"]["speed"]
            checked = list(check_robustness(run, config, options.seconds, nominal, bar.update))
    found = {how: summarise(values) for how, values in measured.items()}
    if options.json:
        data = _as_data(run, config, options, found, checked)
        print(json.dumps(_known(data), indent=2, allow_nan=False))
    else:
        print(_as_table(config, options, found))
        if checked:
            print(_checked_table(checked))


def _as_data(
    run: Path,
    config: Config,
    options: EvaluateConfig,
    found: dict[str, dict[str, Interval]],
    checked: list[Robustness],
) -> dict[str, Any]:
    data: dict[str, Any] = {
        "robot": config.robot.name,
        "run": str(run),
        "robots": config.env.num_envs,
        "seconds": options.seconds,
        **{
            how: {name: dataclasses.asdict(interval) for name, interval in values.items()}
            for how, values in found.items()
        },
    }
    if checked:
        data["reality_check"] = [dataclasses.asdict(share) for share in checked]
    return data


def _known(value: Any) -> Any:
    """A value as JSON has it, which knows no nan and no infinity; what is unknown is null."""
    if isinstance(value, dict):
        return {name: _known(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_known(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _as_table(
    config: Config, options: EvaluateConfig, found: dict[str, dict[str, Interval]]
) -> str:
    from locomotion.evaluation import MEASURES

    robots = f"{config.robot.name}: {config.env.num_envs} robots, {options.seconds:g} s"
    lines = [
        f"{robots}; mean and 95% confidence interval",
        "",
        f"{'':22}{'mean action':>32}{'sampled':>32}",
    ]
    for name in found["mean_action"]:
        unit = MEASURES[name].unit
        label = f"{name.replace('_', ' ')}{f' ({unit})' if unit else ''}"
        cells = "".join(f"{_shown(values[name]):>32}" for values in found.values())
        lines.append(f"{label:22}{cells}")
    return "\n".join(lines)


def _checked_table(checked: list[Robustness]) -> str:
    what = max(len(share.what) for share in checked)
    width = max(len(share.override) for share in checked)
    lines = ["", f"{'reality check':{what}}  {'':{width}}  {'m/s':>7}  share of the speed without"]
    for share in checked:
        shown = _shown(share.share, ".0%")
        lost = f"  {share.diverged:.0%} diverged" if share.diverged else ""
        words = f"{share.what:{what}}  {share.override:{width}}"
        lines.append(f"{words}  {share.speed:7.3f}  {shown:>5}{lost}")
    return "\n".join(lines)


def _shown(interval: Interval, form: str = ".3g") -> str:
    """A mean and its interval, as far as they are known."""
    if not math.isfinite(interval.mean):
        return "-"
    if not math.isfinite(interval.low):
        return f"{interval.mean:{form}}"
    return f"{interval.mean:{form}} [{interval.low:{form}}, {interval.high:{form}}]"


COMMAND = Command(
    EvaluateConfig, evaluate, "Measures how a policy walks.", _EXAMPLES, usual_envs=64
)

if __name__ == "__main__":
    COMMAND.main()
