"""What is known of classes by name."""

from __future__ import annotations

import msgspec
import pytest

from surveilnav.categories import COCO
from surveilnav.errors import ConfigError
from surveilnav.perception.class_priors import FILE, class_priors


class Sizes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    size_m: dict[str, float]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "priors.json"
    path.write_text('{"somebody": {"size_m": {"bed": 2.0}}, "another": {"length_m": {}}}')
    return path


def test_a_consumer_reads_its_own_section(file):
    assert class_priors("somebody", Sizes, file) == Sizes({"bed": 2.0})


@pytest.mark.parametrize(
    ("section", "said"),
    [("nobody", "no section 'nobody'; it has another, somebody"), ("another", "isn't what Sizes says")],
)
def test_what_is_wrong_is_named(file, section, said):
    with pytest.raises(ConfigError, match=said):
        class_priors(section, Sizes, file)


def test_classes_have_the_names_of_coco():
    for section, tables in msgspec.json.decode(FILE.read_bytes()).items():
        for name, table in tables.items():
            assert set(table) <= set(COCO), f"{section}.{name}"
