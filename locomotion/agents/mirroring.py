"""The mirror images of what a robot senses and does, for bodies that have a mirror."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import torch
from tensordict.utils import NestedKey
from torchrl.envs import Compose, EnvBase, ObservationNorm, Transform, TransformedEnv

from locomotion.options import ConfigError, readings
from locomotion.robots.symmetry import Mirror, mirrors

#: Matrices by key; ``None`` for an entry of which no image is known.
Image = dict[NestedKey, np.ndarray | None]


def mirror_images(env: EnvBase, keys: Iterable[NestedKey]) -> list[dict[NestedKey, torch.Tensor]]:
    """Finds how observations and actions of a robot become those of its mirror images.

    Args:
        env: an environment whose robots are those of a :class:`~locomotion.envs.LocomotionEnv`. What its
            transforms write is followed back to readings; a transform of one's own takes part by a method
            ``mirror_matrix``, as that of :class:`~locomotion.transforms.HingeHistory` is.
        keys: the entries that are observed.

    Returns:
        For each mirror of the body the matrices by key, those of the observations and of ``"action"``.

    Raises:
        ConfigError: if the body has no mirror, or something is not known to be the same in a mirror.
    """
    task = getattr(getattr(env, "base_env", env), "task", None)
    if task is None:
        raise ConfigError(
            "ppo.symmetry=True needs robots of a LocomotionEnv, whose bodies it knows"
        )
    for reward in task.rewards:
        if not reward.MIRRORED:
            raise ConfigError(
                f"ppo.symmetry=True needs rewards that mirror images are paid too; {type(reward).__name__}"
                " is not known to be one (Reward.MIRRORED)"
            )
    found = mirrors(task.robot.body)
    if not found:
        name = task.robot.mjcf_model.model
        raise ConfigError(f"ppo.symmetry=True needs a body with a mirror; robot={name} has none")
    return [_image(env, [*dict.fromkeys(keys)], mirror) for mirror in found]


def _image(env: EnvBase, keys: list[NestedKey], mirror: Mirror) -> dict[NestedKey, torch.Tensor]:
    known: Image = {name: None for name in env.observation_spec.keys(True, True)}
    for name in readings.names():
        reading = readings.get(name, "reading")
        known[name] = None if reading.mirror is None else reading.mirror(mirror)
    for transform in _transforms(env):
        known.update(_written(transform, known))
    image = {"action": torch.tensor(mirror.hinge_matrix, dtype=env.action_spec.dtype)}
    for key in keys:
        matrix, spec = known.get(key), env.observation_spec[key]
        if matrix is None:
            raise ConfigError(
                f"ppo.symmetry=True needs entries with a mirror image; {key!r} has none"
            )
        image[key] = torch.tensor(matrix, dtype=spec.dtype)
    return {key: matrix.to(env.action_spec.device) for key, matrix in image.items()}


def _transforms(env: EnvBase) -> Iterator[Transform]:
    if isinstance(env, TransformedEnv):
        yield from _transforms(env.base_env)
        chain = env.transform
        yield from chain if isinstance(chain, Compose) else [chain]


def _written(transform: Transform, known: Image) -> Image:
    """The matrices of what a transform writes, by those of what it reads."""
    written: Image = {}
    for in_key, out_key in zip(transform.in_keys, transform.out_keys):
        matrix = known.get(in_key)
        if matrix is None or in_key == "action":
            written[out_key] = None
        elif hasattr(transform, "mirror_matrix"):
            written[out_key] = transform.mirror_matrix(matrix)
        elif isinstance(transform, ObservationNorm) and _is_factor(transform):
            written[out_key] = matrix
        else:
            written[out_key] = None
    return written


def _is_factor(norm: ObservationNorm) -> bool:
    """Whether all numbers of an entry are multiplied by the same one, and no more."""
    return norm.scale.numel() == 1 and not norm.loc.any()
