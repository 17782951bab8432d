"""The configuration of a run: the options of all packages put together."""

from locomotion.config.logger import LoggerBackend, LoggerConfig
from locomotion.config.schema import GROUPS, Config, all_keys, as_dict, free_keys, typed_config

__all__ = ["GROUPS", "Config", "LoggerBackend", "LoggerConfig", "all_keys", "as_dict", "free_keys"]
__all__ += ["typed_config"]
