"""The policy that a run has learned."""

from __future__ import annotations

from pathlib import Path

from tensordict.nn import TensorDictModuleBase
from torchrl.envs import TransformedEnv

from locomotion.config import Config
from locomotion.runs import RunError
from locomotion.runs.checkpoints import Checkpoints, path_of
from locomotion.training.build import make_learner


def load_policy(run: Path, config: Config, env: TransformedEnv) -> TensorDictModuleBase:
    """The policy of a run's last checkpoint.

    Args:
        run: the run's folder.
        config: its configuration; the task may differ from what it was trained on.
        env: the environment in which it is to walk.

    Raises:
        RunError: if there is no checkpoint that can be read, or its weights are not finite.
    """
    policy = make_learner(config, env).policy
    iteration = Checkpoints(run, policy=policy).load_latest()
    if not iteration:
        raise RunError(f"{run} holds no checkpoint yet")
    if not all(weights.isfinite().all() for weights in policy.state_dict().values()):
        path = path_of(run, iteration)
        raise RunError(f"{path} holds a policy with weights that are not finite numbers")
    return policy.eval().requires_grad_(False)
