"""Mirror images of what was sampled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from tensordict import TensorDictBase
from tensordict.utils import NestedKey
from torchrl.envs import Transform

from locomotion.transforms.keys import vector


class RandomMirror(Transform):
    """Replaces each sampled frame by itself or by one of its mirror images, each with the same chance.

    For a replay buffer that an on-policy learner samples from: the images of a frame keep its advantage, its
    value target and its log-probability, as the mirrored policy would have taken the mirrored action with that
    probability. Each image is given by the matrices that map the entries of a frame to those of the image.

    Args:
        images: for each mirror the matrices by key, of shape ``(n, n)`` for an entry of shape ``(*batch, n)``.

    Raises:
        ValueError: if there is no image, or two do not have the same keys; when used, if an entry is a number.
        KeyError: when used, where an entry is not there.

    Examples:
        >>> from tensordict import TensorDict
        >>> from torchrl.data import LazyTensorStorage, ReplayBuffer
        >>> swapped = {"action": torch.tensor([[0.0, 1.0], [1.0, 0.0]])}
        >>> buffer = ReplayBuffer(
        ...     storage=LazyTensorStorage(8), transform=RandomMirror([swapped]), batch_size=8
        ... )
        >>> _ = buffer.extend(TensorDict({"action": torch.tensor([[1.0, 2.0]]).expand(8, 2)}, [8]))
        >>> buffer.sample()["action"].sum(-1)
        tensor([3., 3., 3., 3., 3., 3., 3., 3.])
    """

    def __init__(self, images: Sequence[Mapping[NestedKey, torch.Tensor]]) -> None:
        if not images or any(image.keys() != images[0].keys() for image in images):
            raise ValueError("images must be one or more, with a matrix for each of the same keys")
        keys = list(images[0])
        super().__init__(in_keys=keys, out_keys=keys)
        self._images = len(images)
        for index, key in enumerate(keys):
            matrices = [image[key] for image in images]
            self.register_buffer(
                f"matrices_{index}",
                torch.stack([torch.eye(len(matrices[0])).to(matrices[0]), *matrices]),
            )

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Draws an image for each frame of a sample, shape ``(*batch,)``, and writes it in its place."""
        which = torch.randint(1 + self._images, tensordict.batch_size, device=tensordict.device)
        for index, key in enumerate(self.in_keys):
            value = vector(tensordict, key, self)
            images = torch.einsum("mij,...j->m...i", self.get_buffer(f"matrices_{index}"), value)
            chosen = which.to(value.device)[None, ..., None]
            tensordict.set(key, images.take_along_dim(chosen, 0).squeeze(0))
        return tensordict
