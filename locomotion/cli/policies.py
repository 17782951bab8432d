"""The command lines of what is done with a policy: watching, evaluating and exporting it.

They speak training's language of overrides. ``robot=NAME`` takes the policy that ships for a robot,
``run=FOLDER`` one that was trained; the task can be changed on top by keys of ``env``, ``physics`` and
``arena``, and the command has keys of its own.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from locomotion.cli.composing import amended, parse
from locomotion.cli.help import listed
from locomotion.cli.refusal import refusing
from locomotion.config import GROUPS, Config
from locomotion.evaluation.shipped import policy_folder, shipped
from locomotion.options import ConfigError, choices, described, learners, suggestion, summary, typed
from locomotion.quiet import quiet
from locomotion.runs import RunError, read_config, require_writable

#: Parts of a run that may be changed under a policy.
_CHANGEABLE = ("env", "physics", "disturbances", "arena", "seed", "plugins")
#: Those of them that are chosen by name.
_GROUPS = {
    "arena": "what robots walk on",
    "disturbances": "what disturbs them, nothing unless set",
    "physics": "what steps them",
}

_HELP = """{title}

{examples}

Keys of this command, set by KEY=VALUE, with their range and [default]
{keys}

Keys of the task, as the policy was trained on it unless set
{task}

--help shows this.
"""


@dataclasses.dataclass(frozen=True)
class Command:
    """One of the commands.

    Attributes:
        schema: dataclass of its keys.
        job: gets the run's folder, the configuration to walk with, and the command's keys.
        title: the first line of ``--help``.
        examples: some command lines with their meanings.
        num_envs: how many robots there always are; ``None`` leaves it open.
        usual_envs: how many robots there are unless ``env.num_envs`` is set; ``None`` takes the number of training.
        check: looks, before torch is loaded, whether this machine can do it.
    """

    schema: type
    job: Callable[[Path, Config, Any], None]
    title: str
    examples: str
    num_envs: int | None = None
    usual_envs: int | None = None
    check: Callable[[Any], None] | None = None

    def main(self) -> None:
        """Does what the command line asks for.

        What cannot be used ends the process with one line on standard error and exit status 2.
        """
        with refusing():
            if {"--help", "-h"} & {*sys.argv[1:]}:
                print(self._help())
                return
            folder, config, options = self._asked(sys.argv[1:])
            if self.check is not None:
                self.check(options)
            with quiet():
                self.job(folder, config, options)

    @property
    def _fixed(self) -> dict[str, Any]:
        # A walk is as long as the command says.
        fixed: dict[str, Any] = {"time_limit": None, "stagger": False}
        return fixed if self.num_envs is None else {**fixed, "num_envs": self.num_envs}

    def _asked(self, arguments: list[str]) -> tuple[Path, Config, Any]:
        flags = [argument for argument in arguments if argument.startswith("-")]
        if flags:
            raise ConfigError(f"{flags[0]} is not a flag of this command; --help shows its keys")
        overrides = parse(arguments, "for a policy that has been trained")
        names = {field.name for field in dataclasses.fields(self.schema)}
        chosen: dict[str, Any] = {}
        own, task = {}, []
        for override in overrides:
            key, value = override.key_or_group, override.value()
            if key in ("robot", "run"):
                chosen[key] = str(value)
            elif key in names:
                own[key] = value
            elif key.split(".")[0] in _CHANGEABLE:
                task.append(override)
            else:
                raise ConfigError(_misplaced(key, names))
        folder = policy_folder(**chosen)
        saved = read_config(folder)
        if not all(isinstance(saved.get(part), dict) for part in ("env", "physics")):
            raise RunError(f"{folder} holds no run of this project")
        if self.usual_envs is not None:
            saved["env"]["num_envs"] = self.usual_envs
        saved["env"].update(self._fixed)
        saved.pop("disturbances", None)  # a policy is measured without those of its training
        config = amended(saved, task, learning=False)
        for key, value in self._fixed.items():
            if getattr(config.env, key) != value:
                shown = json.dumps(value)
                raise ConfigError(f"env.{key} is {shown} in this command")
        output = own.pop("output", None)
        options = typed(self.schema, own)
        if "output" in names:  # set as it is: a name may have what would refer to something
            options = dataclasses.replace(options, output=output)
            _require_place(output)
        return folder, config, options

    def _help(self) -> str:
        own = [
            ("robot", f"a policy that ships: {', '.join(shipped())} [gecko]"),
            ("run", "the folder of a run, in place of robot"),
            ("plugins", "modules to import, such as [my_gaits], in which a run's choices are"),
            *((name, summary(field)) for name, field in described(self.schema)),
        ]
        task = [
            *((group, f"{words}: {', '.join(choices(group))}") for group, words in _GROUPS.items()),
            *(
                (name, field.metadata["meaning"])
                for name, field in described(Config)
                if name.split(".")[0] in _CHANGEABLE
                and name != "plugins"
                and name.removeprefix("env.") not in self._fixed
                and field.metadata
            ),
        ]
        return _HELP.format(
            title=self.title, examples=self.examples, keys=listed(own), task=listed(task)
        ).rstrip()


def _require_place(output: str | None) -> None:
    """Looks whether a file can be written where it is wanted, before anything is computed for it."""
    home = Path() if output is None else Path(output).parent
    if not home.is_dir():
        raise ConfigError(f"output={output}: there is no folder {home}")
    if output is not None and Path(output).is_dir():
        raise ConfigError(f"output={output} is a folder")
    require_writable(home)


def _misplaced(key: str, options: set[str]) -> str:
    known = [*sorted(options), "robot", "run", *_CHANGEABLE]
    group = key.split(".")[0]
    parts = {*GROUPS, *learners.names(), *(field.name for field in dataclasses.fields(Config))}
    if group in parts:
        return f"{key} is settled by training; what may change is {', '.join(known)}"
    task = [name for name, _ in described(Config) if name.split(".")[0] in _CHANGEABLE]
    moved = [name for name in task if name.rpartition(".")[2] == key]
    hint = f"did you mean {moved[0]}? " if moved else suggestion(key, [*known, *task])
    return f"{key} is not a key; {hint}allowed are {', '.join(known)}"
