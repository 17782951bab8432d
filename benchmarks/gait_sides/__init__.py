"""Learners that are timed until their robots walk, each in a process of its own.

A side is a learner with a setting, written ``LEARNER:SETTING``: ``ours:quick``, ``sb3:defaults``. A
learner is a module here with ``learn(task, recorder)``; ours has one setting for each of
:data:`EXPERIMENTS`, the others have two: what they document as their defaults, and the hyperparameters
of our ``+experiment=quick``.
"""

from __future__ import annotations

import dataclasses
from typing import Any

#: Ours by name, with what is added to ``+obs=history3`` on the command line; one more is one more line.
EXPERIMENTS: dict[str, tuple[str, ...]] = {
    "report": (),
    "quick": ("+experiment=quick",),
    # The setting that had the name before, on two bodies alone.
    "former": (
        "env.num_envs=1024",
        "ppo.iterations=150",
        "ppo.steps=2",
        "ppo.epochs=5",
        "ppo.minibatch_size=256",
        "ppo.actor_lr=4e-3",
        "ppo.critic_lr=4e-3",
    ),
}

#: Others by name: the module here that runs them, and whether their robots are ours.
OTHERS: dict[str, tuple[str, bool]] = {
    "sb3-on-ours": ("stable_baselines3_on_ours", True),
    "rsl_rl-on-ours": ("rsl_rl_on_ours", True),
    "sb3": ("stable_baselines3", False),
    "single_file": ("single_file", False),
    "torchrl": ("torchrl", False),
}

#: All sides.
SIDES = (
    *(f"ours:{name}" for name in EXPERIMENTS),
    *(f"{name}:{setting}" for name in OTHERS for setting in ("defaults", "quick")),
)

#: Robots of those who need a process for each; 1,024 processes would only wait for one another.
PROCESSES = 64

#: Positions of the hinges that are observed, as with ``+obs=history3``.
HISTORY = 3


@dataclasses.dataclass(frozen=True)
class Hyperparameters:
    """Those of one of our experiments, as any PPO would have them.

    Attributes:
        num_envs: robots.
        steps: control steps of each robot between updates.
        iterations: of collecting and learning; the learning rate falls linearly to 0 over them.
        epochs: passes over the data of an iteration.
        minibatch_size: control steps in a gradient step.
        learning_rate: at the start.
        gamma: discount for each control step.
        gae_lambda: of the advantage estimate.
        clip_epsilon: how far the probability ratio may leave 1.
        entropy_coeff: weight of the entropy of all hinges together.
        hidden: widths of the layers of actor and critic, which have tanh.
    """

    num_envs: int
    steps: int
    iterations: int
    epochs: int
    minibatch_size: int
    learning_rate: float
    gamma: float
    gae_lambda: float
    clip_epsilon: float
    entropy_coeff: float
    hidden: tuple[int, ...]

    def in_processes(self) -> Hyperparameters:
        """The same control steps in an iteration, with as many robots as there can be processes."""
        steps = self.num_envs * self.steps // PROCESSES
        return dataclasses.replace(self, num_envs=PROCESSES, steps=steps)


@dataclasses.dataclass(frozen=True)
class Task:
    """The task of a side.

    Attributes:
        side: its name.
        robot: name of the robot.
        model: file of the compiled robot, for those who step it themselves.
        seed: of everything that is random.
        spawned: when its process was started, by :func:`time.time`.
        output: file of the recorded iterations.
        folder: where the side may write.
        ours: hyperparameters of our ``+experiment=quick``.
    """

    side: str
    robot: str
    model: str
    seed: int
    spawned: float
    output: str
    folder: str
    ours: Hyperparameters

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Task:
        ours = {**values["ours"], "hidden": tuple(values["ours"]["hidden"])}
        return cls(**{**values, "ours": Hyperparameters(**ours)})

    @property
    def setting(self) -> str:
        return self.side.partition(":")[2]

    @property
    def hyperparameters(self) -> Hyperparameters | None:
        """Ours, or ``None`` where the learner is to keep its own."""
        return self.ours if self.setting == "quick" else None


def module_of(side: str) -> str:
    """The module that runs a side."""
    learner = side.partition(":")[0]
    return f"{__name__}.{'ours' if learner == 'ours' else OTHERS[learner][0]}"


def is_ours(side: str) -> bool:
    return side.startswith("ours:")


def on_ours(side: str) -> bool:
    """Whether a side is another learner on our robots."""
    return not is_ours(side) and OTHERS[side.partition(":")[0]][1]
