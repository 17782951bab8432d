"""The command lines of what is done with a policy: watching, evaluating and exporting it.

They speak training's language of overrides. ``robot=NAME`` takes the policy that ships for a robot,
``run=FOLDER`` one that was trained; the task it was trained on can be changed on top by keys of
``physics`` and ``env``, and the command has keys of its own.
"""

from __future__ import annotations

import dataclasses
import difflib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from omegaconf import OmegaConf

from locomotion.command_line.composing import amend, parse, register
from locomotion.command_line.refusal import refuse, require_writable
from locomotion.config import (
    GROUPS,
    Config,
    ConfigError,
    EnvConfig,
    PhysicsConfig,
    conf_dir,
    load,
    load_file,
    typed,
)
from locomotion.runs import RunError, read_config

T = TypeVar("T")

#: Policies that come along, each the folder of a run that holds nothing but its configuration and a
#: checkpoint of the actor.
POLICIES = Path(__file__).resolve().parents[1] / "data" / "policies"

#: Parts of the task that may be changed under a policy, beside the seed.
_CHANGEABLE = {"env": EnvConfig, "physics": PhysicsConfig}

_HELP = """{what}

{examples}

Keys of this command, set by KEY=VALUE
{keys}

Keys of the task, as the policy was trained on it unless set
{task}

--help shows this.
"""


def command(
    name: str,
    schema: type[T],
    job: Callable[[Path, Config, T], None],
    what: str,
    examples: str,
    num_envs: int | None = None,
) -> None:
    """Runs ``job(folder, config, options)`` for the policy that the command line names.

    What cannot be used ends the process with one line on standard error and exit status 2.

    Args:
        name: of the command; ``conf/NAME.yaml`` has the values of its keys.
        schema: dataclass of its keys.
        job: gets the run's folder, the configuration to walk with, and the command's keys.
        what: the first line of ``--help``.
        examples: some command lines with their meanings.
        num_envs: how many robots there always are; ``None`` leaves it open.
    """
    fixed: dict[str, Any] = {"time_limit": None}  # a walk is as long as the command says
    if num_envs is not None:
        fixed["num_envs"] = num_envs
    register()
    arguments = sys.argv[1:]
    if {"--help", "-h"} & {*arguments}:
        print(_help(name, schema, fixed, what, examples))
        return
    try:
        job(*_asked(name, schema, fixed, arguments))
    except (ConfigError, RunError) as error:
        refuse(str(error))
    except OSError as error:
        refuse(f"{error.filename or name}: {error.strerror or error}", status=1)
    except KeyboardInterrupt:
        refuse("interrupted", status=130)


def shipped() -> list[str]:
    """Robots for which a policy comes along."""
    return sorted(folder.name for folder in POLICIES.iterdir() if folder.is_dir())


def _asked(
    name: str, schema: type[T], fixed: Mapping[str, Any], arguments: list[str]
) -> tuple[Path, Config, T]:
    flags = [argument for argument in arguments if argument.startswith("-")]
    if flags:
        raise ConfigError(f"{flags[0]} is no flag of this command; --help shows what there is")
    overrides = parse(arguments, "for a policy that has been trained")
    names = {field.name for field in dataclasses.fields(schema)}
    chosen: dict[str, Any] = {}
    own, task = {}, []
    for override in overrides:
        key, value = override.key_or_group, override.value()
        if key in ("robot", "run"):
            chosen[key] = str(value)
        elif key in names:
            own[key] = value
        elif key.split(".")[0] in _CHANGEABLE or key == "seed":
            task.append(override)
        else:
            raise ConfigError(_misplaced(key, names))
    folder = _folder(**chosen)
    saved = OmegaConf.create(read_config(folder))
    for part in ("env", "physics", "ppo"):
        if not OmegaConf.is_dict(saved.get(part)):
            raise RunError(
                f"{folder} holds no run of this project: its configuration has no {part}"
            )
    saved.env.update(fixed)
    saved.logger = load("logger/csv")  # what a run was shown in need not be installed here
    # Nothing learns here, so no batch has a say in how many robots there are.
    saved.ppo.update(steps=1, minibatch_size=1, cudagraphs=False)
    amend(saved, task)
    config = typed(Config, saved)
    config.physics.require()
    for key, value in fixed.items():
        if getattr(config.env, key) != value:
            raise ConfigError(f"env.{key} is {'null' if value is None else value} in this command")
    options = load_file(conf_dir() / f"{name}.yaml", schema, own)
    if hasattr(options, "output"):
        _require_place(options.output)
    return folder, config, options


def _require_place(output: str | None) -> None:
    """Looks whether a file can be written where it is wanted, before anything is computed for it."""
    home = Path() if output is None else Path(output).parent
    if not home.is_dir():
        raise ConfigError(f"output={output}: there is no folder {home}")
    require_writable(home)


def _folder(robot: str | None = None, run: str | None = None) -> Path:
    if run is None:
        robot = robot or "gecko"
        if robot not in shipped():
            raise ConfigError(
                f"robot={robot} has no policy that comes along; choose from {', '.join(shipped())},"
                " or run=FOLDER for one that was trained"
            )
        return POLICIES / robot
    if robot is not None:
        raise ConfigError(f"robot={robot} and run={run} name two policies; give one of them")
    return Path(run)


def _misplaced(key: str, options: set[str]) -> str:
    known = [*sorted(options), "robot", "run", "seed", *_CHANGEABLE]
    group = key.split(".")[0]
    if group in GROUPS or group in {field.name for field in dataclasses.fields(Config)}:
        return f"{key} is settled by training; what may change is {', '.join(known)}"
    close = difflib.get_close_matches(key, known, n=1)
    hint = f"did you mean {close[0]}? " if close else ""
    return f"{key} is no key; {hint}allowed are {', '.join(known)}"


def _help(name: str, schema: type, fixed: Mapping[str, Any], what: str, examples: str) -> str:
    values = dataclasses.asdict(load_file(conf_dir() / f"{name}.yaml", schema))
    own = [
        ("robot", f"a policy that comes along: {', '.join(shipped())} [gecko]"),
        ("run", "the folder of a run, in place of robot"),
    ]
    for field in dataclasses.fields(schema):
        value = values[field.name]
        shown = yaml.safe_dump(value).split("\n")[0]
        own.append((field.name, f"{field.metadata['meaning']} [{shown}]"))
    task = [("seed", "of how robots start, and of everything else that is random")]
    task += [
        (f"{group}.{field.name}", field.metadata["meaning"])
        for group, part in _CHANGEABLE.items()
        for field in dataclasses.fields(part)
        if not (group == "env" and field.name in fixed)
    ]
    width = max(len(key) for key, _ in [*own, *task])

    def listed(keys: list[tuple[str, str]]) -> str:
        return "\n".join(f"  {key:{width}}  {meaning}" for key, meaning in keys)

    return _HELP.format(what=what, examples=examples, keys=listed(own), task=listed(task)).rstrip()
