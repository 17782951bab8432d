"""Paths in arguments such as ``run=FOLDER``: one rule for all of them."""

from __future__ import annotations

import os

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.errors import HydraException

from locomotion.options.checked import ConfigError

#: Keys whose value is a path.
PATH_KEYS = ("run", "resume", "output", "hydra.run.dir", "hydra.sweep.dir", "hydra.sweep.subdir")


def read_path(text: str) -> str:
    """The path that a user gives as the value of an argument.

    It is the text as it is, with any character that a name may have. A leading ``~`` is a home folder. A
    text that is one quoted string of Hydra's is what stands in the quotes, which may begin with ``~``.
    Hydra's own folders may refer to its configuration by ``${...}``; there ``\\${`` stands for ``${``.

    Raises:
        ConfigError: if it is empty, as that of a shell's variable that is not set.
    """
    path = _unquoted(text)
    if path is None:
        path = os.path.expanduser(text)
    if not path:
        raise ConfigError("an empty path names nothing; . is the current folder")
    return path


def quoted(path: str | os.PathLike[str]) -> str:
    """A path as the value of an argument, which :func:`read_path` and Hydra read as that path."""
    text = os.fspath(path)
    if text == "???":
        text = "./???"  # OmegaConf's word for what is missing
    return QuotedString(text, Quote.single).with_quotes()


def _unquoted(text: str) -> str | None:
    if len(text) < 2 or text[0] != text[-1] or text[0] not in "'\"":
        return None
    try:
        override = OverridesParser.create().parse_override(f"path={text}")
    except HydraException:
        return None
    return None if override.is_sweep_override() else override.value()
