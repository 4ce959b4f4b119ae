"""YAML from other programs, in which a value has one place: repeated by reference, some lines would grow beyond all
memory."""

from __future__ import annotations

MAX_YAML_BYTES = 256 << 10
"""Descriptions of cameras and lists of class names take some thousand; PyYAML reads a million a second at best."""


def parse_yaml(text: str) -> object:
    """Content of a document.

    Raises:
        ValueError: it cannot be read, is too long, or refers to itself; in one line.
    """
    import yaml  # loaded by those who read some

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
            if self.check_event(yaml.AliasEvent):
                raise ValueError("*name refers to another value; write it out")
            return super().compose_node(parent, index)

    if len(text) > MAX_YAML_BYTES:
        raise ValueError(f"not YAML that can be read: longer than {MAX_YAML_BYTES >> 10} KiB")
    try:
        return yaml.load(text, Loader)
    except (yaml.YAMLError, ValueError, LookupError, RecursionError) as error:
        raise ValueError(f"not YAML that can be read: {' '.join(str(error).split())[:100]}") from None
