"""Errors of a user in one line, before anything is computed where possible."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import yaml
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from locomotion.options import ConfigError, explain
from locomotion.options.files import explain_yaml
from locomotion.runs import RunError, RunStopped
from locomotion.surroundings import lasting_streams


def refuse(message: str, status: int = 2) -> NoReturn:
    """Ends the process with one line on standard error, whatever characters a file's name has."""
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in message)
    print(f"error: {shown}", file=sys.stderr)
    sys.exit(status)


@contextlib.contextmanager
def refusing() -> Iterator[None]:
    """Ends the process with one line on standard error for what a user can be told.

    The exit status is 2 for what cannot be used, 1 for what cannot go on, and 130 for an interruption.
    What the block says cannot end it; see :func:`~locomotion.surroundings.lasting_streams`.
    """
    try:
        with lasting_streams():
            _require_current_folder()
            yield
    except (ConfigError, RunError) as error:
        refuse(str(error))
    except RunStopped as error:
        refuse(str(error), status=1)
    except OSError as error:
        reason = error.strerror or str(error)
        refuse(f"{error.filename}: {reason}" if error.filename else reason, status=1)
    except KeyboardInterrupt as error:
        print(str(error) or "interrupted", file=sys.stderr)
        sys.exit(130)


def _require_current_folder() -> None:
    try:
        os.getcwd()
    except FileNotFoundError as error:
        raise ConfigError("the current folder is gone; cd into one that is there") from error


@contextlib.contextmanager
def explained(folder: Path | str | None = None) -> Iterator[None]:
    """Turns what Hydra raises about a command line into a :class:`ConfigError`.

    Args:
        folder: where choices of one's own are looked for, for messages.
    """
    try:
        yield
    except ConfigError:
        raise
    except MissingConfigException as error:
        place = f"; in {folder} it would be {error.missing_cfg_file}.yaml" if folder else ""
        raise ConfigError(f"{_explain(error)}{place}") from error
    except UnicodeDecodeError as error:
        files = Path(folder or "").rglob("*.yaml") if folder else ()
        named = next((file for file in files if error.object in file.read_bytes()), "a file")
        raise ConfigError(f"{named} is not text in UTF-8") from error
    except AttributeError as error:
        if __debug__:
            raise
        message = "functions and mappings in overrides need assertions: start Python without -O"
        raise ConfigError(message) from error
    except (HydraException, OmegaConfBaseException, yaml.YAMLError, ValueError) as error:
        raise ConfigError(_explain(error)) from error
    except RecursionError as error:
        raise ConfigError("the configuration is nested too deeply") from error


def _explain(error: Exception) -> str:
    if isinstance(error, MissingConfigException) and error.options is not None:
        group, _, option = error.missing_cfg_file.rpartition("/")
        return f"{group}={option} is unknown; choose from {', '.join(error.options)}"
    if isinstance(error, OverrideParseException):
        _, called, reason = " ".join(str(error).split()).partition(" while evaluating ")
        if called:  # a function, such as choice()
            return f"{error.override}: {reason.partition(': ')[2].partition(' See https:')[0]}"
        return f"{error.override} is not KEY=VALUE; a value of special characters stands in quotes"
    if isinstance(error, yaml.YAMLError):
        return explain_yaml(error)
    cause = error.__cause__ or error.__context__
    if isinstance(cause, (ConfigAttributeError, ConfigKeyError)):
        return explain(cause)
    message = " ".join(str(error).split())
    if isinstance(cause, OmegaConfBaseException):
        return f"{message.removeprefix('Error merging override ')}: {str(cause).splitlines()[0]}"
    return message
