"""Flat ground."""

from __future__ import annotations

from dm_control import composer

from locomotion.robots.geometry import FRICTION


class Ground(composer.Arena):
    """A flat plane without an end, under a light.

    Args:
        friction: coefficient of sliding friction.
        name: name of the arena's MJCF model.
    """

    def _build(self, friction: float = FRICTION, name: str = "ground") -> None:
        super()._build(name=name)
        root = self.mjcf_model
        # dm-control's base arena asks for elliptic cones and a second, slip-free solve, and gives
        # massless bodies a mass; here MuJoCo's own defaults hold.
        root.option.set_attributes(cone="pyramidal", noslip_iterations=0)
        root.option.noslip_tolerance = None
        root.compiler.set_attributes(boundmass=0, boundinertia=0)
        root.visual.headlight.set_attributes(
            ambient=[0.35] * 3, diffuse=[0.25] * 3, specular=[0.1] * 3
        )
        root.worldbody.add(
            "light", directional=True, pos=(0, 0, 3), dir=(0.4, 0.3, -1), diffuse=[0.5] * 3
        )
        texture = root.asset.add(
            "texture",
            name="grid",
            type="2d",
            builtin="checker",
            mark="edge",
            rgb1=(0.66, 0.69, 0.72),
            rgb2=(0.58, 0.61, 0.64),
            markrgb=(0.48, 0.51, 0.54),
            width=300,
            height=300,
        )
        root.asset.add(
            "texture",
            name="sky",
            type="skybox",
            builtin="gradient",
            rgb1=(0.80, 0.87, 0.93),
            rgb2=(0.60, 0.66, 0.72),
            width=64,
            height=384,
        )
        material = root.asset.add(
            "material", name="grid", texture=texture, texuniform=True, texrepeat=(5, 5)
        )
        self._geom = root.worldbody.add(
            "geom",
            name="ground",
            type="plane",
            size=(0, 0, 0.25),  # 0: unbounded
            material=material,
            friction=(friction,),
        )

    @property
    def ground_geoms(self) -> tuple:
        """The plane, as dm-control's arenas offer it."""
        return (self._geom,)
