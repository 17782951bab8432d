"""Takes a policy out of the simulator: ``python -m locomotion.export robot=gecko`` or ``run=FOLDER``."""

from __future__ import annotations

import importlib.util
import json
import logging
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from locomotion.command_line.policies import command
from locomotion.command_line.quiet import quiet
from locomotion.config import Config, ConfigError, ExportConfig
from locomotion.writing import replacing

if TYPE_CHECKING:
    import torch

    from locomotion.gaits import Controller

_EXAMPLES = """\
  python -m locomotion.export                                  gecko.onnx, gecko.pt2 and gecko.xml
  python -m locomotion.export run=outputs/DATE/TIME output=gait.onnx

The program takes one robot's hinge_position (rad), core_orientation (unit quaternion w x y z, if the
policy senses it) and history (zeros at the start), and returns hinge_target (rad) and next_history, to
be given back at the next control step. How often, and the order of hinges, is in the file's metadata.
The .xml is the robot on its ground, for MuJoCo alone."""


def export(run: Path, config: Config, options: ExportConfig) -> None:
    """Writes a run's policy, transforms included, and prints the files.

    Args:
        run: folder of the run.
        config: its configuration.
        options: where to.

    Raises:
        ConfigError: if a package that writes the format is missing.
        RunError: if the run holds no checkpoint that can be read.
    """
    if options.output is None:
        files = [Path(f"{config.robot.name}{ending}") for ending in (".onnx", ".pt2", ".xml")]
    else:
        files = [Path(options.output)]
    if any(file.suffix == ".onnx" for file in files):
        for package in ("onnx", "onnxscript"):
            if importlib.util.find_spec(package) is None:
                raise ConfigError(
                    f"ONNX needs packages: pip install onnx onnxscript ({package} is not)"
                )
    quiet()
    import torch

    from locomotion.assembly import make_env
    from locomotion.gaits import Controller, load_policy

    env = make_env(config)
    controller = Controller(env, load_policy(run, config, env)).cpu().eval()
    metadata = {
        "robot": config.robot.name,
        "control_frequency": f"{config.env.control_frequency:g}",
        "hinges": json.dumps(env.base_env.hinge_names),
    }
    with torch.no_grad():
        program = torch.export.export(controller, (), _example(controller))
    for file in files:
        with replacing(file) as partial:
            if file.suffix == ".onnx":
                _write_onnx(program, controller, metadata, partial)
            elif file.suffix == ".xml":
                partial.write_text(env.base_env.task.root_entity.mjcf_model.to_xml_string())
            else:
                torch.export.save(program, str(partial), extra_files=metadata)
    env.close()
    print(", ".join(map(str, files)))


def _example(controller: Controller) -> dict[str, torch.Tensor]:
    import torch

    inputs = {
        "hinge_position": torch.zeros(controller.num_hinges),
        "history": torch.zeros(controller.history_length),
    }
    if controller.needs_orientation:
        inputs["core_orientation"] = torch.tensor([1.0, 0.0, 0.0, 0.0])
    return inputs


def _write_onnx(
    program: torch.export.ExportedProgram,
    controller: Controller,
    metadata: dict[str, str],
    path: Path,
) -> None:
    import onnx
    import torch

    # Both are about libraries alone: operators of torchvision, and torch's own use of its trees.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    warnings.filterwarnings("ignore", ".*isinstance.treespec, LeafSpec.*", FutureWarning)
    exported = torch.onnx.export(
        program,
        input_names=list(_example(controller)),
        output_names=["hinge_target", "next_history"],
        dynamo=True,
        verbose=False,
    )
    model = exported.model_proto
    onnx.helper.set_model_props(model, metadata)
    onnx.save(model, path)


def main() -> None:
    command("export", ExportConfig, export, "Takes a policy out.", _EXAMPLES, num_envs=1)


if __name__ == "__main__":
    main()
