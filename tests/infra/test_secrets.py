"""Secrets in addresses, wherever they stand: hidden once, they are in no text any more."""

import pytest

from infra import secrets
from infra.secrets import conceal, concealed, hide


@pytest.fixture(autouse=True)
def nothing_hidden(monkeypatch):
    monkeypatch.setattr(secrets, "_hidden", [])


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("s3://KEY:s3cretKey1@bucket/day=3", "s3://***@bucket/day=3"),
        ("https://h/f.tlog?X-Amz-Credential=AK/eu&X-Amz-Signature=s3cretKey1", None),
        ("simplecache::https://u:s3cretKey1@h/f.tlog", "simplecache::https://***@h/f.tlog"),
        ("tcp://u:s3cretKey1@head:8786", "tcp://***@head:8786"),
        ("https://h/f.tlog?s3cretKey1", "https://h/f.tlog?***"),
        ("https://h/f.tlog#s3cretKey1", "https://h/f.tlog#***"),
        ("https://h/f.tlog?rw&key[a]=s3cretKey1#t=s3cretKey1", "https://h/f.tlog?rw&key[a]=***#t=***"),
        ("s3://KEY:s3cretKey1@bucket/flight#3", "s3://***@bucket/flight#3"),
        ("cot+tls://u:s3cretKey1@h:8089?cert=me.pem", "cot+tls://***@h:8089?cert=***"),
        ("rtmp://h:1935/live/s3cretKey1", "rtmp://h:1935/live/***"),
        ("rtsps://h:7441/s3cretKey1?enableSrtp", "rtsps://h:7441/***?***"),
    ],
)
def test_what_was_hidden_is_in_no_text(address, shown):
    shown = shown or "https://h/f.tlog?X-Amz-Credential=***&X-Amz-Signature=***"
    assert concealed(address) == shown
    hide(address)
    assert conceal(f"{address}: refused") == f"{shown}: refused"
    assert "s3cretKey1" not in conceal(f"no such key: 's3cretKey1', of {address[8:]}")


def test_folders_of_a_store_are_no_secrets():
    assert concealed("s3://bucket/day=3/flight.tlog") == "s3://bucket/day=3/flight.tlog"


def test_a_short_key_of_rtmp_is_found_behind_its_application():
    hide("rtmp://h/app/k9")
    assert conceal("rtmp://h/app/k9: no such stream: app/k9") == "rtmp://h/app/***: no such stream: app/***"


def test_short_values_leave_other_words_alone():
    hide("https://h/x?type=tlog&part=3")
    assert conceal("a.tlog, part 3 of type=tlog") == "a.tlog, part 3 of type=***"
