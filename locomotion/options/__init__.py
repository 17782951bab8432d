"""Options: declared, typed and chosen by name. Each package declares its own with these parts.

Nothing here imports anything heavy, so that a mistake is answered before torch is loaded.
"""

from locomotion.options.checked import Checked, ConfigError, key, suggestion
from locomotion.options.described import described, flat, summary
from locomotion.options.files import choices, conf_dir, load_file, read_choice
from locomotion.options.registry import (
    arenas,
    import_plugins,
    learners,
    networks,
    readings,
    rewards,
)
from locomotion.options.typed import chosen, explain, typed

__all__ = [
    "Checked",
    "ConfigError",
    "arenas",
    "choices",
    "chosen",
    "conf_dir",
    "described",
    "explain",
    "flat",
    "import_plugins",
    "key",
    "learners",
    "load_file",
    "networks",
    "read_choice",
    "readings",
    "rewards",
    "suggestion",
    "summary",
    "typed",
]
