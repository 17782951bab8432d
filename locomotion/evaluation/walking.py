"""Walking with a policy, and noting what measures need to know."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path

import torch
from tensordict import TensorDictBase
from torchrl.envs import EnvBase, ExplorationType, Transform, set_exploration_type

from locomotion.agents.architectures import Network
from locomotion.agents.base import Learner
from locomotion.config import Config
from locomotion.evaluation.policy import load_policy, require_parts
from locomotion.physics import Physics
from locomotion.training.build import make_env


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """The course of robots, with an entry for the start and one after each control step.

    On the CPU, wherever the robots are.

    Attributes:
        period: time between entries (s).
        position: of the cores (m), float64 of shape ``(steps + 1, robots, 3)``.
        orientation: of the cores, unit quaternions w x y z of shape ``(steps + 1, robots, 4)``.
        work: by all hinges of a robot in each control step (J), the integral of torque times speed
            without regard to sign, shape ``(steps, robots)``; ``None`` if it was not asked for.
        overturns: how often the cores turned over in each control step, from upright to upside down
            or back, each a tilt of 60 degrees or less from it, shape ``(steps, robots)``; ``None``
            likewise.
        diverged: whose simulation diverged at some time, bool of shape ``(robots,)``.
    """

    period: float
    position: torch.Tensor
    orientation: torch.Tensor
    work: torch.Tensor | None
    overturns: torch.Tensor | None
    diverged: torch.Tensor


class PolicyRunner:
    """Robots and the policy that moves them.

    Args:
        env: a :class:`~locomotion.envs.LocomotionEnv`, with or without transforms around it.
        policy: reads what the environment writes, and writes ``action``.

    Attributes:
        env: as given; at the start of an episode after each :meth:`start`.
        base_env: the environment without transforms.
        period: time between two actions (s).
    """

    def __init__(
        self,
        env: EnvBase,
        policy: Callable[[TensorDictBase], TensorDictBase],
    ) -> None:
        self.env = env
        self.base_env = env
        while hasattr(self.base_env, "base_env"):
            self.base_env = self.base_env.base_env
        self.period = self.base_env.task.control_timestep
        self._policy = policy

    def start(self) -> None:
        """Begins an episode."""
        self._seen = self.env.reset()

    @torch.no_grad()
    def step(self, sampled: bool) -> torch.Tensor:
        """Takes a control step.

        Args:
            sampled: whether the action is drawn, as in training, or is the policy's mean.

        Returns:
            Whose simulation diverged, bool of shape ``(robots,)``.
        """
        how = ExplorationType.RANDOM if sampled else ExplorationType.DETERMINISTIC
        with set_exploration_type(how):
            decided = self._policy(self._seen)
        result = self.env.step(decided)
        self._seen = self.env.step_mdp(result)
        return result["next", "terminated"].squeeze(-1)


def make_runner(
    run: Path,
    config: Config,
    *,
    env: EnvBase | None = None,
    transforms: Sequence[Transform] | None = None,
    in_keys: Sequence[str] | None = None,
    network: Network | None = None,
    learner: Callable[[EnvBase], Learner] | None = None,
) -> PolicyRunner:
    """Robots with the policy of a run's last checkpoint.

    Parts of one's own that were passed to :func:`locomotion.train` are passed here again.

    Args:
        run: the run's folder.
        config: the task that they walk in.
        env: a :class:`~locomotion.envs.LocomotionEnv` in place of the one that is described.
        transforms: more transforms, after those that write the observations.
        in_keys: the entries that the policy sees, in place of those of ``config.obs``.
        network: an architecture in place of the one that is described.
        learner: makes the learner for an environment, in place of the one that is described.

    Raises:
        RunError: if the run holds no checkpoint that can be read, or was trained with a part of
            somebody's own that is not passed.
    """
    require_parts(run, {"env": env, "transforms": transforms})
    torch.manual_seed(config.seed)
    environment = make_env(config, env, transforms or (), network)
    policy = load_policy(
        run, config, environment, in_keys=in_keys, network=network, learner=learner
    )
    return PolicyRunner(environment, policy)


def walk(
    runner: PolicyRunner,
    seconds: float,
    sampled: bool = False,
    effort: bool = False,
    progress: Callable[[], object] = lambda: None,
) -> Trajectory:
    """Walks for a while, from a new start.

    Args:
        runner: robots and their policy.
        seconds: for how long, rounded to control steps, at least one.
        sampled: whether actions are drawn, as in training, or are the policy's mean.
        effort: whether to note work and overturns, for which each physics step is looked at.
        progress: called after each control step.
    """
    steps = max(1, round(seconds / runner.period))
    physics = runner.base_env.physics
    runner.start()
    meter = _Effort(runner) if effort else None
    positions, orientations = [physics.qpos[:, :3].clone()], [physics.qpos[:, 3:7].clone()]
    diverged = torch.zeros(len(physics.qpos), dtype=torch.bool, device=physics.device)
    watched = nullcontext() if meter is None else runner.base_env.after_substep(meter.add)
    with watched:
        for _ in range(steps):
            diverged |= runner.step(sampled)
            positions.append(physics.qpos[:, :3].clone())
            orientations.append(physics.qpos[:, 3:7].clone())
            if meter is not None:
                meter.end_step()
            progress()
    return Trajectory(
        runner.period,
        torch.stack(positions).cpu(),
        torch.stack(orientations).cpu(),
        None if meter is None else torch.stack(meter.work).cpu(),
        None if meter is None else torch.stack(meter.overturns).cpu(),
        diverged.cpu(),
    )


class _Effort:
    """Adds work and overturns up over the physics steps of each control step."""

    def __init__(self, runner: PolicyRunner) -> None:
        env = runner.base_env
        self.work: list[torch.Tensor] = []
        self.overturns: list[torch.Tensor] = []
        self._upright = upwards(env.physics.qpos[:, 3:7]) > 0
        env.physics.field("actuator_force")  # computed from now on
        self._begin_step()

    def _begin_step(self) -> None:
        self._joules, self._turned = 0.0, 0.0 * self._upright

    def add(self, physics: Physics) -> None:
        self._joules = self._joules + physics.hinge_work()
        up = upwards(physics.qpos[:, 3:7])
        upright = torch.where(up.abs() >= 0.5, up > 0, self._upright)
        self._turned = self._turned + (upright != self._upright)
        self._upright = upright

    def end_step(self) -> None:
        self.work.append(self._joules)
        self.overturns.append(self._turned)
        self._begin_step()


def upwards(orientation: torch.Tensor) -> torch.Tensor:
    """The upward part of a body's z axis, from -1 to 1, shape ``(*batch,)``.

    Args:
        orientation: unit quaternions w x y z, body to world, shape ``(*batch, 4)``.
    """
    x, y = orientation[..., 1], orientation[..., 2]
    return 1 - 2 * (x * x + y * y)
