"""A map behind a service, with the questions of a local one: query, paths, report, image, view."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from raymap.model.doubt import FOOTNOTE, marked
from raymap.model.replacing import replacing

__all__ = ["RemoteImage", "RemoteMap", "RemotePaths", "RemoteSelection", "RemoteView"]

_SHOWN = 20


class Service(Protocol):
    """What a map asks of the service behind which it lies (`raymap.remote.client.Service`)."""

    @property
    def address(self) -> str: ...
    def ask(self, action: str, request: Mapping[str, Any]) -> dict[str, Any]: ...
    def stream(self, kind: str, request: Mapping[str, Any]) -> Any: ...
    def table(self, kind: str, request: Mapping[str, Any]) -> Any: ...


class RemoteMap:
    """A map of the served folder.

    Attributes
    ----------
    name : in the served folder
    about : what it holds, as `raymap info --json` says it
    """

    def __init__(self, service: Service, name: str) -> None:
        self.service, self.name = service, name
        self.about = service.ask("describe", {"map": name})

    def refresh(self) -> None:
        """Take in what was recorded since."""
        self.about = self.service.ask("describe", {"map": self.name})

    @property
    def rays(self) -> int:
        """Rays stored."""
        return int(self.about["rays"])

    @property
    def records(self) -> int:
        """Segment records stored."""
        return int(self.about["records"])

    @property
    def finished(self) -> bool:
        """Whether its recording has ended."""
        return bool(self.about["finished"])

    @property
    def sources(self) -> list[str]:
        """Names of the light sources."""
        return list(self.about["sources"])

    @property
    def objects(self) -> list[str]:
        """Names of the bodies."""
        return list(self.about["objects"])

    @property
    def faces(self) -> list[str]:
        """Full names of the faces: ``object.face``."""
        return list(self.about["faces"])

    @property
    def detectors(self) -> list[str]:
        """Names of the detectors."""
        return list(self.about["detectors"])

    @property
    def units(self) -> dict[str, str]:
        """``length`` and ``flux``."""
        return dict(self.about["units"])

    def query(self, criterion: Any = None, *, limit: int | None = None) -> RemoteSelection:
        """The rays that satisfy a criterion, as `query.select`.

        Parameters
        ----------
        criterion : text, tree or JSON; None selects every ray
        limit : only the rays with the smallest numbers, this many
        """
        asked = {"map": self.name, "criterion": criterion, "limit": limit}
        return RemoteSelection(self.service, asked, self.service.ask("count", asked))

    def path_table(
        self,
        criterion: Any = None,
        *,
        by: str = "face",
        sort: str = "flux",
        peak: str | None = None,
        top: int | None = None,
    ) -> RemotePaths:
        """Paths of a selection with rays, flux and share, as `query.path_table`."""
        asked = {"map": self.name, "criterion": criterion, "by": by, "sort": sort, "peak": peak,
                 "top": top}  # fmt: skip
        return RemotePaths(self.service.table("paths", asked))

    def report(self, ray_id: int) -> dict[str, Any]:
        """Everything that is recorded of one ray, point by point, as `query.report`."""
        return self.service.ask("report", {"map": self.name, "ray_id": int(ray_id)})

    def image(self, detector: str, criterion: Any = None) -> RemoteImage:
        """What the selected rays put on a detector, as `query.detector_image`."""
        asked = {"map": self.name, "detector": detector, "criterion": criterion}
        return RemoteImage(self.service.table("image", asked))

    def lines(self, criterion: Any = None, *, limit: int | None = None) -> Any:
        """The selected rays as polylines: ``ray_id``, ``source``, ``rgb``, ``points`` (Arrow)."""
        asked = {"map": self.name, "criterion": criterion, "limit": limit}
        return self.service.table("lines", asked)

    def picture(
        self,
        criterion: Any = None,
        *,
        out: str | Path | None = None,
        rays: int | None = None,
        size: tuple[int, int] | None = None,
        color: str | None = None,
        view: str | None = None,
    ) -> bytes:
        """The scene with the selected rays as PNG, as `viewer.picture`; written to ``out``, too."""
        width, height = size or (None, None)
        asked = {"map": self.name, "criterion": criterion, "rays": rays, "width": width,
                 "height": height, "color": color, "view": view}  # fmt: skip
        data: bytes = self.service.table("picture", asked).column("png")[0].as_py()
        if out is not None:
            with replacing(Path(out)) as beside:
                beside.write_bytes(data)
        return data

    def view(
        self, criterion: Any = None, *, detector: str | None = None, browser: bool = False
    ) -> RemoteView:
        """Open the application on the machine of the service, as `viewer.view`.

        Parameters
        ----------
        criterion, detector : to begin with
        browser : open it in a browser there; else open ``url`` yourself
        """
        asked = {"map": self.name, "criterion": criterion, "detector": detector,
                 "browser": browser}  # fmt: skip
        return RemoteView(self.service, self.service.ask("view", asked))

    def __repr__(self) -> str:
        return f"<RemoteMap {self.name!r} at {self.service.address}: {self.rays} rays>"


class RemoteSelection:
    """Rays that satisfy a criterion; counted at once, fetched when they are asked for.

    Attributes
    ----------
    summary : the whole answer, as `raymap query --count --json` prints it
    """

    def __init__(self, service: Service, asked: dict[str, Any], summary: dict[str, Any]) -> None:
        self.summary = summary
        self._service, self._asked = service, asked

    @property
    def matched(self) -> int:
        """How many rays satisfy it."""
        return int(self.summary["matched"])

    @property
    def rays(self) -> int:
        """Rays of the map that the answer speaks for."""
        return int(self.summary["rays"])

    @property
    def flux(self) -> float:
        """Flux of the rays [flux unit of the map]."""
        return float(self.summary["flux"])

    @property
    def flux_se(self) -> float:
        """Standard error of the flux."""
        return float(self.summary["flux_se"])

    @property
    def flux_bound_95(self) -> float | None:
        """Where nothing matched: with 95 % confidence the flux is below this."""
        bound = self.summary.get("flux_bound_95")
        return None if bound is None else float(bound)

    @property
    def reason(self) -> str | None:
        """Why nothing matched, None if something did."""
        return self.summary.get("reason")

    def __len__(self) -> int:
        return self.matched

    def __bool__(self) -> bool:
        return self.matched > 0

    @cached_property
    def ray_ids(self) -> NDArray[np.int64]:
        """(matched,) increasing ray numbers."""
        table = self._service.table("ray_ids", self._asked)
        ids: NDArray[np.int64] = table.column("ray_id").to_numpy()
        return ids

    def to_arrow(self, rows: str = "segments") -> Any:
        """The rays as one Arrow table; ``rows`` is "segments" or "rays"."""
        return self._service.table("rays", {**self._asked, "rows": rows})

    def batches(self, rows: str = "segments") -> Iterator[Any]:
        """The rays as record batches, for selections that do not fit in memory."""
        for chunk in self._service.stream("rays", {**self._asked, "rows": rows}):
            yield chunk.data

    def to_numpy(self, rows: str = "segments") -> dict[str, NDArray[Any]]:
        """The rays as NumPy columns."""
        table = self.to_arrow(rows)
        return {name: table[name].to_numpy() for name in table.column_names}

    def __repr__(self) -> str:
        unit = self.summary["flux_unit"]
        flux = marked(f"{self.flux:.6g} ± {self.flux_se:.2g} {unit}", self.flux, self.flux_se)
        return f"<RemoteSelection {self.matched} of {self.rays} rays, flux {flux}>"


class RemotePaths:
    """A path table, strongest first; the last row is the remainder.

    Attributes
    ----------
    table : `pyarrow.Table`
    n_paths : different paths of the selection
    total : flux of the selection
    """

    def __init__(self, table: Any) -> None:
        self.table = table
        facts = json.loads((table.schema.metadata or {})[b"raymap.table"])
        self.n_paths, self.total = int(facts["n_paths"]), float(facts["total"])
        self.flux_unit, self.by = str(facts["flux_unit"]), str(facts["by"])

    def __len__(self) -> int:
        return self.n_paths

    def to_json(self) -> list[dict[str, Any]]:
        """The rows as `raymap paths --json` prints them."""
        rows = []
        for row in self.table.to_pylist():
            u, v = row.pop("peak_u"), row.pop("peak_v")
            if row["peak_flux"] is None:
                del row["peak_flux"]
            else:
                row["peak"] = None if u is None else [u, v]
            rows.append(row)
        return rows

    def __str__(self) -> str:
        """The strongest paths as a table of plain text."""
        flux = f"flux [{self.flux_unit}]"
        lines = [f"{'rays':>12} {flux:>12} {'±':>9} {'share':>9}  path by {self.by}"]
        rows = self.to_json()[:_SHOWN]
        for row in rows:
            se = marked(f"{row['flux_se']:.2g}", row["flux"], row["flux_se"])
            lines.append(
                f"{row['rays']:>12,} {row['flux']:>12.4g} {se:>9} {row['share']:>9.3%}  "
                f"{row['path']}"
            )
        if self.table.num_rows > _SHOWN:
            lines.append(f"… {self.table.num_rows - _SHOWN} more rows")
        if any(row["doubtful"] for row in rows):
            lines.append(FOOTNOTE)
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<RemotePaths {self.n_paths} paths by {self.by}, {self.total:.6g} {self.flux_unit}>"


class RemoteImage:
    """What a detector saw of a selection; row 0 is its bottom row.

    Attributes
    ----------
    detector, channel_set : descriptions, as in the map's directory
    flux, variance, rays : (cells_v, cells_u)
    channels : (cells_v, cells_u, n_channels) [flux unit]
    """

    def __init__(self, table: Any) -> None:
        facts = json.loads((table.schema.metadata or {})[b"raymap.image"])
        self.detector: dict[str, Any] = facts["detector"]
        self.channel_set: dict[str, Any] = facts["channel_set"]
        self.flux_unit, self.length_unit = facts["flux_unit"], facts["length_unit"]
        width, height = facts["cells"]

        def column(name: str, *shape: int) -> NDArray[Any]:
            values: NDArray[Any] = table.column(name).combine_chunks().flatten().to_numpy()
            return values.reshape(height, width, *shape)

        self.flux = column("flux")
        self.variance = column("variance")
        self.rays = column("rays")
        self.channels = column("channels", int(facts["n_channels"]))

    @property
    def total(self) -> float:
        """Flux registered [flux unit]."""
        return float(self.channels.sum())


class RemoteView:
    """An application that was opened for the user; close it or use it as a context manager.

    Attributes
    ----------
    url : of its page, token included
    drawn : what the user had entered and drawn when it was last looked at: ``criterion``,
        ``detector``, ``region`` (``shape`` and ``values`` in cells, or None), ``ray``, ``paths``
    """

    def __init__(self, service: Service, opened: dict[str, Any]) -> None:
        self._service, self._key = service, opened["view"]
        self.url: str = opened["url"]
        self.drawn: dict[str, Any] = self.look()

    def look(self) -> dict[str, Any]:
        """What is entered and drawn now."""
        self.drawn = self._service.ask("drawn", {"view": self._key})
        return self.drawn

    def wait(self, seconds: float = 600.0) -> bool:
        """Wait until the user has entered or drawn something else; false if the time is over."""
        since = self.drawn["state"]
        end = time.monotonic() + seconds
        while True:
            left = end - time.monotonic()
            if left <= 0.0:
                return False
            asked = {"view": self._key, "since": since, "wait_seconds": min(left, 20.0)}
            self.drawn = self._service.ask("drawn", asked)
            if self.drawn["state"] != since:
                return True

    def close(self) -> None:
        """Close the application."""
        self._service.ask("close_view", {"view": self._key})

    def __enter__(self) -> RemoteView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
