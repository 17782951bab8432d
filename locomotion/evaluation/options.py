"""The options of walking with a policy, and of ``python -m locomotion.evaluate``."""

from __future__ import annotations

import dataclasses

from locomotion.options import Checked, key


@dataclasses.dataclass
class WalkConfig(Checked):
    """Options of walking with a policy."""

    seconds: float = key("how long robots walk (s)", default=60.0, above=0, most=86_400)


@dataclasses.dataclass
class EvaluateConfig(WalkConfig):
    """``python -m locomotion.evaluate``."""

    reality_check: bool = key(
        "whether to walk under changes that a real robot would bring too", default=False
    )
    json: bool = key("JSON on standard output instead of a table", default=False)
