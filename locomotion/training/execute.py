"""A run as a function: locked, recorded, resumed, trained, drawn."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from locomotion.config import Config, as_dict
from locomotion.options import ConfigError
from locomotion.quiet import quiet
from locomotion.runs import RunError, RunStopped, is_finished, record

#: Torch's words, on a CPU and on a GPU, and Warp's, when there is no memory left.
_NO_MEMORY = "can't allocate memory|out of memory|Failed to allocate"


@dataclasses.dataclass(frozen=True)
class Result:
    """Outcome of a run.

    Attributes:
        folder: where it is.
        reward: mean reward of the last ten iterations.
        skipped: whether it had been finished before.
    """

    folder: Path
    reward: float
    skipped: bool = False


def execute(
    config: Config,
    folder: Path | str,
    *,
    files: Mapping[str, Any] | None = None,
    resumed: bool = False,
    **passed: Any,
) -> Result:
    """Trains a policy in a folder, unless that was done before.

    The folder is locked, the configuration recorded, and what an interrupted run left is resumed.
    Nothing is printed but a progress bar on a terminal.

    Args:
        config: the run.
        folder: where its output goes; made if it does not exist.
        files: more to record in ``.hydra/``, by name without ``.yaml``.
        resumed: whether the configuration may differ from the recorded one, as that of a run that is
            resumed with more iterations.
        passed: arguments of :func:`locomotion.training.loop.train`: an environment, transforms, a
            network, a learner or callbacks of one's own.

    Returns:
        The folder and the final reward.

    Raises:
        ConfigError: for physics that this machine cannot do.
        RunError: if the folder holds another run, or another process is training there.
        RunStopped: if the run cannot go on.
        KeyboardInterrupt: if it was asked to stop; it is saved.
    """
    folder = Path(folder)
    config.physics.require()
    folder.mkdir(parents=True, exist_ok=True)
    described = _described(passed)
    recorded = {**(files or {}), "config": as_dict(config), "passed": described}
    try:
        with FileLock(folder / ".lock", blocking=False):
            # A resumed run differs from the record, but only as it may.
            if resumed:
                record(folder, **recorded)
            skipped = is_finished(folder, config, described)
            if not skipped:
                record(folder, **recorded)
                _train(config, folder, passed)
    except Timeout as error:
        raise RunError(f"{folder}: another process is training there") from error
    from locomotion.plots import read_run

    return Result(folder, float(read_run(folder).mean_reward[-10:].mean()), skipped)


def _described(passed: Mapping[str, Any]) -> dict[str, Any]:
    """Names of the objects that decide a run's numbers, for its record; they cannot be made from it."""

    def name(value: Any) -> str:
        kind = value if isinstance(value, type) or callable(value) else type(value)
        kind = kind if hasattr(kind, "__qualname__") else type(kind)
        return f"{kind.__module__}.{kind.__qualname__}"

    return {
        key: [str(part) if isinstance(part, (str, tuple)) else name(part) for part in value]
        if isinstance(value, (list, tuple))
        else name(value)
        for key, value in passed.items()
        if key != "callbacks" and value is not None
    }


def _train(config: Config, folder: Path, passed: Mapping[str, Any]) -> None:
    # Importing these takes seconds, so they wait until the folder has been looked at.
    with quiet():
        from locomotion.plots import plot_learning_curves
        from locomotion.training.loop import train

        try:
            train(config, folder, **passed)
        except (MemoryError, RuntimeError) as error:
            if isinstance(error, RunStopped) or (
                isinstance(error, RuntimeError) and not re.search(_NO_MEMORY, str(error))
            ):
                raise
            raise RunStopped(
                f"not enough memory for env.num_envs={config.env.num_envs} robots that take"
                f" {config.learner.PREFIX}steps={config.learner.steps} each"
            ) from error
        try:
            plot_learning_curves(folder, folder / "learning_curve.png")
        except RunError as error:
            raise RunStopped(str(error)) from error


__all__ = ["ConfigError", "Result", "execute"]
