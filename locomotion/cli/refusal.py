"""What cannot be done is said in one line, before anything is computed for it where that can be."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import NoReturn

import yaml
from hydra.errors import HydraException, MissingConfigException
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from locomotion.options import ConfigError, explain
from locomotion.options.files import explain_yaml
from locomotion.runs import RunError, RunStopped


def refuse(message: str, status: int = 2) -> NoReturn:
    """Ends the process with one line on standard error."""
    print(f"error: {message}", file=sys.stderr)
    sys.exit(status)


@contextlib.contextmanager
def refusing() -> Iterator[None]:
    """Ends the process with one line on standard error for what a user can be told.

    The exit status is 2 for what cannot be used, 1 for what cannot go on, and 130 for an interruption.
    """
    try:
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


@contextlib.contextmanager
def explained() -> Iterator[None]:
    """Turns what Hydra raises about a command line into a :class:`ConfigError`."""
    try:
        yield
    except ConfigError:
        raise
    except (HydraException, OmegaConfBaseException, yaml.YAMLError, ValueError) as error:
        raise ConfigError(_explain(error)) from error
    except RecursionError as error:
        raise ConfigError("the configuration is nested too deeply") from error


def _explain(error: Exception) -> str:
    if isinstance(error, MissingConfigException) and error.options is not None:
        group, _, option = error.missing_cfg_file.rpartition("/")
        return f"{group}={option} is unknown; choose from {', '.join(error.options)}"
    if isinstance(error, yaml.YAMLError):
        return explain_yaml(error)
    cause = error.__cause__ or error.__context__
    if isinstance(cause, (ConfigAttributeError, ConfigKeyError)):
        return explain(cause)
    message = " ".join(str(error).split())
    if isinstance(cause, OmegaConfBaseException):
        return f"{message.removeprefix('Error merging override ')}: {str(cause).splitlines()[0]}"
    return message
