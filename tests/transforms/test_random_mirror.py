"""Mirror images in a replay buffer."""

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import LazyTensorStorage, ReplayBuffer

from locomotion.transforms import RandomMirror

SWAPPED = {"seen": torch.tensor([[0.0, 1.0], [1.0, 0.0]]), "action": -torch.eye(3)}
DOUBLED = {"seen": 2 * torch.eye(2), "action": torch.ones(3, 3)}


def frames(count):
    return TensorDict(
        {"seen": torch.rand(count, 2), "action": torch.rand(count, 3), "row": torch.arange(count)},
        [count],
    )


@pytest.mark.parametrize("images", [[SWAPPED], [SWAPPED, DOUBLED]])
def test_a_frame_becomes_itself_or_one_of_its_images_all_equally_often(images):
    stored = frames(3000)
    buffer = ReplayBuffer(
        storage=LazyTensorStorage(3000), transform=RandomMirror(images), batch_size=3000
    )
    buffer.extend(stored)
    sample = buffer.sample()
    whole = stored[sample["row"]]
    unit = {"seen": torch.eye(2), "action": torch.eye(3)}
    found = torch.stack(
        [
            torch.cat(
                [torch.isclose(sample[key], whole[key] @ image[key].T) for key in image], -1
            ).all(-1)
            for image in (unit, *images)
        ]
    )
    assert (found.sum(0) == 1).all()  # all entries of a frame are those of one image
    share = 1 / (1 + len(images))
    assert found.double().mean(-1).tolist() == pytest.approx([share] * len(found), abs=0.05)


def test_what_is_stored_stays_as_it_is():
    buffer = ReplayBuffer(
        storage=LazyTensorStorage(8), transform=RandomMirror([SWAPPED]), batch_size=8
    )
    stored = frames(8)
    buffer.extend(stored)
    for _ in range(3):
        buffer.sample()
    assert (buffer.storage[:]["action"] == stored["action"]).all()


@pytest.mark.parametrize("images", [[], [SWAPPED, {"seen": torch.eye(2)}]])
def test_images_without_the_same_keys_are_refused(images):
    with pytest.raises(ValueError, match="a matrix for each of the same keys"):
        RandomMirror(images)


def test_an_entry_that_is_not_there_is_named():
    with pytest.raises(KeyError, match="no entry 'seen'"):
        RandomMirror([SWAPPED])(frames(2).exclude("seen"))
