"""The symmetry of a body: the mirrors that map it to itself, and what each does to its hinges.

A body is compared with all hinges at 0. Every mirror stands upright and passes through the core's centre, so
that the ground and gravity are mirrored to themselves.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from locomotion.robots.body import Module, placed_boxes, placed_modules

#: Reflections of the core's frame: y, x, and the two that swap x and y, to the same or the other side.
_REFLECTIONS = (
    np.diag([1.0, -1.0, 1.0]),
    np.diag([-1.0, 1.0, 1.0]),
    np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
)
#: Two points are one if they are no further apart (m); modules are centimetres long.
_CLOSE = 1e-6


@dataclasses.dataclass(frozen=True, eq=False)
class Mirror:
    """A mirror that maps a body to itself.

    The robot's mirror image has at hinge ``i`` the angle, speed, torque and target of hinge
    ``hinges[i]``, times ``signs[i]``.

    Attributes:
        reflection: maps vectors of the core's frame, shape ``(3, 3)``.
        hinges: the hinge that each hinge is mirrored to, in the order of actions.
        signs: 1 where both turn the same way about their axes, else -1.
        modules: the module that each module is mirrored to, in the order of
            :meth:`Module.walk() <locomotion.robots.Module.walk>`.
    """

    reflection: np.ndarray
    hinges: tuple[int, ...]
    signs: tuple[int, ...]
    modules: tuple[int, ...]

    @property
    def hinge_matrix(self) -> np.ndarray:
        """Maps what hinges have to what they have in the mirror, shape ``(hinges, hinges)``."""
        return np.array(self.signs)[:, None] * np.eye(len(self.hinges))[list(self.hinges)]

    @property
    def module_matrix(self) -> np.ndarray:
        """Maps what modules have to what they have in the mirror, shape ``(modules, modules)``."""
        return np.eye(len(self.modules))[list(self.modules)]

    @property
    def axial_matrix(self) -> np.ndarray:
        """Maps axes of rotation and angular velocities of the core's frame, shape ``(3, 3)``."""
        return np.linalg.det(self.reflection).round() * self.reflection

    @property
    def quaternion_matrix(self) -> np.ndarray:
        """Maps orientations of the core, quaternions w x y z, core to world, shape ``(4, 4)``.

        The world is mirrored as the core's frame is: ``R`` becomes ``M R M``, which turns by the same angle
        about the mirrored axis.
        """
        matrix = np.eye(4)
        matrix[1:, 1:] = self.axial_matrix
        return matrix


def mirrors(body: Module) -> list[Mirror]:
    """Finds the mirrors of a body: of the planes x-z and y-z of the core's frame and of their diagonals.

    Args:
        body: the core, with the rest of the body below it.

    Returns:
        The mirrors, in that order; none for a body without symmetry.
    """
    found = (_mirror(body, reflection) for reflection in _REFLECTIONS)
    return [mirror for mirror in found if mirror is not None]


def _mirror(body: Module, reflection: np.ndarray) -> Mirror | None:
    modules = list(body.walk())
    images = _images(body, modules, reflection)
    if images is None or not _keeps_joints(modules, images):
        return None
    hinges = [index for index, module in enumerate(modules) if module.kind == "hinge"]
    places = {module.path: rotation for module, _, rotation in placed_modules(body)}
    axes = [places[module.path][:, 1] for module in modules]
    # An axis is mirrored as a rotation is; the image's own axis may point to the other side.
    signs = [round(-(reflection @ axes[index]) @ axes[images[index]]) for index in hinges]
    return Mirror(
        reflection=reflection,
        hinges=tuple(hinges.index(images[index]) for index in hinges),
        signs=tuple(signs),
        modules=tuple(images),
    )


def _images(body: Module, modules: list[Module], reflection: np.ndarray) -> list[int] | None:
    """The module that stands where each module's mirror image is; ``None`` if one has none."""
    boxes: dict[str, list[np.ndarray]] = {module.path: [] for module in modules}
    for module, _, centre, lengths in placed_boxes(body):
        boxes[module.path] += [centre, lengths]
    placed = [np.array(boxes[module.path]) for module in modules]
    images = []
    for module, here in zip(modules, placed):
        wanted = here @ reflection.T
        wanted[1::2] = here[1::2] @ np.abs(reflection)  # lengths have no sign
        # Boxes of one kind of module come in one order, with the same masses.
        found = [
            index
            for index, there in enumerate(placed)
            if modules[index].kind == module.kind and np.allclose(there, wanted, atol=_CLOSE)
        ]
        if not found:
            return None
        images += found  # no two modules stand in one place
    return images


def _keeps_joints(modules: list[Module], images: list[int]) -> bool:
    """Whether what a hinge moves is mirrored to what the hinge's image moves; modules may just touch."""
    movers: dict[str, int | None] = {"core": None}
    for index, module in enumerate(modules):
        own = index if module.kind == "hinge" else movers[module.path]
        movers.update({child.path: own for child in module.children.values()})
    moved = [movers[module.path] for module in modules]
    return all(
        moved[image] == (None if mover is None else images[mover])
        for image, mover in zip(images, moved)
    )
