"""What a headless Chromium and axe make of reports: requests, console errors, width, print, accessibility.

apt install chromium; pip install playwright pypdf; npm install axe-core
python bench/interop/report_in_a_browser.py --axe node_modules/axe-core/axe.min.js --out SHOTS REPORT.html…

Each page is opened at 1280 and 390 px, light and dark, without a network, then printed. A page with known faults goes
first: should one of them not be found, the check itself is broken and nothing else is tried.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

WIDTHS_PX = (1280, 390)
SCHEMES = ("light", "dark")
SERIOUS = ("serious", "critical")
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
FAULTY = f"""<!DOCTYPE html><html><head><meta http-equiv="Content-Security-Policy" content="{POLICY}">
<title>faulty</title></head><body style="width:2000px"><main><p style="color:#999;background:#fff">pale</p>
<img src="http://192.0.2.1/x.png"><script>document.title = "ran"</script><script>throw Error("x")</script></main></body>
</html>"""
"""With a request, words that are too pale, a picture without words, and wider than any screen."""


@dataclass
class Found:
    """What one page did in all its openings."""

    requests: set[str] = field(default_factory=set)
    console: set[str] = field(default_factory=set)
    too_wide: set[str] = field(default_factory=set)
    axe: Counter[str] = field(default_factory=Counter)
    """Elements by ``impact: rule (opening)``."""
    sheets: int = 0

    @property
    def serious(self) -> int:
        """Elements with serious or critical faults."""
        return sum(count for fault, count in self.axe.items() if fault.startswith(SERIOUS))

    @property
    def faults(self) -> int:
        """Everything that must not be."""
        return len(self.requests) + len(self.console) + len(self.too_wide) + self.serious


def look(browser: Any, path: Path, axe: str, out: Path | None) -> Found:  # noqa: ANN401 (playwright's)
    """Open one page in every way.

    Args:
        browser: playwright's.
        path: of the page.
        axe: source of axe-core.
        out: folder for the pictures and the PDF, None keeps none.
    """
    found = Found()
    for width, scheme in ((width, scheme) for width in WIDTHS_PX for scheme in SCHEMES):
        opening = f"{width} px, {scheme}"
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme, offline=True)
        page = context.new_page()
        page.on("request", lambda request: found.requests.add(request.url))
        page.on("console", lambda told: found.console.add(f"{told.type}: {told.text}"))
        page.on("pageerror", lambda error: found.console.add(f"error: {error}"))
        page.goto(path.as_uri())
        found.requests = {url for url in found.requests if url != path.as_uri() and not url.startswith("data:")}
        wide = page.evaluate("document.documentElement.scrollWidth")
        if wide > width:
            found.too_wide.add(f"{opening}: {wide} px")
        policy = page.evaluate("(document.querySelector('meta[http-equiv=Content-Security-Policy]') || {}).content")
        if policy != POLICY:
            found.console.add(f"another policy: {policy}")
        if out is not None:
            page.screenshot(path=out / f"{path.stem}-{width}-{scheme}.png", full_page=True)
        # past the policy, as an extension of the browser would: not by an element of the page
        page.evaluate(axe)
        for fault in page.evaluate("axe.run().then(r => r.violations)"):
            found.axe[f"{fault['impact']}: {fault['id']} ({opening})"] += len(fault["nodes"])
        if out is not None and (width, scheme) == (WIDTHS_PX[0], "dark"):
            pdf = out / f"{path.stem}.pdf"
            page.pdf(path=pdf, format="A4", prefer_css_page_size=True)
            found.sheets = _sheets(pdf)
        context.close()
    return found


def _sheets(pdf: Path) -> int:
    import pypdf

    return len(pypdf.PdfReader(pdf).pages)


def faulty_is_found(browser: Any, axe: str) -> bool:  # noqa: ANN401 (playwright's)
    """Whether the faults of the faulty page are all found."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "faulty.html"
        path.write_text(FAULTY)
        found = look(browser, path, axe, None)
    rules = " ".join(found.axe)
    told = found.requests and found.console and found.too_wide
    return bool(told and "color-contrast" in rules and "image-alt" in rules)


def lines(path: Path, found: Found) -> Iterator[str]:
    """The page's row, of a table in Markdown, then what is wrong, a line each."""
    figures = (
        f"{path.stat().st_size / 1e6:.2f}",
        *map(str, (len(found.requests), len(found.console), len(found.too_wide), found.serious)),
        str(sum(found.axe.values()) - found.serious),
        str(found.sheets),
    )
    yield f"| {path.stem} | {' | '.join(figures)} |"
    for wrong in (*found.requests, *found.console, *found.too_wide):
        print(f"{path.name}: {wrong}", file=sys.stderr)
    for fault, count in found.axe.items():
        print(f"{path.name}: axe, {fault}: {count} elements", file=sys.stderr)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="+", type=Path)
    parser.add_argument("--axe", type=Path, required=True, help="axe.min.js of the npm package axe-core")
    parser.add_argument("--out", type=Path, required=True, help="folder for pictures and PDF")
    parser.add_argument("--chromium", default=shutil.which("chromium"), help="(%(default)s)")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    axe = asked.axe.read_text(encoding="utf-8")
    from playwright.sync_api import sync_playwright

    worst = 0
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=asked.chromium)
        print(f"Chromium {browser.version}, axe-core {axe.split('v', 1)[1].split()[0]}\n")
        if not faulty_is_found(browser, axe):
            print("the faulty page's faults were not found: this check is broken", file=sys.stderr)
            return 2
        print("| report | MB | requests | console | too wide | axe serious | axe other | sheets |")
        print(f"|---|{'---:|' * 7}")
        for path in asked.pages:
            found = look(browser, path.resolve(), axe, asked.out)
            worst = max(worst, found.faults)
            print("\n".join(lines(path, found)), flush=True)
        browser.close()
    return 1 if worst else 0


if __name__ == "__main__":
    sys.exit(main())
