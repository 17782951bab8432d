"""The policy that a run has learned."""

from __future__ import annotations

from pathlib import Path

from torchrl.envs import TransformedEnv
from torchrl.modules import ProbabilisticActor

from locomotion.config import Config
from locomotion.runs import RunError
from locomotion.runs.checkpoints import Checkpoints
from locomotion.training.build import make_learner


def load_policy(run: Path, config: Config, env: TransformedEnv) -> ProbabilisticActor:
    """The policy of a run's last checkpoint.

    Args:
        run: the run's folder.
        config: its configuration; the task may differ from what it was trained on.
        env: the environment in which it is to walk.

    Raises:
        RunError: if there is no checkpoint that can be read.
    """
    policy = make_learner(config, env).policy
    if not Checkpoints(run, policy=policy).load_latest():
        raise RunError(f"{run} holds no checkpoint yet")
    return policy.eval().requires_grad_(False)
