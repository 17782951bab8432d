"""The configuration of a run: the options of all packages put together."""

from locomotion.config.logger import LoggerBackend, LoggerConfig
from locomotion.config.schema import GROUPS, Config, as_dict, free_keys, typed_config

__all__ = ["GROUPS", "Config", "LoggerBackend", "LoggerConfig", "as_dict", "free_keys"]
__all__ += ["typed_config"]
