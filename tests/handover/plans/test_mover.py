"""What an arm keeps clear of, against exact distances of the same postures."""

from dataclasses import replace

import numpy as np

import handover
from handover.plans.limb import limb_of
from handover.plans.mover import Mover
from handover.scenes.start_check import start_distances


def test_a_bent_wrist_must_not_bring_a_finger_into_the_forearm():
    scene = handover.load_scene("varied", 43)  # a person takes the object
    placed, side = scene.receiver, scene.receiver.arms[0]
    limb = limb_of(placed.agent, side)
    other = limb_of(scene.giver.agent, scene.giver.arms[0])
    mover = Mover(scene, placed, limb, scene.giver, other)
    rng, refused, clear = np.random.default_rng(0), 0, 0
    palm = limb.spec.root
    fingers = {p.link for p in limb.parts[limb.groups[-1][1] :]} - {palm}
    links = {name for name, _, _ in limb.groups[:-1]}
    assert any((link, palm) in placed.body.neighbours for link in links)
    home = np.array([placed.joints[name] for name in limb.joints])
    bent = slice(limb.n_arm - 2, limb.dof)  # the wrist, and what follows
    for draw in rng.uniform(limb.lower, limb.upper, (50, limb.dof)):
        q = home.copy()
        q[bent] = draw[bent]
        joints = placed.joints | dict(zip(limb.joints, q.tolist(), strict=True))
        posed = replace(scene, receiver=replace(placed, joints=joints))
        near = [
            {one.partition("/")[2], two.partition("/")[2]}
            for distance, one, two in start_distances(posed)
            if distance <= 0.0
        ]
        trouble = mover.why(q)[1]
        if any(pair & fingers and pair & links for pair in near):
            refused += 1
            assert trouble is not None
        clear += trouble is None
    assert refused > 3 and clear > 5
