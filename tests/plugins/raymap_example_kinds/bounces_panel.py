"""A panel of the application: how many rays of the selection have 0, 1, 2 … bounces."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from query import as_criterion, bounces, report, select
from viewer.panels.panel import Application, Panel, Question, Session
from viewer.panels.values import whole

__all__ = ["PANEL"]

_MARKUP = """
<p class="rm-hint">Up to <input class="rm-field" type="number" v-model.number="most_bounces"
  data-testid="most-bounces"/> bounces</p>
<table class="rm-table"><tbody><tr v-for="row in bounce_rows" :key="row.number"
  :data-testid="'bounces-' + row.number" @click="trigger('rm_only_bounces', [row.number])">
  <td>{{ row.number }}</td><td class="num">{{ row.rays }}</td></tr></tbody></table>
"""


class _Questions:
    """Counts, and knows what it has counted: of a larger number only the further rows are asked."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.counted: dict[tuple[str, int, int], int] = {}

    def rows(self, most: int, cancel: threading.Event) -> dict[str, Any]:
        ray_map, text = self.session.map, self.session.state.criterion.strip()
        selected = as_criterion(text) if text else None
        rows = []
        for number in range(most + 1):
            key = text, ray_map.rays, number
            if key not in self.counted:
                asked = bounces == number
                asked = asked if selected is None else selected & asked
                found = select(ray_map, asked, cancel=cancel)
                if not found.complete:
                    break
                self.counted[key] = found.matched
            rows.append({"number": number, "rays": self.counted[key]})
        return {"bounce_rows": rows}


async def _fill(app: Application, cancel: threading.Event) -> Sequence[Question]:
    questions: _Questions = app.questions["bounces"]
    most = int(app.page.most_bounces)
    return [lambda: questions.rows(most, cancel)]


async def _choose(app: Application, number: str, point: int | None) -> None:
    """Say how often a ray bounced that is chosen in the scene."""
    said = await app.ask(report, app.session.map, int(number))
    with app.page:
        app.page.bounces_of_ray = max(0, len(said["points"]) - 2)


async def _take_most(app: Application) -> None:
    if not app.quiet:
        await app.fill_panel(app.stopping, "bounces")


async def only_bounces(app: Application, number: int) -> None:
    """Select the rays of so many bounces."""
    await app.set_criterion(f"bounces == {int(number)}")


PANEL = Panel(
    word="bounces",
    title="Bounces",
    markup=lambda: _MARKUP,
    fields=lambda app: {"most_bounces": 3, "bounce_rows": [], "bounces_of_ray": None},
    questions=_Questions,
    incoming={"most_bounces": whole(9)},
    actions={"only_bounces": only_bounces},
    changes={("most_bounces",): _take_most},
    fill=_fill,
    ray=_choose,
)
