"""The configuration of a run: its types, its files, and what is said about mistakes in it.

Nothing here imports anything heavy, so that a mistake is answered before torch is loaded.
"""

from locomotion.config.commands import EvaluateConfig, ExportConfig, WalkConfig, WatchConfig
from locomotion.config.files import GROUPS, conf_dir, flat, load, load_file, typed
from locomotion.config.messages import explain_omegaconf, explain_yaml
from locomotion.config.schema import (
    Config,
    ConfigError,
    EnvConfig,
    LoggerBackend,
    LoggerConfig,
    ObsConfig,
    Orientation,
    PhysicsBackend,
    PhysicsConfig,
    PPOConfig,
    RobotConfig,
    substeps,
)

__all__ = [
    "GROUPS",
    "Config",
    "ConfigError",
    "EnvConfig",
    "EvaluateConfig",
    "ExportConfig",
    "LoggerBackend",
    "LoggerConfig",
    "ObsConfig",
    "Orientation",
    "PPOConfig",
    "PhysicsBackend",
    "PhysicsConfig",
    "RobotConfig",
    "WalkConfig",
    "WatchConfig",
    "conf_dir",
    "explain_omegaconf",
    "explain_yaml",
    "flat",
    "load",
    "load_file",
    "substeps",
    "typed",
]
