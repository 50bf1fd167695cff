"""Charts as encapsulated PostScript."""

from raymap.pictures.chart_formats.format import ChartFormat

FORMAT = ChartFormat(
    suffixes=(".eps",),
    title="a page of PostScript",
    write=lambda path, figure: figure.savefig(path, format="eps"),
)
