"""Every settings object refuses what it cannot be, in one sentence, when it is made."""

import dataclasses

import numpy as np
import pytest
from rows import each

import odm
from handover.grasps.grasp_build import GraspSettings
from handover.grasps.settings import HoldSettings
from handover.meet.settings import FindSettings, QualitySettings
from handover.plans.settings import PlanSettings, ProofSettings, SolveSettings
from handover.reach.reach_build import ReachSettings
from handover.targets.settings import AllowanceSettings, ChoiceSettings, LiveSettings
from odm.approach.approach_answer import ApproachSettings
from odm.close_test.safety import Safety
from odm.execution.settings import (
    AheadSettings,
    ExecutionSettings,
    FollowSettings,
    IntentSettings,
    LookoutSettings,
    PaceSettings,
    StopTestSettings,
    TrackingSettings,
)
from odm.execution.speed_limit import SpeedSettings
from odm.execution.threat import ThreatSettings
from odm.planner.settings import (
    AttachSettings,
    ConnectSettings,
    ImproveSettings,
    PoseSettings,
    RetreatSettings,
    SmoothingSettings,
    TightSettings,
)
from roadmap.errors import BadInput, BadRecipe
from roadmap.graph.connecting import RoadmapSettings
from roadmap.ranges import CheckedSettings
from sim.bench.pushed import PushSettings
from sim.loop.loop import LoopSettings, NewPathSettings
from sim.loop.work_places import WorkPlaceSettings
from sim.maintenance.play import CycleSettings
from sim.story.cases import InReachSettings
from sim.story.pull import PullSettings
from sim.story.settings import (
    ComfortRodSettings,
    ComfortSettings,
    ConductSettings,
    GraspingSettings,
    GripperSettings,
    StorySettings,
)
from sim.two.two_members import TwoSettings

SETTINGS = [
    odm.PlannerSettings,
    AttachSettings,
    ConnectSettings,
    ImproveSettings,
    SmoothingSettings,
    RetreatSettings,
    TightSettings,
    PoseSettings,
    odm.SeenSettings,
    ApproachSettings,
    Safety,
    RoadmapSettings,
    LiveSettings,
    ChoiceSettings,
    ReachSettings,
    ExecutionSettings,
    LoopSettings,
    ThreatSettings,
    PaceSettings,
    LookoutSettings,
    StopTestSettings,
    TrackingSettings,
    IntentSettings,
    FollowSettings,
    AheadSettings,
    TwoSettings,
    GraspSettings,
    SpeedSettings,
    PullSettings,
    ComfortSettings,
    StorySettings,
    ConductSettings,
    GraspingSettings,
    GripperSettings,
    ComfortRodSettings,
    InReachSettings,
    CycleSettings,
    NewPathSettings,
    PushSettings,
    WorkPlaceSettings,
    HoldSettings,
    FindSettings,
    QualitySettings,
    PlanSettings,
    ProofSettings,
    SolveSettings,
    AllowanceSettings,
]


def numbers(counts=False):
    """Yield each settings class with each of its fields that holds a number."""
    for kind in SETTINGS:
        for field in dataclasses.fields(kind):
            value = getattr(kind(), field.name)
            if counts and not isinstance(value, int):
                continue
            if isinstance(value, int | float) and not isinstance(value, bool):
                yield kind, field.name


@each("wrong", [np.nan, -np.inf, -1, None, "3", [1], True])
@each(("kind", "field"), numbers())
def test_what_is_no_number_in_range_is_refused_with_its_name(kind, field, wrong):
    with pytest.raises(BadInput) as told:
        kind(**{field: wrong})
    text = str(told.value)
    assert field in text or field.removesuffix("_s") in text
    assert str(wrong) in text and len(text) < 200 and "\n" not in text


@each(("kind", "field"), numbers(counts=True))
def test_counts_are_whole(kind, field):
    with pytest.raises(BadInput, match="a whole number"):
        kind(**{field: 2.5})


def rows():
    """Yield each settings class with each of its fields that holds several numbers."""
    for kind in SETTINGS:
        for field in dataclasses.fields(kind):
            if field.name != "finger_pads" and isinstance(
                getattr(kind(), field.name), tuple
            ):
                yield kind, field.name


@each("wrong", [(), None, 0.5, "12", (0.1, np.nan), (-1.0,), (True,)])
@each(("kind", "field"), rows())
def test_what_is_no_row_of_numbers_in_range_is_refused_with_its_name(
    kind, field, wrong
):
    with pytest.raises(BadInput, match=field):
        kind(**{field: wrong})


@each("kind", SETTINGS)
def test_numbers_of_numpy_are_as_good(kind):
    fields = {
        f.name: np.array(getattr(kind(), f.name))[()]
        for f in dataclasses.fields(kind)
        if type(getattr(kind(), f.name)) in (int, float)
    }
    assert kind(**fields) == kind()


def choices():
    """Yield each settings class with each field that is yes or no, or has settings."""
    for kind in SETTINGS:
        for field in dataclasses.fields(kind):
            value = getattr(kind(), field.name)
            if isinstance(value, bool | CheckedSettings):
                yield kind, field.name, type(value).__name__


@each("wrong", [np.nan, None, "yes", 1, [True], np.ones(2)])
@each(("kind", "field", "wanted"), choices())
def test_yes_or_no_and_settings_within_settings_are_of_their_kind(
    kind, field, wanted, wrong
):
    remedy = "True or False" if wanted == "bool" else wanted
    with pytest.raises(BadInput, match=rf"^{field} is (.|\n)*; give {remedy}"):
        kind(**{field: wrong})
    assert kind(**{field: getattr(kind(), field)}) == kind()


def test_zero_counts_that_crashed_late_are_refused_at_once(small_map):
    for field, value in (
        ("start_connections", 0),
        ("goal_connections", 0),
        ("point_capacity", -1),
        ("point_capacity", 0),
        ("cached_goals", -1),
    ):
        with pytest.raises(BadInput, match=f"{field} is {value}, but must be a whole"):
            odm.PlannerSettings(**{field: value})


@pytest.mark.parametrize("pads", ["finger", None, (1,), ("finger", None)])
def test_pads_are_names_of_links(pads):
    with pytest.raises(BadInput, match="tuple of link names"):
        odm.PlannerSettings(finger_pads=pads)


@each(
    ("text", "words"),
    [
        ("[roadmap]\nmax_step = nan\n", "roadmap.max_step"),
        ("[roadmap]\nseed = -1\n", "roadmap.seed"),
        ("[roadmap]\nnodes = 10.5\n", "roadmap.nodes"),
        ("[roadmap]\nweights = [1.0, nan]\n", "roadmap.weights"),
        ("[roadmap]\nregion = 3\n", "roadmap.region"),
        ("[roadmap]\nregion = [[0, 0, 0], [1, -1, 1]]\n", "roadmap.region"),
        ("[roadmap]\nregion = [[0, 0, 0], [1, nan, 1]]\n", "roadmap.region"),
        ("[safety]\nuser = nan\n", "safety.user"),
        ("[safety]\nsensor = 'much'\n", "safety.sensor"),
    ],
)
def test_recipes_refuse_the_same(tmp_path, text, words):
    file = tmp_path / "r.toml"
    file.write_text(text)
    with pytest.raises(BadRecipe, match=words):
        odm.load_recipe(file)


@each("field", ["pull", "speed", "comfort", "threat", "slow"])
@each("wrong", [None, {}, 0.003])
def test_settings_of_a_part_are_of_their_kind(field, wrong):
    with pytest.raises(BadInput, match=f"{field} is "):
        StorySettings(**{field: wrong})
