"""The orientation of a body, in the representation that suits the policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from tensordict.utils import NestedKey
from torchrl.data import TensorSpec, Unbounded

from locomotion.transforms.keys import EntryTransform, pairs_of_keys, require_floating, vector


class IncludeOrientation(EntryTransform):
    """Writes an orientation, read from a unit quaternion, as an entry of its own.

    With ``R`` the rotation matrix from the body's frame to the world's, the entry is

    - ``"quaternion"``: the quaternion itself, ``(*batch, 4)``;
    - ``"rotation_6d"``: the first two columns of ``R``, one after the other, ``(*batch, 6)``;
      unlike a quaternion it is continuous and unique (Zhou et al. 2019, "On the Continuity of
      Rotation Representations in Neural Networks", section 4.2);
    - ``"gravity"``: the direction of gravity in the body's frame, ``(*batch, 3)``, which tells tilt
      but not heading;
    - ``"yaw"``: the heading, the angle (rad, in [-pi, pi]) from the world's x axis to the body's x
      axis projected on the ground, ``(*batch, 1)``.

    Args:
        representation: one of the four above.
        in_keys: entries that hold a unit quaternion w x y z, alone or, with ``part``, among other
            numbers.
        out_keys: where the orientations go.
        part: where in the last dimension the quaternion stands, such as ``slice(1, 5)`` for
            Gymnasium's ``Ant``; ``None`` if the entry is the quaternion.

    Raises:
        ValueError: for an unknown representation, numbers of keys that differ, or a ``part`` that is not
            a slice; when added to an environment, or used, if an entry does not hold four floating point
            numbers there.
        KeyError: when added to an environment, or used, where an entry of ``in_keys`` is not there.

    Examples:
        >>> from torchrl.envs import GymEnv, TransformedEnv
        >>> tilt = IncludeOrientation("gravity", ["observation"], ["tilt"], part=slice(1, 5))
        >>> env = TransformedEnv(GymEnv("Ant-v5"), tilt)
        >>> env.reset()["tilt"].shape
        torch.Size([3])
    """

    def __init__(
        self,
        representation: str = "quaternion",
        in_keys: Sequence[NestedKey] | NestedKey = "core_orientation",
        out_keys: Sequence[NestedKey] | NestedKey = "orientation",
        part: slice | None = None,
    ) -> None:
        if not isinstance(representation, str) or representation not in _REPRESENTATIONS:
            raise ValueError(
                f"representation {representation!r} must be one of {', '.join(_REPRESENTATIONS)}"
            )
        if part is not None and not isinstance(part, slice):
            raise ValueError(f"part must be a slice, such as slice(1, 5), or None, got {part!r}")
        in_keys, out_keys = pairs_of_keys(in_keys, out_keys)
        super().__init__(in_keys=in_keys, out_keys=out_keys)
        self.representation = representation
        self.part = part
        self.representation = representation
        self._convert, self._size = _REPRESENTATIONS[representation]

    def _apply_transform(self, obs: torch.Tensor) -> torch.Tensor:
        quaternion = obs if self.part is None else obs[..., self.part]
        if quaternion.shape[-1:] != (4,):
            raise ValueError(self._not_four(self.in_keys, quaternion.shape[-1:].numel()))
        orientation = self._convert(quaternion)
        return orientation.clone() if orientation is quaternion else orientation

    def _not_four(self, key: object, numbers: int) -> str:
        return f"IncludeOrientation: {key!r} holds {numbers} numbers, a quaternion takes 4"

    def _reset(self, tensordict, tensordict_reset):
        return self._call(tensordict_reset)

    def mirror_matrix(self, matrix: np.ndarray) -> np.ndarray | None:
        """The matrix that maps what is written to that of a mirror image.

        Args:
            matrix: maps the quaternion, shape ``(4, 4)``.

        Returns:
            The matrix; ``None`` where none does so: a yaw in a mirror of the x and y axes is another angle for
            a body that leans.
        """
        reflection = -matrix[
            1:, 1:
        ]  # quaternions hold an axis of rotation, which a mirror also turns round
        if self.part is not None:
            return None
        if self.representation == "quaternion":
            return matrix
        if self.representation == "gravity":
            return reflection
        if self.representation == "rotation_6d":
            return np.kron(reflection[:2, :2].T, reflection)
        return -np.eye(1) if reflection[0, 1] == 0 else None

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        for in_key, out_key in zip(self.in_keys, self.out_keys):
            spec = vector(observation_spec, in_key, self)
            require_floating(spec, in_key, self)
            length = len(range(spec.shape[-1])[self.part or slice(None)])
            if length != 4:
                raise ValueError(self._not_four(in_key, length))
            observation_spec[out_key] = Unbounded(
                (*spec.shape[:-1], self._size), dtype=spec.dtype, device=spec.device
            )
        return observation_spec


def _rotation_6d(quaternion: torch.Tensor) -> torch.Tensor:
    w, x, y, z = quaternion.unbind(-1)
    columns = [
        1 - 2 * (y * y + z * z),
        2 * (x * y + w * z),
        2 * (x * z - w * y),
        2 * (x * y - w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z + w * x),
    ]
    return torch.stack(columns, -1)


def _gravity(quaternion: torch.Tensor) -> torch.Tensor:
    w, x, y, z = quaternion.unbind(-1)
    up = [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
    return -torch.stack(up, -1)


def _yaw(quaternion: torch.Tensor) -> torch.Tensor:
    w, x, y, z = quaternion.unbind(-1)
    return torch.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)).unsqueeze(-1)


#: By name: the conversion, and how many numbers it gives.
_REPRESENTATIONS: dict[str, tuple[Callable[[torch.Tensor], torch.Tensor], int]] = {
    "quaternion": (lambda quaternion: quaternion, 4),
    "rotation_6d": (_rotation_6d, 6),
    "gravity": (_gravity, 3),
    "yaw": (_yaw, 1),
}
