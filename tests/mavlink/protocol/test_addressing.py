"""Whom a frame is addressed to."""

from __future__ import annotations

import re

from pymavlink.dialects.v20 import ardupilotmega as dialect

from mavlink.protocol.addressing import BROADCAST, target_of
from mavlink.protocol.encoder import MavlinkEncoder


def test_target_of_every_message_that_has_one():
    mav = dialect.MAVLink(None, srcSystem=9, srcComponent=8)
    tried = 0
    for message in dialect.mavlink_map.values():
        if "target_system" not in message.fieldnames:
            continue
        values = [
            b"" if kind == "char" else [0] * length if length > 1 else 0
            for kind, length in zip(message.fieldtypes, (message.lengths[i] for i in message.orders), strict=True)
        ]
        values[message.fieldnames.index("target_system")] = 77
        if "target_component" in message.fieldnames:
            values[message.fieldnames.index("target_component")] = 5
        raw = message(*values).pack(mav)
        assert target_of(raw) == (77, 5 if "target_component" in message.fieldnames else 0), message.msgname
        tried += 1
    assert tried > 80
    manual = dialect.MAVLink_manual_control_message(77, 1, 2, 3, 4, 5).pack(mav)
    assert target_of(manual) == (77, 0), "its field has another name"
    named = {"gcs_system_id", "primary_control_sysid", "secondary_control_sysid", "system_status"}
    for message in dialect.mavlink_map.values():
        odd = {name for name in message.fieldnames if re.search("target$|sysid|system", name)} - named
        assert odd <= {"target_system"} or message.msgname == "MANUAL_CONTROL", message.msgname
    assert target_of(MavlinkEncoder(1).heartbeat()) == BROADCAST
    assert target_of(MavlinkEncoder(3, version=1).pack(dialect.MAVLink_command_ack_message(400, 0))) == BROADCAST
