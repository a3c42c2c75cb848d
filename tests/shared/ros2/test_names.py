"""Keys, tokens and attachments, against the examples of rmw_zenoh's design and of its source."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.errors import WireError
from surveilnav.ros2.names import Attachment, Entity, Qos, data_key, dds_type, qualified, ros_type, type_in_key

STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
ADD_HASH = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
#: From https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md
TALKER = (
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/"
    f"{STRING_HASH}/::,7:,:,:,,"
)
SERVER = (
    "@ros2_lv/2/f9980ee0495eaafb3e38f0d19e2eae12/0/10/SS/%/%/add_two_ints_server/%add_two_ints/"
    f"example_interfaces::srv::dds_::AddTwoInts_/{ADD_HASH}/::,10:,:,:,,"
)
NODE = "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"


@pytest.mark.parametrize("token", [TALKER, SERVER, NODE])
def test_tokens_of_the_design_are_read_and_written(token):
    assert Entity.from_token(token).token() == token


def test_what_a_token_says():
    talker = Entity.from_token(TALKER)
    assert (talker.domain, talker.id, talker.kind, talker.node) == (2, 10, "MP", "talker")
    assert (talker.name, talker.type_name, talker.qos) == ("/chatter", "std_msgs/msg/String", Qos(depth=7))
    assert talker.data_key() == f"2/chatter/std_msgs::msg::dds_::String_/{STRING_HASH}"
    assert type_in_key(talker.data_key()) == "std_msgs/msg/String"
    assert (
        Entity.from_token(SERVER).data_key() == f"2/add_two_ints/example_interfaces::srv::dds_::AddTwoInts_/{ADD_HASH}"
    )


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (Qos(depth=10), "::,10:,:,:,,"),
        (Qos(depth=0), "::,:,:,:,,"),
        (Qos(reliable=False, depth=5), "2::,5:,:,:,,"),
        (Qos(transient_local=True, depth=1), ":1:,1:,:,:,,"),
        (Qos(reliable=False, transient_local=True, keep_all=True, depth=10), "2:1:2,10:,:,:,,"),
    ],
)
def test_qos_is_as_in_rmw_zenoh(qos, text):
    assert qos.encode() == text
    decoded = Qos.decode(text)
    assert decoded.encode() == text


@pytest.mark.parametrize(
    "token",
    [
        "",
        "@ros2_lv",
        NODE + "/more",
        NODE.replace("NN", "XX"),
        NODE.replace("@ros2_lv/2", "@ros2_lv/two"),
        TALKER.replace("String_", "String"),
        TALKER.replace(",7", ",x"),
        "other/2/z/0/0/NN/%/%/listener",
    ],
)
def test_what_is_no_token_is_refused(token):
    with pytest.raises(WireError):
        Entity.from_token(token)


names = st.from_regex(r"[a-z][a-z0-9_]{0,8}", fullmatch=True)


@given(names, st.lists(names, max_size=3), names, st.integers(0, 232))
def test_namespaces_survive_a_token(node, spaces, topic, domain):
    namespace = "/" + "/".join(spaces) if spaces else ""
    name = qualified(topic, namespace)
    entity = Entity(domain, "z", 0, 1, "MS", node, namespace, "", name, "nav_msgs/msg/Odometry", STRING_HASH)
    assert Entity.from_token(entity.token()) == entity
    assert entity.data_key() == data_key(domain, name, "nav_msgs/msg/Odometry", STRING_HASH)
    assert ros_type(dds_type("nav_msgs/msg/Odometry")) == "nav_msgs/msg/Odometry"


@given(st.integers(0, 2**62), st.integers(0, 2**62), st.binary(min_size=16, max_size=16))
def test_attachments(sequence, stamp_ns, gid):
    attachment = Attachment(sequence, stamp_ns, gid)
    data = attachment.encode()
    assert len(data) == 33, "8 bytes number, 8 time, 1 length, 16 sender"
    assert (data[:8], data[16]) == (sequence.to_bytes(8, "little"), 16)
    assert Attachment.decode(data) == attachment
    with pytest.raises(WireError):
        Attachment.decode(data[:-1])
