"""A panel of the application: how many rays of the selection have 0, 1, 2 … bounces."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Any

from query import as_criterion, bounces, select
from viewer.panels.panel import Application, Panel, Question
from viewer.panels.values import whole

__all__ = ["PANEL"]

_MARKUP = """
<p class="rm-hint">Up to <input class="rm-field" type="number" v-model.number="most_bounces"
  data-testid="most-bounces"/> bounces</p>
<table class="rm-table"><tbody><tr v-for="row in bounce_rows" :key="row.number"
  :data-testid="'bounces-' + row.number" @click="trigger('rm_only_bounces', [row.number])">
  <td>{{ row.number }}</td><td class="num">{{ row.rays }}</td></tr></tbody></table>
"""


def _counted(app: Application, cancel: threading.Event) -> dict[str, Any]:
    ray_map, text = app.session.map, app.session.state.criterion.strip()
    selected = as_criterion(text) if text else None
    rows = []
    for number in range(int(app.page.most_bounces) + 1):
        asked = bounces == number
        asked = asked if selected is None else selected & asked
        rows.append({"number": number, "rays": select(ray_map, asked, cancel=cancel).matched})
    return {"bounce_rows": rows}


async def _fill(app: Application, cancel: threading.Event) -> Sequence[Question]:
    return [lambda: _counted(app, cancel)]


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
    fields=lambda app: {"most_bounces": 3, "bounce_rows": []},
    incoming={"most_bounces": whole(9)},
    actions={"only_bounces": only_bounces},
    changes={("most_bounces",): _take_most},
    fill=_fill,
)
