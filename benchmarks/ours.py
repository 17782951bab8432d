"""Our side: training's own parts, MuJoCo alone as their limit, and the body before it was fused."""

from __future__ import annotations

import copy
import time
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import mujoco
import mujoco.rollout
import numpy as np
import torch
from tensordict import TensorDictBase
from torchrl.envs import TransformedEnv

from locomotion.agents import PPO, make_critic
from locomotion.assembly import make_env, make_policy, policy_keys
from locomotion.command_line.composing import compose
from locomotion.command_line.quiet import quiet
from locomotion.envs import WalkAway
from locomotion.train import make_collector

if TYPE_CHECKING:
    from locomotion.physics.warp import WarpPhysics

#: What the project says in the MJCF to save time, as (path, attribute). MuJoCo's default holds where
#: the attribute, or with ``None`` all that the element says, is missing.
SAVINGS = (
    ("compiler", "fusestatic"),
    ("option/flag", "island"),
    ("option/flag", "warmstart"),
    # Contacts with the ground are listed rather than found.
    ("contact", None),
    (".//body/geom", "conaffinity"),
)


class Training:
    """Environment, policy and collector of ``python -m locomotion.train +obs=history3``.

    Args:
        num_envs: robots.
        steps: control steps of each robot in a batch.
        overrides: further keys of the configuration.
    """

    def __init__(self, num_envs: int, steps: int, *overrides: str) -> None:
        frames = num_envs * steps
        config = compose(
            "+obs=history3",
            f"env.num_envs={num_envs}",
            f"ppo.steps={steps}",
            f"ppo.minibatch_size={min(2048, frames)}",
            "ppo.iterations=1000",  # more batches than any measurement takes
            *overrides,
        )
        quiet()
        torch.manual_seed(config.seed)
        self.frames = frames
        self.env = make_env(config)
        self.substeps = round(1 / config.env.control_frequency / config.physics.timestep)
        actor = make_policy(config, self.env)
        critic = make_critic(self.env.observation_spec, policy_keys(config))
        critic.to(config.physics.device)
        self._collector = make_collector(config, self.env, actor)
        self._batches = iter(self._collector)
        self._ppo = PPO(actor, critic, self.env.action_spec.shape[-1], frames, config.ppo)

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model that is shipped."""
        return self.env.base_env.model

    def collect(self) -> tuple[TensorDictBase, float]:
        """The next batch, and how long it took to collect it (s)."""
        started = time.perf_counter()
        batch = next(self._batches)
        return batch, time.perf_counter() - started

    def update(self, batch: TensorDictBase) -> float:
        """How long it takes to learn from a batch (s)."""
        started = time.perf_counter()
        self._ppo.update(batch)
        elapsed = time.perf_counter() - started
        self._collector.update_policy_weights_()  # as training does, on its own account
        return elapsed

    def controls(self, batch: TensorDictBase) -> np.ndarray:
        """What a batch's actions were to MuJoCo, shape ``(steps, num_envs, substeps, nu)``."""
        limits = self.env.action_spec.space
        actions = batch["action"].clamp(limits.low[:, None], limits.high[:, None]).to(torch.float64)
        return actions.transpose(0, 1)[:, :, None].repeat(1, 1, self.substeps, 1).numpy()

    def close(self) -> None:
        self._collector.shutdown()


class CollectorSide:
    """Our side of a comparison in a process of its own: a batch a step, with the policy.

    Args:
        num_envs: robots.
        steps: control steps of each robot in a batch.
        learn: whether PPO learns from each batch.
        overrides: further keys of the configuration.
    """

    def __init__(self, num_envs: int, steps: int, learn: bool, *overrides: str) -> None:
        self._training = Training(num_envs, steps, *overrides)
        self._learn = learn

    def step(self) -> int:
        # As in training's loop, the last batch is still there while the next is collected.
        self._batch, _ = self._training.collect()
        if self._learn:
            self._training.update(self._batch)
        return self._training.frames

    def close(self) -> None:
        self._training.close()


class RawRollout:
    """``mujoco.rollout`` and nothing else, as fast as it can be called: one call a control step.

    Args:
        model: what is stepped.
        num_envs: copies of it.
        substeps: physics steps in a control step.
        threads: threads that share the copies; 1 steps them on the calling thread.
    """

    def __init__(self, model: mujoco.MjModel, num_envs: int, substeps: int, threads: int) -> None:
        self._models = [model] * num_envs
        self._data = [mujoco.MjData(model) for _ in range(threads)]
        self._rollout = mujoco.rollout.Rollout(nthread=threads if threads > 1 else 0)
        size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self._substeps = substeps
        self._states = np.empty((num_envs, substeps, size))

    def replay(self, start: np.ndarray, controls: np.ndarray) -> tuple[np.ndarray, float]:
        """Steps all copies through recorded controls.

        Args:
            start: full physics states, shape ``(num_envs, 1 + nq + nv)``.
            controls: shape ``(steps, num_envs, substeps, nu)``.

        Returns:
            The states at the end, and how long it took (s).
        """
        state = start.copy()
        last = self._states[:, -1]
        started = time.perf_counter()
        for control in controls:
            self._rollout.rollout(
                self._models,
                self._data,
                state,
                control,
                skip_checks=True,
                nstep=self._substeps,
                state=self._states,
            )
            np.copyto(state, last)
        return state, time.perf_counter() - started

    def close(self) -> None:
        self._rollout.close()


class BareWarp:
    """MuJoCo Warp and nothing else: a captured graph a control step, with the model and the room of ours.

    Args:
        physics: whose Warp model, data and graphs are used; its own state stays as it is.
        substeps: physics steps in a control step.
    """

    def __init__(self, physics: WarpPhysics, substeps: int) -> None:
        self._physics = physics
        self._substeps = substeps

    def load(self, qpos: torch.Tensor, qvel: torch.Tensor) -> None:
        """Puts all copies into states, shapes ``(num_envs, nq)`` and ``(num_envs, nv)``."""
        self._physics._qpos32.copy_(qpos)
        self._physics._qvel32.copy_(qvel)

    def replay(self, actions: torch.Tensor) -> None:
        """Steps all copies under actions, shape ``(num_envs, steps, nu)``."""
        for control in actions.unbind(1):
            self._physics._control.copy_(control)
            self._physics._launch(self._substeps)


def state_of(env: TransformedEnv) -> np.ndarray:
    """A copy of the full physics states, shape ``(num_envs, 1 + nq + nv)``; has no public name.

    The first column is MuJoCo's clock, which every control step sets anew.
    """
    return env.base_env._physics._state.copy()


def plain_model(task: WalkAway, fused: bool = False) -> mujoco.MjModel:
    """The same robot under MuJoCo's plain defaults, with every module a body of its own.

    Args:
        task: the robot on its ground.
        fused: keep modules fused that do not move against one another.
    """
    root = ElementTree.fromstring(task.root_entity.mjcf_model.to_xml_string())
    for path, attribute in SAVINGS:
        if fused and attribute == "fusestatic":
            continue
        for element in root.findall(path):
            if attribute is None:
                element.clear()
            else:
                element.attrib.pop(attribute, None)
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))


def with_numerics_of(model: mujoco.MjModel, source: mujoco.MjModel) -> mujoco.MjModel:
    """A copy of a model whose contacts are as soft, and whose solver starts as cold, as another's.

    MuJoCo scales the softness of a contact by the inverse weight of the body that the geom is part
    of, which fusing bodies changes. What is then left between two models should be bookkeeping.
    """
    model = copy.copy(model)
    model.opt.disableflags = source.opt.disableflags
    for geom in range(model.ngeom):
        body = source.geom(model.geom(geom).name).bodyid
        model.body_invweight0[model.geom_bodyid[geom]] = source.body_invweight0[body]
    return model
