"""What may be asked of a policy that has been trained: its values stand in ``conf/COMMAND.yaml``."""

from __future__ import annotations

import dataclasses

from locomotion.config.schema import Checked, key


@dataclasses.dataclass
class WalkConfig(Checked):
    """How a policy is made to walk."""

    seconds: float = key("how long robots walk (s)", above=0, most=86_400)
    delay: int = key("control steps by which hinges get their targets late", least=0, most=1000)
    noise: float = key("of the hinges' sensors: standard deviation (rad)", least=0, most=10)
    push: float = key(
        "change of velocity (m/s) by a push, one every 10 s in any direction", least=0, most=10
    )


@dataclasses.dataclass
class EvaluateConfig(WalkConfig):
    """``python -m locomotion.evaluate``."""

    reality_check: bool = key("whether to walk under changes that a real robot would bring too")
    json: bool = key("JSON on standard output instead of a table")


@dataclasses.dataclass
class WatchConfig(WalkConfig):
    """``python -m locomotion.watch``."""

    sampled: bool = key("actions drawn as in training, in place of their mean")
    live: bool = key("in MuJoCo's viewer, as it walks, in place of a film")
    web: bool = key("a page that plays the gait in a browser, in place of a film")
    output: str | None = key(
        "file to write, .mp4, .webp, .gif or .html; null: ROBOT.mp4 and a small ROBOT.webp, or ROBOT.html"
    )
    width: int = key("of the film, pixels", least=64, most=7680)
    height: int = key("of the film, pixels", least=64, most=4320)
    fps: int = key("frames a second", least=1, most=1000)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.live and self.web:
            self._refuse("live", "true", "false with web=true; each shows the gait in its own way")
        if self.live and self.output is not None:
            self._refuse("output", self.output, "left out with live=true, which writes nothing")
        endings = (".html",) if self.web else (".mp4", ".webp", ".gif")
        if self.output is not None and not self.output.endswith(endings):
            self._refuse("output", self.output, f"a file that ends in {' or '.join(endings)}")
        if self.output is not None and self.output.endswith(".gif") and self.fps > 50:
            self._refuse("fps", self.fps, "at most 50 with a .gif, which has no shorter pictures")
        if self.width % 2 or self.height % 2:
            self._refuse("width", f"{self.width} height={self.height}", "even, as films have it")


@dataclasses.dataclass
class ExportConfig(Checked):
    """``python -m locomotion.export``."""

    output: str | None = key("file to write, .onnx, .pt2 or .xml; null: ROBOT.* in all three")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.output is not None and not self.output.endswith((".onnx", ".pt2", ".xml")):
            self._refuse("output", self.output, "a file that ends in .onnx, .pt2 or .xml")
