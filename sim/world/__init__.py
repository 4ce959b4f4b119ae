"""The true world: a scenario in, where everything is at any time out; nothing in it is measured."""
