"""A home's pieces get their classes by what they are called, in the language of the home."""

from __future__ import annotations

import pytest

from surveilnav.simulator.plans.homes import build_home
from surveilnav.simulator.plans.sweethome import read_home

HOME = """<home version='7000' wallHeight='250'><room><point x='0' y='0'/><point x='900' y='0'/><point x='900' y='600'/>
<point x='0' y='600'/></room>{}</home>"""
PIECE = "<pieceOfFurniture name='{}' catalogId='{}' x='{}' y='300' width='90' depth='90' height='80'/>"


@pytest.mark.parametrize(
    ("pieces", "labels"),
    [
        ({"Bett": "", "Nachttisch": "", "Kühlschrank": ""}, ["bed", "", "refrigerator"]),
        ({"Стол": "", "Легло": "", "Маса": "", "Гардероб": ""}, ["chair", "bed", "dining table", ""]),
        ({"Стол": "", "Кровать": "", "Диван": ""}, ["dining table", "bed", "couch"]),
        ({"Стол": "Sheep#coffeeTable", "Mein Lieblingsstück": "Geantick#barStool", "Bank": ""}, ["", "chair", "bench"]),
    ],
)
def test_pieces_are_named_in_the_home_s_language(pieces: dict[str, str], labels: list[str]) -> None:
    rows = (PIECE.format(name, id_, 100 + 200 * i) for i, (name, id_) in enumerate(pieces.items()))
    home = read_home(HOME.format("".join(rows)).encode(), "home")
    scene = build_home(home, "home", 0, None, None, "a test")
    found = {i.name: i.label for i in scene.instances}
    assert [found[name] for name in pieces] == labels
