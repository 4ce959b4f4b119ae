"""MAVLink on the wire: bytes in, checked packets and decoded samples out, and frames encoded the other way."""
