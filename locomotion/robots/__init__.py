"""What a robot is: modules, and bodies put together from them, as dm-control composer entities."""

from locomotion.robots.body import BodyError, Module, parse_body
from locomotion.robots.modular_robot import ModularRobot
from locomotion.robots.modules import ActiveHinge, Brick, Core

__all__ = ["ActiveHinge", "BodyError", "Brick", "Core", "ModularRobot", "Module", "parse_body"]
