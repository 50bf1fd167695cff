"""``raymap histogram``: how the flux of some light is spread over a number of its rays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from query.cli.options import Criterion, Filter, Threads, read_criterion
from raymap.cli.options import Json, MapPath, Strict, emit_json, opened_map
from raymap.model.doubt import FOOTNOTE, MARK, with_error

if TYPE_CHECKING:
    from query.answers.reports.histograms import Histogram, Series

__all__ = ["histogram"]

_WIDTH = 24
"""Characters of the longest bar."""


def histogram(
    map: MapPath,
    quantity: Annotated[
        str,
        typer.Argument(
            help='length, optical_length, time, wavelength, bounces, flux, incidence(hit("L1")), '
            'x(hit("L1")), y, z; of a detector u("sensor"), v, radius, angle.'
        ),
    ],
    criterion: Criterion = None,
    by: Annotated[
        Literal["path", "source", "object", "wavelength"] | None,
        typer.Option(help="Tell these apart; objects are those where rays end."),
    ] = None,
    bins: Annotated[int, typer.Option(min=1, max=100_000, help="How many.")] = 20,
    low: Annotated[float | None, typer.Option("--from", help="Where the first bin begins.")] = None,
    high: Annotated[float | None, typer.Option("--to", help="Where the last bin ends.")] = None,
    log: Annotated[bool, typer.Option("--log", help="Bins of equal ratios.")] = False,
    cumulative: Annotated[
        bool, typer.Option("--cumulative", help="Bars of the flux up to each bin.")
    ] = False,
    filter_string: Filter = False,
    threads: Threads = None,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Show how flux is spread over length, time, angle or another number of the rays."""
    from query.answers.reports.histograms import histogram as histogram_of
    from raymap.model.errors import RayMapError

    if (low is None) != (high is None):
        raise RayMapError("give both --from and --to, or neither")
    bounds = None if low is None or high is None else (low, high)
    with opened_map(map, strict) as ray_map:
        wanted: Any = read_criterion(criterion, ray_map, filter_string)
        found = histogram_of(
            ray_map, quantity, wanted, by=by, bins=bins, bounds=bounds, log=log, threads=threads
        )
    if json:
        emit_json(found.to_json())
        return
    _print(found, cumulative)


def _print(found: Histogram, cumulative: bool) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(soft_wrap=True, highlight=False)
    shown: list[str] = []
    if not any(series.count for series in found.series):
        console.print("no ray of the criterion has such a number")
    for series in found.series:
        if not series.count:
            continue
        lines = _lines(series, found)
        shown += lines
        for line in lines:
            console.print(line, markup=False)
        table = Table()
        table.add_column(Text(f"from [{found.unit}]" if found.unit else "from"))
        table.add_column("to")
        table.add_column(Text(f"flux [{found.flux_unit}]"), no_wrap=True)
        table.add_column("up to here" if cumulative else "")
        most = max((each.flux for each in series.bins), default=0.0) or 1.0
        for each, held in zip(series.bins, series.cumulative, strict=True):
            part = held if cumulative else each.flux / most
            bar = "█" * round(_WIDTH * part)
            flux = with_error(each.flux, each.flux_se) if each.rays else "0"
            shown.append(flux)
            table.add_row(
                f"{each.low:.5g}",
                f"{each.high:.5g}",
                flux,
                Text(f"{held:.1%} {bar}" if cumulative else bar),
            )
        console.print(table)
    if found.undefined:
        why = f": {found.reason}" if found.reason else ""
        console.print(
            f"{found.undefined:,} rays have no such number, and are left out{why}", markup=False
        )
    if any(text.endswith(MARK) for text in shown):
        console.print(FOOTNOTE)


def _lines(series: Series, found: Histogram) -> list[str]:
    """What is told of a series as a whole; the number itself is not marked: it may be near 0."""
    unit = f" {found.unit}" if found.unit else ""
    head = "" if found.by is None else f"{series.name}: "
    quantiles = ", ".join(
        f"{float(share):.0%} below {value:.5g} (standard error {series.quantiles_se[share]:.2g})"
        for share, value in series.quantiles.items()
    )
    return [
        f"{head}{with_error(series.flux, series.flux_se, f' {found.flux_unit}')}, "
        f"{series.count:,} numbers",
        f"mean {series.mean:.6g}{unit} (standard error {series.mean_se:.2g}), spread "
        f"{series.spread:.5g}{unit} (standard error {series.spread_se:.2g})",
        quantiles,
    ]
