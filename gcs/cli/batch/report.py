"""``gcs batch report``: a batch's results in, one page over all flights out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gcs.cli.output.console import print_lines

PAGE = "report.html"


def report(
    results: Annotated[str, typer.Argument(help="Folder or address that a batch wrote its results to.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help=f"HTML file, which must not be there yet; else {PAGE} of the results."),
    ] = None,
) -> None:
    """Make one page over all flights of a batch: sums, failures, the worst flights first and why."""
    from gcs.batch.addresses import is_remote, local_path
    from gcs.batch.report.overview import batch_page, read_results
    from gcs.batch.stores import open_results
    from gcs.export.unfinished import Unfinished
    from infra.secrets import concealed

    store = open_results(results if is_remote(results) else str(local_path(results).absolute()))
    page = batch_page(read_results(store), concealed(results)).encode()
    if out is None:
        store.write(page, PAGE)
        print_lines(f"wrote {results.rstrip('/')}/{PAGE}")
        return
    unfinished = Unfinished(out)
    unfinished.path.write_bytes(page)
    unfinished.finish()
    print_lines(f"wrote {out}")
