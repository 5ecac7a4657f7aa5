"""Obstacles by name and outline: what is taken, and what is wrong with the rest."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sandwich_sitl.errors import InputError
from sandwich_sitl.mission.reports import parse_obstacle

CRANE = {"name": "crane", "polygon": [[30, 12], [34, 12], [34, 18]], "height_m": 20}


def test_a_report_is_an_obstacle_whichever_way_round_its_corners_go() -> None:
    for polygon in (CRANE["polygon"], CRANE["polygon"][::-1]):
        obstacle = parse_obstacle(json.dumps(CRANE | {"polygon": polygon}).encode())
        assert (obstacle.name, obstacle.height_m, obstacle.polygon.area) == ("crane", 20.0, 12.0)
        assert obstacle.polygon.exterior.is_ccw
    assert parse_obstacle(json.dumps({k: CRANE[k] for k in ("name", "polygon")}).encode()).height_m is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": ""}, "name"),
        ({"name": 7}, "name"),
        ({"polygon": [[0, 0], [1, 1]]}, "polygon"),
        ({"polygon": [[0, 0], [1, 1], [1, 0], [0, 1]]}, "crosses itself"),
        ({"polygon": [[0, 0], [1, 1], [2, 2]]}, "no area"),
        ({"polygon": [[0, 0], [1, "x"], [1, 0]]}, "polygon.1.1"),
        ({"polygon": [[0, 0], [1e300, 0], [1, 1]]}, "polygon.1.0"),
        ({"height_m": -1}, "height_m"),
        ({"hight_m": 3}, "hight_m"),
    ],
)
def test_a_malformed_report_says_where(change: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        parse_obstacle(json.dumps(CRANE | change).encode())


@pytest.mark.parametrize(
    "payload", [b"", b"crane", b"[]", b"\xff\xfe", b'{"name": "a", "polygon": [[0, NaN]]}', b"9" * 70000]
)
def test_what_is_not_such_json_is_malformed(payload: bytes) -> None:
    with pytest.raises(InputError, match="obstacle report"):
        parse_obstacle(payload)


@given(st.binary(max_size=200))
def test_no_bytes_do_worse_than_that(payload: bytes) -> None:
    with pytest.raises(InputError):
        parse_obstacle(payload)


def test_a_name_cannot_write_lines_into_the_log() -> None:
    assert "\n" not in parse_obstacle(json.dumps(CRANE | {"name": "a\nb"}).encode()).name
