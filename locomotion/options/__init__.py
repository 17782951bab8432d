"""How options are declared, typed and chosen by name; each package declares its own with this.

Nothing here imports anything heavy, so that a mistake is answered before torch is loaded.
"""

from locomotion.options.checked import Checked, ConfigError, key
from locomotion.options.files import conf_dir, load_file
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
    "chosen",
    "conf_dir",
    "explain",
    "import_plugins",
    "key",
    "learners",
    "load_file",
    "networks",
    "readings",
    "rewards",
    "typed",
]
