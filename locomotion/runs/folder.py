"""The folder of a run: the configuration it was started with, and whether it is finished.

Nothing here imports anything heavy, so that a whole sweep is checked before torch is loaded.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from locomotion.config import Config, as_dict, free_keys, typed_config
from locomotion.options import flat
from locomotion.writing import atomic_write


class RunError(ValueError):
    """A folder that is not a run, or not the one that is wanted; the message is one line that names it."""


class RunStopped(RuntimeError):
    """A run that cannot go on, such as with a full disk; the message is one line that says why."""


def require_writable(folder: Path) -> None:
    """Raises a :class:`RunError` if nothing can be written to a folder, which need not exist yet."""
    try:
        paths = (folder, *folder.absolute().parents)
        there = next(path for path in paths if path.exists() or path.is_symlink())
        if not there.exists():
            raise RunError(f"{folder} cannot be written: {there} is a link that leads nowhere")
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        raise RunError(f"{folder} cannot be written: {error.strerror}") from error


def record(folder: Path, **files: Any) -> None:
    """Writes the start of a run into ``.hydra/``, where Hydra would write it.

    Hydra itself writes before it calls the job, so it would also write into the folder of a finished
    run, which a sweep only skips.

    Args:
        folder: the run's folder.
        files: for each file its name without ``.yaml`` and its content.
    """
    place = folder / ".hydra"
    place.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        with atomic_write(place / f"{name}.yaml") as partial:
            OmegaConf.save(content, partial)


def read_config(folder: Path) -> dict[str, Any]:
    """The configuration that a run was started with.

    Plain values: a run of another version may have keys that the schema has not.

    Raises:
        RunError: if there is none, or it cannot be read.
    """
    path = folder / ".hydra" / "config.yaml"
    try:
        content = OmegaConf.to_container(OmegaConf.load(path), resolve=True)
    except FileNotFoundError:
        raise RunError(
            f"{folder} holds no .hydra/config.yaml, so it is not a run's folder"
        ) from None
    except RecursionError:
        raise RunError(f"{path} is nested too deeply") from None
    except (OSError, ValueError, yaml.YAMLError, OmegaConfBaseException) as error:
        raise RunError(f"{path} cannot be read: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise RunError(f"{path} holds no configuration")
    return content


def read_record(folder: Path) -> dict[str, Any]:
    """The configuration that a run was started with, by keys such as ``ppo.gamma``.

    Raises:
        RunError: if there is none, or it cannot be read.
    """
    return dict(flat(read_config(folder)))


def typed_record(
    saved: Mapping[str, Any],
    change: Callable[[DictConfig], object] = lambda content: None,
    learning: bool = False,
) -> Config:
    """A run from the configuration it was started with, which may be a stranger's.

    Its plugins are not imported. Without learning, what the run was shown in need not be installed, and
    what its critic alone sees need not be read.

    Args:
        saved: plain values, as :func:`read_config` returns them.
        change: changes the values in place before they are typed.
        learning: whether something is to be learned.

    Raises:
        ConfigError: for a run of another version, or a change that cannot be used.
    """
    content = OmegaConf.create({**saved, "plugins": []})
    if not learning:
        content.logger = content.critic = {}
    change(content)
    return typed_config(content, learning)


def read_passed(folder: Path) -> dict[str, Any]:
    """Names of the objects of somebody's own that a run was trained with, by argument."""
    path = folder / ".hydra" / "passed.yaml"
    try:
        return dict(OmegaConf.to_container(OmegaConf.load(path)))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, yaml.YAMLError, OmegaConfBaseException) as error:
        raise RunError(f"{path} cannot be read: {' '.join(str(error).split())}") from error


def _listed(passed: Mapping[str, Any] | None) -> str:
    return ", ".join(f"{key}={value}" for key, value in (passed or {}).items()) or "nothing passed"


def is_finished(folder: Path, config: Config, passed: Mapping[str, Any] | None = None) -> bool:
    """Whether a folder holds the whole run of a configuration: rows, last checkpoint, picture.

    If not, the run may start there, or go on with what an interrupted one left.

    Args:
        folder: the run's folder, which need not exist.
        config: the run that is wanted.
        passed: names of the objects of somebody's own that it is trained with, by argument.

    Raises:
        RunError: if the folder holds a run of another configuration or with other objects. Keys that
            do not change a run's numbers may differ.
    """
    metrics = folder / "metrics.csv"
    if not metrics.is_file():
        return False
    for there, asked in differences(folder, config).values():
        raise RunError(f"{folder} holds a run with {there}; with {asked} it needs another folder")
    before = read_passed(folder)
    if before != dict(passed or {}):
        raise RunError(f"{folder} holds a run with {_listed(before)}, not with {_listed(passed)}")
    iterations = config.learner.iterations
    rows = metrics.read_bytes().count(b"\n") - 1
    last = folder / "checkpoints" / f"{iterations:06d}.ckpt"
    picture = folder / "learning_curve.png"
    return rows == iterations and last.is_file() and picture.is_file()


def differences(folder: Path, config: Config) -> dict[str, tuple[str, str]]:
    """In what the run in a folder differs from a configuration: by key, what is there and asked for.

    Keys that do not change a run's numbers are left out.

    Raises:
        RunError: if the folder does not hold a run.
    """
    wanted = dict(flat(as_dict(config)))
    found = read_record(folder)
    free = free_keys()

    def shown(values: Mapping[str, Any], key: str) -> str:
        if key not in values:
            return f"no {key}"
        return f"{key}={'null' if values[key] is None else values[key]}"

    return {
        key: (shown(found, key), shown(wanted, key))
        for key in {**wanted, **found}
        if key not in free and shown(found, key) != shown(wanted, key)
    }
