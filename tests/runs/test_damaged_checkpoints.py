"""Checkpoints that are damaged, or a stranger's, are named and never believed."""

import os
import zipfile

import pytest
import torch

from locomotion import train
from locomotion.runs import RunError
from locomotion.runs.checkpoints import Checkpoints, path_of
from locomotion.training.build import make_env, make_learner

pytestmark = pytest.mark.slow

DAMAGES = {
    "cut": lambda content: content[: len(content) // 2],
    "emptied": lambda content: b"",
    "flipped": lambda content: (
        content[: len(content) // 2]
        + bytes([content[len(content) // 2] ^ 1])
        + content[len(content) // 2 + 1 :]
    ),
    "not one": lambda content: b"gecko" * 99,
}


def new_policy(config):
    return make_learner(config, make_env(config)).policy


@pytest.mark.parametrize("damage", [*DAMAGES, "removed"])
def test_one_that_is_damaged_is_named_and_the_one_before_taken(
    configured, outcome, whole, left_after, tmp_path, damage, capsys
):
    folder = left_after(tmp_path / "run", 6)
    path = path_of(folder, 6)
    if damage == "removed":
        path.unlink()
    else:
        path.write_bytes(DAMAGES[damage](path.read_bytes()))
    train(configured(), folder)
    warnings = [line for line in capsys.readouterr().err.splitlines() if "warning" in line]
    assert len(warnings) == (damage != "removed")
    assert all(str(path) in line for line in warnings)
    assert outcome(folder) == outcome(whole)


def test_without_one_that_is_whole_the_run_is_refused(configured, left_after, tmp_path, capsys):
    folder = left_after(tmp_path / "run", 4)
    for iteration in (2, 4):
        path_of(folder, iteration).write_bytes(b"gecko")
    before = (folder / "metrics.csv").read_bytes()
    with pytest.raises(RunError, match="holds no checkpoint that is whole"):
        train(configured(), folder)
    assert (folder / "metrics.csv").read_bytes() == before
    assert capsys.readouterr().err.count("warning") == 2


def test_every_flipped_bit_is_found(configured, left_after, tmp_path, capsys):
    folder = left_after(tmp_path / "run", 2)
    path = path_of(folder, 2)
    content = path.read_bytes()
    policy = new_policy(configured())
    checkpoints = Checkpoints(folder, policy=policy)
    assert checkpoints.load_latest() == 2
    expected = {name: value.clone() for name, value in policy.state_dict().items()}
    directory = content.rindex(b"PK\x05\x06") - 700  # the end of the archive's table of contents
    some = [*range(0, directory, directory // 60), *range(directory, len(content), 3)]
    found = 0
    for place in some:
        changed = bytearray(content)
        changed[place] ^= 1 << place % 8
        path.write_bytes(changed)
        with torch.no_grad():
            for parameter in policy.parameters():
                parameter.zero_()
        try:
            checkpoints.load_latest()
        except RunError as error:
            assert str(folder) in str(error)
            found += 1
        else:  # a date, or what is repeated elsewhere
            for name, value in policy.state_dict().items():
                assert torch.equal(value, expected[name])
    assert found > len(some) / 2


class Bomb:
    """Unpickled, it leaves a folder behind."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("where", ["in place of weights", "next to them"])
def test_a_strangers_runs_no_code(configured, whole, left_after, tmp_path, where, capsys):
    folder, crater = left_after(tmp_path / "run", 2), tmp_path / "crater"
    good = path_of(whole, 2)
    torch.save(Bomb(crater), tmp_path / "bomb.pt")
    with zipfile.ZipFile(good) as source, zipfile.ZipFile(path_of(folder, 2), "w") as target:
        (weights,) = [name for name in source.namelist() if name.endswith("policy/state.pt")]
        bomb = weights if where == "in place of weights" else f"{weights[:-3]}/other.pickle"
        for member in source.namelist():
            if member != bomb:
                target.writestr(member, source.read(member))
        target.writestr(bomb, (tmp_path / "bomb.pt").read_bytes())
    with pytest.raises(RunError):
        Checkpoints(folder, policy=new_policy(configured())).load_latest()
    assert not crater.exists()
    torch.load(tmp_path / "bomb.pt", weights_only=False)
    assert crater.exists()  # it would have gone off
