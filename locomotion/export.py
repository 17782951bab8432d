"""Takes a policy out of the simulator: ``python -m locomotion.export robot=gecko`` or ``run=FOLDER``."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import logging
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from locomotion.cli.policies import Command
from locomotion.config import Config
from locomotion.options import Checked, ConfigError, key
from locomotion.writing import atomic_write

if TYPE_CHECKING:
    import torch


@dataclasses.dataclass
class ExportConfig(Checked):
    """``python -m locomotion.export``."""

    output: str | None = key(
        "file to write, .onnx, .pt2 or .xml; null: ROBOT.* in all three", default=None
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.output is not None and not self.output.endswith((".onnx", ".pt2", ".xml")):
            self.refuse("output", self.output, "a file that ends in .onnx, .pt2 or .xml")


_EXAMPLES = """\
  python -m locomotion.export                                  gecko.onnx, gecko.pt2 and gecko.xml
  python -m locomotion.export run=outputs/DATE/TIME output=gait.onnx

The program takes one robot's readings, such as hinge_position (rad) and core_orientation (unit quaternion
w x y z), and its memory, zeros at the start. It returns next_hinge_target (rad) and the memory under names
with next_ in front, to be given back at the next control step. How often, the order of hinges and the
names of the memory are in the file's metadata. The .xml is the robot on its ground, for MuJoCo alone."""


def export(run: Path, config: Config, options: ExportConfig) -> None:
    """Writes a run's policy, transforms included, and prints the files.

    Args:
        run: folder of the run.
        config: its configuration.
        options: where to.

    Raises:
        RunError: if the run holds no checkpoint that can be read, or was trained with parts of
            somebody's own, which are not exported.
    """
    import torch

    from locomotion.evaluation import Controller, load_policy, require_parts
    from locomotion.training.build import make_env

    require_parts(run, {"env": None, "transforms": None})
    env = make_env(config)
    controller = Controller(config, env, load_policy(run, config, env)).cpu().eval()
    metadata = {
        "robot": config.robot.name,
        "control_frequency": f"{config.env.control_frequency:g}",
        "clock_frequency": f"{config.env.clock_frequency:g}",
        "hinges": json.dumps(env.base_env.hinge_names),
        "memory": json.dumps(list(controller.memory)),
    }
    example = (
        {name: torch.zeros(length) for name, length in controller.readings.items()},
        {name: torch.zeros(shape) for name, shape in controller.memory.items()},
    )
    files = _files(config, options)
    program = None
    if any(file.suffix != ".xml" for file in files):
        with torch.no_grad(), warnings.catch_warnings():
            # Torch's, about its own recurrent modules.
            warnings.filterwarnings("ignore", "(?s).*_flat_weights.* were assigned during export")
            program = torch.export.export(controller, example, strict=False)
    for file in files:
        with atomic_write(file) as partial:
            if file.suffix == ".onnx":
                _write_onnx(program, example, metadata, partial)
            elif file.suffix == ".xml":
                model = env.base_env.task.root_entity.mjcf_model
                partial.write_text(model.to_xml_string(), encoding="utf-8")
            else:
                torch.export.save(program, str(partial), extra_files=metadata)
    env.close()
    print(", ".join(map(str, files)))


def _files(config: Config, options: ExportConfig) -> list[Path]:
    if options.output is not None:
        return [Path(options.output)]
    return [Path(f"{config.robot.name}{ending}") for ending in (".onnx", ".pt2", ".xml")]


def require(options: ExportConfig) -> None:
    """Raises a :class:`ConfigError` if a package that writes the format is missing."""
    if options.output is None or options.output.endswith(".onnx"):
        for package in ("onnx", "onnxscript"):
            if importlib.util.find_spec(package) is None:
                raise ConfigError(
                    f"ONNX needs packages: pip install onnx onnxscript ({package} is not there)"
                )


def _write_onnx(
    program: torch.export.ExportedProgram,
    example: tuple[dict[str, torch.Tensor], dict[str, torch.Tensor]],
    metadata: dict[str, str],
    path: Path,
) -> None:
    import onnx
    import torch

    # Both are about libraries alone: operators of torchvision, and torch's own use of its trees.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", ".*isinstance.treespec, LeafSpec.*", FutureWarning)
    readings, memory = example
    exported = torch.onnx.export(
        program,
        input_names=[*readings, *memory],
        # All with "next_", as hinge_target is a reading too.
        output_names=[f"next_{name}" for name in ("hinge_target", *memory)],
        dynamo=True,
        verbose=False,
    )
    model = exported.model_proto
    onnx.helper.set_model_props(model, metadata)
    onnx.save(model, path)


COMMAND = Command(ExportConfig, export, "Takes a policy out.", _EXAMPLES, num_envs=1, check=require)

if __name__ == "__main__":
    COMMAND.main()
