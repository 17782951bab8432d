"""Small runs, what they come to, and how they are stopped."""

import csv
import io
import zipfile

import pytest
import torch

from locomotion import compose, train
from locomotion.runs.checkpoints import saved

#: Eight iterations of eight steps, with a time limit that ends episodes in the middle of them.
SMALL = (
    *("robot=ant", "+obs=history3", "env.num_envs=3", "env.time_limit=5", "ppo.steps=8"),
    *("ppo.minibatch_size=10", "ppo.iterations=8", "checkpoint_interval=2", "physics.threads=1"),
)


@pytest.fixture(scope="session")
def small():
    """The overrides of a small run."""
    return SMALL


@pytest.fixture(scope="session")
def configured():
    """The configuration of a small run."""
    return lambda *overrides: compose(*SMALL, *overrides)


def leaves(content, place=""):
    """Tensors as bytes, everything else as it is, by where it is in nested containers."""
    if isinstance(content, torch.Tensor):
        yield place, (content.dtype, content.shape, content.numpy().tobytes())
    elif isinstance(content, (dict, list, tuple)):
        items = content.items() if isinstance(content, dict) else enumerate(content)
        for key, value in items:
            # Of the generators only torch's is used; the others differ from process to process.
            if not place.endswith("random/state.pt") or key not in ("python", "numpy"):
                yield from leaves(value, f"{place}/{key}")
    else:
        yield place, content


@pytest.fixture(scope="session")
def outcome():
    """Reads what a run came to: its rows but for timings, its last checkpoint's name and all that is in it."""

    def read(folder):
        with (folder / "metrics.csv").open() as file:
            rows = [
                {key: value for key, value in row.items() if not key.endswith("_seconds")}
                for row in csv.DictReader(file)
            ]
        last = saved(folder)[-1]
        found = {}
        with zipfile.ZipFile(last) as archive:
            for name in archive.namelist():
                if name.endswith(".pt"):
                    state = torch.load(io.BytesIO(archive.read(name)), weights_only=True)
                    found.update(leaves(state, name))
        assert len(found) > 20
        return rows, last.name, found

    return read


class Stopped(Exception):
    """Ways to stop a run."""


@pytest.fixture(scope="session")
def stop_after():
    """Trains until a number of iterations have been recorded, the last of them perhaps not saved."""

    def run(iterations, config, folder, **passed):
        def stop(row):
            if row["iteration"] == iterations - 1:
                raise Stopped

        with pytest.raises(Stopped):
            train(config, folder, callbacks=[stop], **passed)

    return run


@pytest.fixture(scope="session")
def whole(tmp_path_factory):
    """The folder of a small run that was never stopped."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    train(compose(*SMALL), folder)
    return folder


@pytest.fixture(scope="session")
def left_after(whole):
    """Makes the folder of the same run as it is after a number of iterations and a bit of the next ones."""

    def make(folder, iterations):
        (folder / "checkpoints").mkdir(parents=True)
        (folder / ".hydra").mkdir()
        for path in (whole / ".hydra").iterdir():
            (folder / ".hydra" / path.name).write_bytes(path.read_bytes())
        for path in saved(whole):
            if int(path.stem) <= iterations:
                (folder / "checkpoints" / path.name).write_bytes(path.read_bytes())
        rows = (whole / "metrics.csv").read_bytes().splitlines(keepends=True)
        (folder / "metrics.csv").write_bytes(b"".join(rows[: iterations + 2])[:-7])
        return folder

    return make
