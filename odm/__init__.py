"""Obstacle direct mapping: what is free now, from cells and a certified close test."""

from odm.answer import Answer, Blockers, Freedom
from odm.cameras import DepthCamera, SeenSettings, SeenSpace
from odm.cell_map.build import build_map
from odm.cell_map.cell_map import CellMap, load_map
from odm.cell_map.payload import CarriedObject, carried_object
from odm.cell_map.recipe import Recipe, load_recipe
from odm.checks import AVOID, CONTACT, OBJECT
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.point_cloud import PointCloud
from odm.obstacles.robot_surface import robot_surface
from odm.obstacles.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from odm.obstacles.surfaces import Surface, sample_capsules, surface_of
from odm.planner.planner import ReactivePlanner
from odm.planner.pose_goals import GoalReport
from odm.planner.scene import Scene
from odm.planner.settings import PlannerSettings

__all__ = [
    "AVOID",
    "CONTACT",
    "OBJECT",
    "Obstacles",
    "Answer",
    "Blockers",
    "Box",
    "Capsule",
    "CarriedObject",
    "CellMap",
    "Cylinder",
    "DepthCamera",
    "Freedom",
    "GoalReport",
    "Mesh",
    "PlannerSettings",
    "PointCloud",
    "ReactivePlanner",
    "Recipe",
    "Scene",
    "SeenSettings",
    "SeenSpace",
    "Sphere",
    "Surface",
    "build_map",
    "carried_object",
    "load_map",
    "load_recipe",
    "robot_surface",
    "sample_capsules",
    "surface_of",
]
