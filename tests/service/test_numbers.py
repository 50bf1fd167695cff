"""Whatever stands at a key of a request, the client gets an error of ours in one line."""

from __future__ import annotations

import json
from typing import Any

import pyarrow.flight as flight
import pytest

from service import RaymapService
from tests.service.conftest import TOKEN

DIGITS = "9" * 400
VALUES = (
    DIGITS, f"-{DIGITS}", "9" * 5001, "1e400", "-1e400", "1e308", "NaN", "Infinity", "-0.0", "0",
    '""', '"."', '"./"', '"/"', '"~"', '":"', '"\\ud800"', '"\\u202e\\u001b[2J"', "[]", "[[]]",
    "{}", "true", "1e-320", "9223372036854775807", "18446744073709551615", '{"op": 1}',
    f'{{"op": "compare", "quantity": "length", "compare": ">", "value": {DIGITS}}}',
    f'{{"op": "count", "args": [], "compare": ">", "value": {DIGITS}}}',
    '{"op": "compare", "quantity": "length", "compare": ">", "value": 1, "unit": 5}',
    "[" * 500 + "]" * 500,
)  # fmt: skip
"""As they stand in JSON."""

CALLS = {
    "count": ("map", "criterion", "limit", "seconds", "threads", "detector"),
    "describe": ("map",),
    "report": ("map", "ray"),
    "criterion": ("map", "criterion", "text", "cursor"),
    "scene": ("scene", "variants", "text"),
    "record": ("scene", "map", "rays", "seconds", "seed", "threads", "variants"),
    "view": ("map", "criterion", "session"),
    "drawn": ("view", "size"),
    "close_view": ("view",),
    "files": ("folder", "path"),
    "rays": ("map", "criterion", "limit", "seconds", "ray_ids"),
    "lines": ("map", "criterion", "rays", "limit"),
    "paths": ("map", "criterion", "top", "by", "detector"),
    "image": ("map", "detector", "criterion", "channels"),
    "picture": ("map", "size", "criterion", "session", "line_width"),
}
"""Keys that are tried; what a call does not know is refused by its name."""


def answered(service: RaymapService, kind: str, body: bytes) -> str:
    """The error of a call, empty where it is answered."""
    options = flight.FlightCallOptions(
        timeout=60, headers=[(b"authorization", f"Bearer {TOKEN}".encode())]
    )
    with flight.connect(service.address) as client:
        try:
            if kind in ("rays", "lines", "paths", "image", "picture"):
                client.do_get(flight.Ticket(body), options).read_all()
            else:
                list(client.do_action(flight.Action(kind, body), options))
        except flight.FlightError as error:
            return str(error)
    return ""


@pytest.mark.parametrize("kind", CALLS)
def test_values_of_all_sorts(service: RaymapService, kind: str, capfd: Any) -> None:
    for key in CALLS[kind]:
        fields = {"map": '"small.raymap"', "detector": '"sensor"', "scene": '"nothing.toml"'}
        fields = {name: text for name, text in fields.items() if name in CALLS[kind]}
        if kind == "record":
            fields["map"] = '"new.raymap"'
        for value in VALUES:
            given = {**fields, key: value}
            if kind in ("rays", "lines", "paths", "image", "picture"):
                given["get"] = json.dumps(kind)
            body = "{" + ", ".join(f'"{name}": {text}' for name, text in given.items()) + "}"
            said = answered(service, kind, body.encode())
            assert "the service failed at this request" not in said, (key, value, said)
    assert "Traceback" not in capfd.readouterr().err
