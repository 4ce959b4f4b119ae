"""Every action of the screens with its keys and words: what the help lists and the command palette runs."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator, Sequence
from dataclasses import dataclass

from textual.app import App
from textual.binding import Binding
from textual.command import DiscoveryHit, Hit, Hits, Provider
from textual.content import Content
from textual.keys import format_key
from textual.markup import escape

from gcs.tui.keys import GROUPS, LIVE_ACTIONS
from gcs.tui.panes.pane import Pane
from infra.plain_text import plain

KEYS_CELLS = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class Action:
    """Something that the operator can have done."""

    group: str
    keys: str
    """Keys as they are shown, empty without any."""
    words: str
    """Effect of the keys: plain text."""
    run: str
    """The action in Textual's form."""
    pane: Pane | None = None
    """The pane that does it when it has the focus, None: the app does."""


def keys_of(binding: Binding) -> str:
    """A binding's keys as they are shown: ``↑ k``."""
    if binding.key_display:
        return binding.key_display
    return " ".join(format_key(key.strip()) for key in binding.key.split(",")).replace(format_key("enter"), "enter")


def actions(panes: Sequence[Pane], *, live: bool) -> Iterator[Action]:
    """All actions of the app, then those of each pane on screen or not."""
    for title, bindings in GROUPS:
        if title != "Replay" or not live:
            for each in (each for each in bindings if live or each.action not in LIVE_ACTIONS):
                yield Action(group=title, keys=keys_of(each), words=each.tooltip, run=each.action)
    for pane in panes:
        for binding in pane.BINDINGS:
            assert isinstance(binding, Binding)
            keys = keys_of(binding)
            group = f"{pane.label.capitalize()}, in the focus"
            yield Action(group=group, keys=keys, words=binding.tooltip, run=binding.action, pane=pane)


class ActionProvider(Provider):
    """The command palette's list: every action of the app and of the panes on screen, and every vehicle."""

    async def discover(self) -> Hits:
        """Offer all actions."""
        for action in self._offered():
            yield DiscoveryHit(_shown(action, Content(action.words)), self._runner(action), action.words)

    async def search(self, query: str) -> Hits:
        """Offer the actions whose words are like the typed ones."""
        matcher = self.matcher(query)
        for action in self._offered():
            if (score := matcher.match(action.words)) > 0:
                shown = _shown(action, matcher.highlight(escape(action.words)))
                yield Hit(score, shown, self._runner(action), action.words)

    def _offered(self) -> Iterator[Action]:
        panes = [pane for pane in self.screen.query(Pane) if pane.display]
        live = not self.app.check_action("toggle_play", ())
        yield from actions(panes, live=live)
        for system_id, name in _vehicles(self.app):
            yield Action(group="Vehicles", keys="", words=f"Pick {plain(name)}", run=f"app.pick_vehicle({system_id})")

    def _runner(self, action: Action) -> Callable[[], Awaitable[None]]:
        async def run() -> None:
            if action.pane is not None:
                self.screen.set_focus(action.pane)
            await (action.pane or self.app).run_action(action.run)

        return run


def _vehicles(app: App[object]) -> Iterator[tuple[int, str]]:
    snapshot = getattr(app, "snapshot", None)
    for row in snapshot.vehicles if snapshot is not None else ():
        yield row.system_id, row.name


def _shown(action: Action, words: Content) -> Content:
    """Keys before the words."""
    return Content.assemble((f"{action.keys:<{KEYS_CELLS}}", "$primary"), words)
