"""Bodies of a scene with what they take from one another filled in."""

from __future__ import annotations

import numpy as np

from raymap.model.errors import SceneError
from raymap.model.names import nearest_names
from tracer.bodies.body import Body
from tracer.bodies.lens import LensBody
from tracer.scene.checks import check_lenses
from tracer.scene.model import Scene

__all__ = ["resolve_bodies"]


def _circle(name: str, lenses: dict[str, LensBody]) -> list[str]:
    """Lenses that are cemented to one another and in the end to the first; empty if none are."""
    chain = [name]
    while (before := lenses[chain[-1]].front.cemented) in lenses:
        if before == name:
            return chain
        if before in chain:
            break
        chain.append(before)
    return []


def resolve_bodies(scene: Scene) -> dict[str, Body]:
    """The bodies with cemented faces filled in, each checked on its own.

    Raises
    ------
    SceneError
        impossible shapes, a cement partner that is missing or elsewhere
    """
    lenses = {n: b for n, b in scene.bodies.items() if isinstance(b, LensBody)}
    bodies: dict[str, Body] = {}
    behind: dict[str, str] = {}
    for name, body in scene.bodies.items():
        where = f"{scene.origin}: bodies.{name}"
        if isinstance(body, LensBody) and body.front.cemented is not None:
            partner = lenses.get(body.front.cemented)
            if partner is None or partner is body:
                raise SceneError(
                    f"{where}.front.cemented: there is no lens {body.front.cemented!r} before "
                    f"it{nearest_names(body.front.cemented, lenses)}"
                )
            circle = _circle(name, lenses)
            if circle:
                raise SceneError(
                    f"{where}.front.cemented: the lenses {' and '.join(map(repr, circle))} are "
                    "cemented in a circle; one of them needs a front of its own"
                )
            other = behind.setdefault(body.front.cemented, name)
            if other != name:
                raise SceneError(
                    f"{where}.front.cemented: the back of {body.front.cemented!r} is cemented to "
                    f"{other!r} already; a face joins two lenses"
                )
            origin, frame = partner.frame()
            vertex = origin + partner.thickness * frame[:, 2]
            gap = float(np.linalg.norm(np.array(body.position) - vertex))
            if gap > 1e-9 or not np.allclose(frame, body.frame()[1], atol=1e-12):
                raise SceneError(
                    f"{where}.position: the cemented front lies {gap:.4g} away from the back of "
                    f"{body.front.cemented!r} or is turned; put it at {vertex.tolist()}"
                )
            shape = partner.back.model_copy(update={"cemented": body.front.cemented})
            body = body.model_copy(update={"front": shape})
        problems = [*body.problems(), *_idle(body)]
        if problems:
            raise SceneError(f"{where}.{problems[0]}")
        bodies[name] = body
    check_lenses(bodies, scene.origin)
    return bodies


def _idle(body: Body) -> list[str]:
    """What a body of no medium says in vain."""
    if body.medium is None and body.priority:
        return ["priority: decides between media that overlap; the body has no medium: drop it"]
    return []
