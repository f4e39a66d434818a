"""Every question takes a configuration of any layout, or refuses it in one sentence."""

import numpy as np
import pytest
from rows import each
from small import AWAY, HOME, NOBODY, ball_at

from odm.close_test import _close as close
from odm.planner.saved_memory import differences
from odm.search import _step as step
from roadmap.errors import BadConfiguration, BadInput

BALL = ball_at([0.3, 0.0, 0.9])
QUESTIONS = {
    "step": lambda p, q: p.step(BALL, q=q),
    "see": lambda p, q: p.see(BALL, q=q),
    "is_free": lambda p, q: p.is_free(q, AWAY),
    "stands_clear": lambda p, q: p.stands_clear(q),
    "separation": lambda p, q: p.separation(q),
    "approach": lambda p, q: p.approach(np.eye(4), q),
    "evasion": lambda p, q: p.evasion(q, [(0.1, BALL)], 0.5),
    "is_prepared": lambda p, q: p.is_prepared(q),
    "improve": lambda p, q: p.improve(4, q),
}


def read_only(q):
    """Return a copy that cannot be written."""
    q = q.copy()
    q.flags.writeable = False
    return q


def unaligned(q):
    """Return a copy that begins at an odd address."""
    room = np.zeros(8 * len(q) + 1, np.uint8)[1:].view(np.float64)
    room[:] = q
    return room


LAYOUTS = {
    "read-only": read_only,
    "strided": lambda q: np.repeat(q, 2)[::2],
    "reversed": lambda q: q[::-1].copy()[::-1],
    "unaligned": unaligned,
    "big-endian": lambda q: q.astype(">f8"),
    "a list": list,
}
WRONG = {
    "too short": (np.zeros(2), "shape"),
    "a matrix": (np.zeros((1, 3)), "shape"),
    "a number": (0.5, "shape"),
    "nothing": (None, "real numbers"),
    "text": (["a", "b", "c"], "real numbers"),
    "numbers as text": (["1", "2", "3"], "real numbers"),
    "complex": (np.zeros(3, complex), "real numbers"),
    "objects": (np.zeros(3, object), "real numbers"),
    "ragged": ([[0.0], [0.0, 1.0], 2.0], "real numbers"),
}


@pytest.fixture
def asked(planner):
    """A planner that has seen a frame and answered all questions once."""
    planner.set_goals([AWAY])
    planner.step(BALL, q=HOME)
    for question in QUESTIONS.values():
        question(planner, HOME.copy())
    planner.blocked_leg(np.stack([HOME, AWAY]))
    planner.step(BALL, q=HOME)
    return planner


def compiled():
    """Return how many kinds of arguments the compiled tests have met."""
    tests = (close.motion_clear, close.separation, close.first_blocked)
    return [len(t.signatures) for t in (*tests, close.place_anchor)]


@each("question", QUESTIONS)
@each("layout", LAYOUTS)
def test_any_layout_of_numbers_is_answered_and_compiles_nothing(
    asked, question, layout
):
    before, ask = compiled(), QUESTIONS[question]
    expected, said = ask(asked, HOME.copy()), ask(asked, LAYOUTS[layout](HOME))
    if question in ("is_free", "stands_clear", "separation", "is_prepared"):
        assert said == expected
    assert compiled() == before


@each("question", QUESTIONS)
@each("wrong", WRONG)
def test_what_is_no_configuration_is_refused_in_one_sentence(asked, question, wrong):
    q, words = WRONG[wrong]
    if q is None and question in ("approach", "improve"):
        return  # None has a meaning there
    with pytest.raises(BadInput, match=words):
        QUESTIONS[question](asked, q)


@each("extra", [-0.01, np.nan, np.inf, "1 cm"])
def test_what_is_no_extra_distance_is_refused(asked, extra):
    with pytest.raises(BadInput, match="extra"):
        asked.stands_clear(HOME, extra)


@each("layout", LAYOUTS)
def test_paths_of_any_layout_are_tested_and_compile_nothing(asked, layout):
    path = np.stack([HOME, AWAY])
    laid_out = LAYOUTS[layout](path.ravel())
    path_in_it = np.reshape(laid_out, path.shape)
    before, expected = compiled(), asked.blocked_leg(path)
    assert asked.blocked_leg(path_in_it) == expected
    assert asked.blocked_leg(np.asfortranarray(path)) == expected
    assert compiled() == before


@each("path", [None, "path", [[0, 0, 0], [1, 1]], [[None] * 3]])
def test_paths_of_no_numbers_are_refused(asked, path):
    with pytest.raises(BadInput, match="the path must be an array of real numbers"):
        asked.blocked_leg(path)


@each(
    ("goals", "words"),
    [
        ([], "no goals were given; give 1 to 32 configurations of 3 joint values"),
        (None, "no goals were given"),
        (np.zeros((0, 3)), "no goals were given"),
        ([[]], "shape"),
        ([[0, 0, 0], [1, 1]], "unequal shapes"),
        ([HOME, None], "goal 1 is no row of numbers but None"),
        (["home"], "goal 0 is no row of numbers but 'home'"),
        ("home", "goal 0 is no row of numbers but 'home'"),
        ([["0", "0", "0"]], "goal 0 is no row of numbers"),
        (3, "shape"),
        (np.zeros((1, 3), complex), "complex"),
        (np.zeros((2, 2, 3)), "shape"),
    ],
)
def test_goals_that_are_none_get_one_plain_sentence(planner, goals, words):
    with pytest.raises(BadConfiguration, match=words):
        planner.set_goals(goals)
    assert len(planner.goals) == 0


@each("costs", ["a", [None], [[1.0]], [np.nan], [1.0, 2.0]])
def test_costs_that_are_none_are_refused(planner, costs):
    with pytest.raises(BadConfiguration, match="costs"):
        planner.set_goals([AWAY], costs)


@each(
    ("argument", "value"),
    [
        ("covering_radius", "1 cm"),
        ("covering_radius", [0.01]),
        ("covering_radius", True),
        ("rounding", "1 cm"),
        ("rounding", -0.01),
        ("rounding", np.nan),
        ("labels", [[1], [1, 2]]),
        ("dq", [[1], [1, 2]]),
        ("points", [[0, 0, 0], [1, 1]]),
        ("points", None),
        ("closed", np.zeros(3)),
        ("now", "noon"),
        ("stamp", 10**400),
    ],
)
def test_other_arguments_of_a_frame_are_refused_and_the_last_frame_stays(
    asked, argument, value
):
    before = asked.separation(HOME)
    with pytest.raises(BadInput):
        asked.step(**{"points": NOBODY, "q": HOME, argument: value})
    assert asked.separation(HOME) == before < np.inf


@each("kind", [float, int, np.float32, np.float64, np.int64])
def test_times_of_any_number_are_taken_and_compile_nothing(asked, kind):
    kernels = (step.respond, step.notice)
    asked.step(BALL, q=HOME, stamp=1.0, now=1.0)
    asked.see(BALL, q=HOME, stamp=1.0, now=1.0)
    before = [len(kernel.signatures) for kernel in kernels]
    for times in ({"now": kind(2)}, {"stamp": kind(3), "now": kind(3)}):
        assert asked.step(BALL, q=HOME, **times).status != "holding"
        assert asked.see(BALL, q=HOME, **times) is None
    assert [len(kernel.signatures) for kernel in kernels] == before
    assert asked.step(BALL, q=HOME, now=2**70).status != "holding"


YES_OR_NO = {
    "by_links": lambda p, yes: p.is_free(HOME, AWAY, by_links=yes),
    "used": lambda p, yes: p.use_tight_ends(yes),
    "always_replan": lambda p, yes: setattr(p, "always_replan", yes),
}


@each("name", YES_OR_NO)
def test_an_array_says_neither_yes_nor_no(asked, name):
    saved = asked.save_memory()
    with pytest.raises(BadInput, match=f"{name} is array.* give True or False"):
        YES_OR_NO[name](asked, np.zeros(3))
    assert not differences(saved, asked.save_memory())
    YES_OR_NO[name](asked, np.bool_(False))


@each("extra", [None, "1 cm", 1j, np.array("a"), np.zeros(2), 10**400, [[1], 2]])
def test_a_distance_of_a_motion_away_is_a_number(asked, extra):
    path, nobody = np.stack([HOME, AWAY]), np.zeros((0, 7))
    for ask in (
        lambda: asked.clear_of_others(path, extra, nobody),
        lambda: asked.blocked_leg(path, extra),
    ):
        with pytest.raises(BadInput, match="extra is .* give metres"):
            ask()


@each("extra", [np.nan, np.inf, -0.1, 0.6, "1 cm", None, True])
def test_an_extra_clearance_out_of_range_is_refused(planner, extra):
    with pytest.raises(BadInput, match="extra clearance"):
        planner.set_extra_clearance(extra)


@each("budget", [-1, 1.5, np.nan, "all", None])
def test_a_budget_that_is_no_count_is_refused(planner, budget):
    with pytest.raises(BadInput, match="budget of improve"):
        planner.improve(budget)


@each("T", ["here", None, np.eye(3), [[1], [1, 2]]])
def test_poses_of_no_numbers_are_refused(planner, T):
    for ask in (planner.approach, planner.set_base):
        with pytest.raises(BadInput):
            ask(T)


@each(
    "given", [{"distance": "far"}, {"direction": "down"}, {"direction": [[1], [1, 2]]}]
)
def test_lines_of_no_numbers_are_refused(planner, given):
    with pytest.raises(BadInput):
        planner.approach(np.eye(4), **given)
