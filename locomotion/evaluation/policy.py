"""The policy that a run has learned."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tensordict.nn import TensorDictModuleBase
from torchrl.envs import EnvBase, TransformedEnv

from locomotion.agents.architectures import Network
from locomotion.agents.base import Learner
from locomotion.config import Config
from locomotion.runs import RunError
from locomotion.runs.checkpoints import Checkpoints, path_of
from locomotion.runs.folder import read_passed
from locomotion.training.build import make_learner


def require_parts(run: Path, given: Mapping[str, Any]) -> None:
    """Raises a :class:`RunError` if a run was trained with parts of somebody's own that are not given.

    Its folder has their names alone, so they cannot be made from it.

    Args:
        run: the run's folder.
        given: the parts that matter, by the arguments of :func:`locomotion.train`; ``None`` for one that
            is not there.
    """
    passed = read_passed(run)
    absent = {part for part, value in given.items() if value is None}
    missing = [part for part, name in passed.items() if name and part in absent]
    if missing:
        listed = ", ".join(f"{part}={passed[part]}" for part in missing)
        raise RunError(
            f"{run} was trained with {listed}, which its folder does not hold; from Python,"
            f" locomotion.evaluation.make_runner takes {', '.join(missing)}"
        )


def load_policy(
    run: Path,
    config: Config,
    env: TransformedEnv,
    *,
    in_keys: Sequence[str] | None = None,
    network: Network | None = None,
    learner: Callable[[EnvBase], Learner] | None = None,
) -> TensorDictModuleBase:
    """The policy of a run's last checkpoint.

    Args:
        run: the run's folder.
        config: its configuration; the task may differ from what it was trained on.
        env: the environment in which it is to walk.
        in_keys: as in training, if they were passed there.
        network: likewise.
        learner: likewise.

    Raises:
        RunError: if there is no checkpoint that can be read, its weights are not finite, or the run was
            trained with one of these and it is not passed.
    """
    require_parts(run, {"in_keys": in_keys, "network": network, "learner": learner})
    made = make_learner(config, env, in_keys, network) if learner is None else learner(env)
    policy = made.policy
    iteration = Checkpoints(run, policy=policy).load_latest()
    if not iteration:
        raise RunError(f"{run} holds no checkpoint yet")
    if not all(weights.isfinite().all() for weights in policy.state_dict().values()):
        path = path_of(run, iteration)
        raise RunError(f"{path} holds a policy with weights that are not finite numbers")
    return policy.eval().requires_grad_(False)
