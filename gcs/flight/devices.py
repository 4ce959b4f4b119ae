"""Radios and cameras that are plugged into this computer, by their names in the file system: none is opened for it."""

from __future__ import annotations

from pathlib import Path

DEV, CLASSES = Path("/dev"), Path("/sys/class/video4linux")
SERIAL = {"ttyACM*": 115200, "ttyUSB*": 57600, "cu.usbmodem*": 115200, "cu.usbserial*": 57600}
"""Names of serial ports on Linux and macOS that radios and autopilots have, with the rate that these usually speak: SiK
radios 57600, autopilots at their own USB port any."""


def serial_links() -> tuple[str, ...]:
    """Links of the serial ports that are there, such as ``/dev/ttyUSB0,57600``."""
    return tuple(f"{path},{baud}" for kind, baud in SERIAL.items() for path in sorted(DEV.glob(kind)))


def cameras() -> dict[str, str]:
    """Cameras by their device, such as ``/dev/video0``, with what they are called.

    A camera has several devices on Linux; the first of each gives pictures.
    """
    found = {}
    for folder in sorted(CLASSES.glob("video*"), key=lambda path: (len(path.name), path.name)):
        try:
            first = (folder / "index").read_text().strip() == "0"
            name = (folder / "name").read_text(errors="replace").strip()
        except OSError:  # unplugged meanwhile
            continue
        if first and (DEV / folder.name).exists():
            found[str(DEV / folder.name)] = name
    return found
