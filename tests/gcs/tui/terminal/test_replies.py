from __future__ import annotations

import pytest

from gcs.tui.terminal.replies import KEY_HOLD_S, REPLY_HOLD_S, REPORT, Replies

ATTRIBUTES = "\x1b[?64;1;2;6;9;15;16;17;18;21;22;28c"
TYPED = "q?\x1b[A\x1b[1;2R\x1b[5~\x1b[?2026;2$y\x1b[<0;3;4M\x1b[48;24;80;480;800tz\x1b[200~pasted\x1b[201~"


def test_replies_in_parts_of_any_size_are_no_keys():
    said = (
        ATTRIBUTES,
        REPORT,
        "\x1b[6;20;10t",
        "\x1b_Gi=31;OK\x1b\\",
        "\x1b]11;rgb:00/00/00\x07",
        "\x1bP>|term 1\x1b\\",
    )
    keys = ("q", "?", "\x1b[A", "\x1b[5~", "\x1b[?2026;2$y", "é")
    text = "".join(key + reply for key, reply in zip(keys, said, strict=True))
    for size in range(1, len(text) + 1):
        found: list[str] = []
        replies = Replies(found.append)
        typed = "".join(replies.keys_in(text[at : at + size]) for at in range(0, len(text), size)) + replies.release()
        assert (typed, tuple(found)) == ("".join(keys), said), size


def test_what_is_typed_goes_through():
    replies = Replies(pytest.fail)
    assert replies.keys_in(TYPED) == TYPED
    assert replies.hold_s is None


@pytest.mark.parametrize("key", ["\x1b", "\x1b[", "\x1b]", "\x1bP", "\x1b_"])
def test_a_key_that_could_begin_a_reply_is_held_for_a_moment(key):
    replies = Replies(pytest.fail)
    assert replies.keys_in(key) == ""
    assert replies.hold_s == KEY_HOLD_S
    assert replies.release() == key
    assert replies.hold_s is None


@pytest.mark.parametrize("begun", ["\x1b[?62;4", "\x1b[>41;", "\x1b_Gi=31"])
def test_a_reply_that_never_ends_is_no_key_either(begun):
    replies = Replies(pytest.fail)
    assert replies.keys_in(begun) == ""
    assert replies.hold_s == REPLY_HOLD_S
    assert replies.release() == ""


def test_endless_nonsense_is_not_kept():
    replies = Replies(pytest.fail)
    assert len(replies.keys_in("\x1b_G" + "x" * 100_000)) == 100_003
