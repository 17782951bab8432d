"""The options of ``python -m locomotion.watch``."""

from __future__ import annotations

import dataclasses

from locomotion.evaluation.options import WalkConfig
from locomotion.options import key


@dataclasses.dataclass
class WatchConfig(WalkConfig):
    """``python -m locomotion.watch``."""

    seconds: float = key("how long the robot walks (s)", default=8.0, above=0, most=86_400)
    sampled: bool = key("actions drawn as in training, in place of their mean", default=False)
    live: bool = key("in MuJoCo's viewer, as it walks, in place of a film", default=False)
    web: bool = key("a page that plays the gait in a browser, in place of a film", default=False)
    output: str | None = key(
        "file to write, .mp4, .webp, .gif or .html; null: ROBOT.mp4 and a small ROBOT.webp, or"
        " ROBOT.html",
        default=None,
    )
    width: int = key("of the film, pixels", default=800, least=64, most=7680)
    height: int = key("of the film, pixels", default=450, least=64, most=4320)
    fps: int = key("frames a second", default=25, least=1, most=1000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.live and self.web:
            self.refuse("live", "true", "false with web=true; each shows the gait in its own way")
        if self.live and self.output is not None:
            self.refuse("output", self.output, "left out with live=true, which writes nothing")
        endings = (".html",) if self.web else (".mp4", ".webp", ".gif")
        if self.output is not None and not self.output.endswith(endings):
            self.refuse("output", self.output, f"a file that ends in {' or '.join(endings)}")
        if self.output is not None and self.output.endswith(".gif") and self.fps > 50:
            self.refuse("fps", self.fps, "at most 50 with a .gif, which has no shorter pictures")
        if self.width % 2 or self.height % 2:
            self.refuse("width", f"{self.width} height={self.height}", "even, as films have it")
