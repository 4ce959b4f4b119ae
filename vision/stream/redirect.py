"""Where an HTTP server sends on to, which is followed to the same host alone.

Whoever names an address names a host. Its server may move a stream there or begin to encrypt; that it has this computer
ask another host, or open a file, is refused.
"""

from __future__ import annotations

import ssl
from contextlib import closing
from dataclasses import replace
from urllib.parse import urljoin, urlsplit

from infra.plain_text import plain
from infra.secrets import concealed
from vision.errors import VideoError
from vision.stream.source import Source

__all__ = ["sent_on"]

SCHEMES = ("http", "https")
_MOST_SHOWN = 200


def sent_on(source: Source, timeout_s: float) -> Source | None:
    """The source at the address that its server names instead; None where it names none.

    The server is asked without a password.

    Args:
        source: an address of HTTP.
        timeout_s: for the connection and each answer.

    Raises:
        VideoError: the server names another host, or something else than HTTP.
    """
    named = _named(source.address, timeout_s)
    if not named:
        return None
    parts = urlsplit(source.address)
    goal = urlsplit(urljoin(source.address, named))
    if goal.scheme not in SCHEMES or goal.hostname != parts.hostname:
        shown = plain(concealed(goal.geturl()))[:_MOST_SHOWN]
        raise VideoError(
            f"video {source.text}: its server sends on to {shown}, which is not followed: only what is on the same "
            "host is; give that address if it is meant"
        )
    user, at, _ = parts.netloc.rpartition("@")
    place = goal.netloc.rpartition("@")[2]
    return replace(source, address=goal._replace(netloc=f"{user}{at}{place}", fragment="").geturl())


def _named(address: str, timeout_s: float) -> str:
    """The address in the server's answer, empty where there is none."""
    # only after a failure: each process of a stream would load it
    from http.client import HTTPConnection, HTTPException, HTTPSConnection

    parts = urlsplit(address)
    unverified = ssl.create_default_context()  # as FFmpeg asks: cameras sign their certificates themselves
    unverified.check_hostname, unverified.verify_mode = False, ssl.CERT_NONE
    try:
        place = parts.hostname or "", parts.port
        line = (
            HTTPSConnection(*place, timeout=timeout_s, context=unverified)
            if parts.scheme == "https"
            else HTTPConnection(*place, timeout=timeout_s)
        )
        with closing(line):
            line.request("GET", parts._replace(scheme="", netloc="", fragment="").geturl() or "/")
            answer = line.getresponse()
            return answer.headers.get("Location", "") if 300 <= answer.status < 400 else ""
    except (OSError, HTTPException, ValueError):
        return ""
